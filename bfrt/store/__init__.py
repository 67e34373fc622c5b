"""The scene store: a folder of plain files, one for each property of the objects, and a header.

::

    StoreWriter     view and lights                                 ─► header ─► AtomicFolder
        │
    ShapeWriter     a caller's arrays (given), a method a shape
        │ records, in world coordinates
    RecordWriter    Coordinates: dtype, origin; PaletteWriter: materials and their indices
        │ prepare (columns): blocks of one kind with their boxes
    GroupWriter     Extent: bounds, outliers
        │ blocks in the order of the objects
    StreamWriter    a column a file; HierarchyWriter: levels of merged boxes
        │ complete files, and facts
    WrittenGroup    levels over streams, or their order (ordering)
        │ bytes
    FileWriter      length and checksum, for the header

    open_store ─► Store ─► Group ─► Stream

Writing streams blocks through once; opening reads the header alone, and `bfrt.scan` the rest.
"""
