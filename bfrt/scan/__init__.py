"""Reading objects: cursors over a stream's files, and sources that hand out work to threads.

::

    geometry ──► GeometryCursor ──┐  records: in order, or of objects that are picked
    boxes    ──► BoxCursor ───────┼─► StreamScan, one a worker ◄── chunk ◄── AllObjects
    materials ─► ColumnCursor ────┤                                          ChosenObjects
    ids      ──► ColumnCursor ────┘                                          PickedObjects

A cursor only goes forwards (the paper's forward-only seek), and is C, without the GIL. A source's
``next(worker)`` sets the worker's scan to its next objects, or says that there are none.
"""
