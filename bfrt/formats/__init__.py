"""Readers of scene files, one a format; each streams its file into a scene writer.

::

    nff ─────────────────────────────────────────────────────────────────────► SceneSink
    stl ───────────────────────────────► triangles ──────────────► ObjectWriter ──────►│
    ply, obj ──────────────────────────► Mesh ─► mesh: joined ────►│  ▲
    npy, hdf5 ─► named arrays (table) ─► arrays ─► Mesh, Points ──►│  │
    las, laz ──────────────────────────► Points ─► points ────────►┘  │
    raster (GeoTIFF and others) ───────► triangles ──────────────►────┘
    ply, obj without faces ────────────► Points              colors, triangulation

`bfrt.formats.source` reads the bytes and words the errors; ``_x.pyx`` has the loop of ``x.py``; PLY
has a room of its own, `bfrt.formats.ply`.
"""
