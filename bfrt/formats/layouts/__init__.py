"""Layouts of particles that other programs have, seen as plain arrays of one frame.

::

    Arrays, attributes ─► layout ─► Arrays of one frame ─► bfrt.formats.arrays
                            │
                            ├─ openpmd   data/200/particles/e/position/x, with units and offsets
                            ├─ h5part    Step#7/x
                            └─ frames    particles/all/position/value (frames, n, 3), as of H5MD

A layout is told by attributes and by names. It lists the arrays of one step, the last or the one
that is asked for; any array may be asked for by its whole path, of whatever step it is.
"""
