"""The uniform grid: its planes and walks, marks in bricks on disk, rays stored in its voxels.

::

    Grid ── planes, walk                       which voxels a box is in, which a ray goes through
      │
    partition ── subspaces ─► marks ── bricks ─► Slabs       where regions begin, on disk, in memory
      │
    VoxelRays ── nearby                        the rays of a pass, and which of them are near a box
      │
    Selection ── HierarchyWalk                 the objects near those rays, or near a subspace

It knows objects by their boxes only. Another accelerator can stand beside it behind the same verbs:
prepare, first candidate, collect, intersect.
"""
