"""PCD, the point clouds of PCL: text, records of bytes, or columns that LZF has packed.

::

    header ─► Header: fields, rows, layout
                │
             fields ─► PcdTable: columns by their names     text: bfrt.formats.lines
                │                                           packed: _lzf, one cursor a column
             reader ─► points (bfrt.formats.columns)

A packed file is one block of columns, x of all points before y of any. It is never held: LZF looks
back 8 KiB at the most, so each column that is wanted is unpacked by a cursor of its own, beside
the others, in memory that does not grow with the file.
"""
