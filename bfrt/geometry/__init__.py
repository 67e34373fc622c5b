"""The five kinds of objects and their boxes, as lines meet them: inline C, without the GIL.

::

    vector ── far                                lines: float64, moved nearer if they start far off
      │
    coordinates ─► sphere  cone  triangle  patch  polygon    a record's numbers, and a kernel a kind
                                 └─── outline ───┘           on which side of an edge a line passes
                                     │
                                   shape                     the switch over the kinds
    box ── packet, lanes                                     a line's span in a box; many at once
      └── quantised                                          boxes in a byte a side

A kernel loads a record, bounds it, and tells where a line hits it. It works with + - x / and square
roots alone, so that every processor gives the same bits (``power`` replaces the C library's pow).
The rules that the kernels name are the rules of exactness in docs/algorithm.rst.
"""
