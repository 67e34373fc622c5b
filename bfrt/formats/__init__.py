"""Readers of scene files, one a format; each streams its file into a scene writer.

::

    nff ─────────────────────────────────────────────────────────────────────► SceneSink
    stl ───────────────────────────────► triangles ──────────────► ObjectWriter ──────►│
    ply, obj, off ─────────────────────► Mesh ─► mesh: joined ────►│  ▲
    npy, hdf5 ─► named arrays (table) ─► layouts ─► arrays ───────►│  │
    las, laz ──────────────────────────► Points ─► points ────────►┘  │
    raster (GeoTIFF and others) ───────► triangles ──────────────►────┘
    ply, obj, off without faces ───────► Points              colors, triangulation
    lines, pcd, lammps, e57 ─► columns ─► Points

`bfrt.formats.source` reads the bytes, of packed files (`gzipped`) what they contain, and words the
errors; ``_x.pyx`` has the loop of ``x.py``. PLY, PCD, HDF5, E57, lines of numbers (XYZ, CSV and
others) and layouts of steps (`layouts`) have rooms of their own. Points without a radius may take
their `spacing`. What a file contains is told beside its reader, in rows of `contents`.
"""
