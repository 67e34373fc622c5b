"""Treelets: objects that lie together, in the order of a small tree over them.

::

    boxes of a window ─► TreeletBuilder ─┬─► order      the objects, leaf by leaf
         split.pxd                       ├─► treelets   a box, the objects and the nodes of each
         node.pxd                        └─► nodes      eight quantised boxes each

It knows objects by their boxes only.
"""
