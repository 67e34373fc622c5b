"""The phases of the paper: of each ``x.py`` decides and ``_x.pyx`` has the loop.

::

    preprocess ─► marks
    eye ─► traversal ─► intersection ─► shading ─► film, and the next depth's rays
             rays         objects         hits

What the loops are made of, inline::

    in_flight      RaysInFlight              the memory of rays, and how complete ones leave it
    traversal      RayPool ──► slab_walk     a ray's candidates in a slab, and its sentinel
                       └─────► outliers      objects that are in no voxel
    intersection   Intersector ─► pending    rays that met a box, tested against the object
                       └───────► settle      the same when its geometry has come
    of a hit       nearest                   the least (t, id); or crossings, all of them
"""
