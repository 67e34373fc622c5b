"""The phases of the paper: of each ``x.py`` decides and ``_x.pyx`` has the loop.

::

    preprocess ─► marks
    eye ─► traversal ─► intersection ─► shading ─► film, and the next depth's rays
             rays         objects         hits
"""
