"""PLY: meshes and points, of bytes in either order or of text.

::

    header ─► elements, each with its properties
                 │
               file ─► vertex: blocks (n, columns)          whole rows by NumPy, or _rows
                 │     face, tristrips: corners, counts     _rows
                 ▼
              reader ─► Mesh or Points; splats ─► Points

Any element may have any properties in any order; what is not wanted is passed over. Where an
element begins is known once those before it were read, or have rows of one size.
"""
