"""Readers of scene files, one a format; each streams its file into a scene writer.

::

    nff ─────────────────────────────────────────────────────────────────────► SceneSink
    stl ───────────────────────────────► triangles ──────────────► ObjectWriter ──────►│
    ply, obj ──────────────────────────► Mesh ─► mesh: joined ────►│  ▲
    npy, hdf5 ─► named arrays (table) ─► layouts ─► arrays ───────►│  │
    las, laz ──────────────────────────► Points ─► points ────────►┘  │
    ply, obj without faces ────────────► Points              colors, triangulation

`bfrt.formats.source` reads the bytes and words the errors; ``_x.pyx`` has the loop of ``x.py``; PLY
has a room of its own, `bfrt.formats.ply`, and so have layouts of steps, `bfrt.formats.layouts`.
What a file contains is told beside its reader, in rows of `bfrt.formats.contents`.
"""
