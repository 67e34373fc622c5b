"""Spatial order: a stream's objects, as they were given, brought into treelets.

::

    given files ─► objects ─► windows as they come, where the order is local
                      │
                      └─► parts, by cells of a grid ─► windows, along a curve in each part
                                                          │ ahead, by threads
                                                       treelets ─► ordered files: geometry, ids,
                                                                   materials, nodes, treelets

An object's id counts in the order given, always: `ids` has it for each place in the order.
"""
