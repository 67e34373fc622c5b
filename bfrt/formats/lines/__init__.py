"""Lines of numbers: points of text in columns, and what other formats have of the same kind.

::

    head ─► Head: names, separator, where rows begin, the count that a line promises
              │
            table ─► LineTable: columns by their names, block by block      _lines.Columns
              │
           reader ─► points (bfrt.formats.columns)

XYZ, CSV, TXT, PTS and ASC are one format here: what parts columns, and whether they have names, is
found in the first lines.
"""
