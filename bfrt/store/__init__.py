"""The scene store: a folder of plain files, one for each property of the objects, and a header.

::

    arrays ─► given ─► StoreWriter ─► prepare ─► GroupWriter ─► StreamWriter ─► FileWriter
                           │         (columns)        ├── Extent: bounds, outliers
                           │                          └── Level: merged boxes (hierarchy)
                           └──► header ◄── checks ── open_store ─► Store ─► Group ─► Stream

Writing streams blocks through once; opening reads the header alone, and `bfrt.scan` the rest.
"""
