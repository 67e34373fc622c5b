"""The walk down a stream's hierarchy: a parent near nothing is skipped with all below it."""

cimport cython
from libc.stdint cimport int64_t
from libc.string cimport memcpy

from bfrt.geometry.box cimport Box
from bfrt.grid.planes cimport Planes
from bfrt.grid.grid cimport Grid
from bfrt.grid.nearby cimport rays_near
from bfrt.grid.subspace cimport Subspace, box_near
from bfrt.grid.voxel_rays cimport VoxelRays
from bfrt.records cimport BOX_BYTES, Parent
from bfrt.store._hierarchy cimport MOST_LEVELS
from bfrt.streams.reader cimport Reader, skip, take
from bfrt.errors import StoreError

cdef enum:
    LEVELS = MOST_LEVELS + 1  # with that of the objects' own boxes
    PARENT_BYTES = sizeof(Parent)
    JOINED = 1024  # objects of neighboring parents that make one range; more make work uneven


@cython.final
cdef class HierarchyWalk:
    """Walks a stream's hierarchy for the objects that a pass looks at, as ranges, in order.

    Each level is read forwards, and only those of its records whose parents are near something.

    Parameters
    ----------
    stream : bfrt.store.store.Stream
        One with levels.
    capacity : int
        Bytes of each level's read buffer.
    """

    cdef tuple files
    cdef list readers          # whose they are:
    cdef void* reader[LEVELS]  # of level 1, 2, ...
    cdef object path
    cdef int64_t counts[LEVELS]  # boxes of each level; of level 0, objects
    cdef int64_t next[LEVELS]  # record to read
    cdef int64_t end[LEVELS]   # of those whose parent is at hand
    cdef int64_t child[LEVELS]  # where that record's children begin
    cdef int top
    cdef int level             # that is being read, or more than top at the end
    cdef Grid grid
    cdef VoxelRays rays        # what objects are to be near, or None:
    cdef Subspace subspace
    cdef int64_t boxes_read

    def __cinit__(self, stream, size_t capacity):
        cdef int k
        self.top = len(stream.levels)
        if not 0 < self.top < LEVELS:
            raise ValueError(f"selection: found {self.top} levels, expected 1 to {LEVELS - 1}")
        self.path = stream.folder
        self.files = tuple(stream.opened(f"level{k}") for k in range(1, self.top + 1))
        self.readers = [Reader(file, capacity, True) for file in self.files]
        for k in range(self.top):
            self.reader[k + 1] = <void*>self.readers[k]
        for k, count in enumerate([stream.count, *stream.levels]):
            self.counts[k] = count

    def begin(self, Grid grid not None, where):
        """Begin at the first object to find those near `where`.

        Parameters
        ----------
        grid : Grid
        where : VoxelRays or Subspace
            The voxels that hold rays, or those of a part of the grid.
        """
        cdef Reader reader
        cdef int k
        self.grid = grid
        self.rays = where if isinstance(where, VoxelRays) else None
        self.subspace = None if isinstance(where, VoxelRays) else where
        for k in range(1, self.top + 1):
            reader = <Reader>self.reader[k]
            reader.rewind()
            reader.window(0, self.counts[k] * PARENT_BYTES)
            self.next[k] = self.end[k] = self.child[k] = 0
        self.end[self.top] = self.counts[self.top]
        self.level = self.top

    def choose(self, int64_t[:, ::1] ranges, int64_t objects, float[:, ::1] parents=None):
        """Find the next ranges of objects.

        Parameters
        ----------
        ranges : (capacity, 2) int64
            OUT. First and end of each, ascending.
        objects : int
            No more ranges are looked for when they have so many.
        parents : (capacity, 6) float32, optional
            OUT. The box around the objects of each range, which are then those of one parent.

        Returns
        -------
        int
            Number of ranges; 0 at the end.
        """
        cdef int64_t n
        with nogil:
            n = self.find(ranges, objects, parents)
        return n

    cdef int64_t find(self, int64_t[:, ::1] ranges, int64_t objects,
                      float[:, ::1] parents) except -1 nogil:
        """Find the ranges for `choose`, without the GIL."""
        cdef const Planes* planes = &self.grid.planes
        cdef Parent parent
        cdef bint near
        cdef int64_t begin, n = 0, found = 0
        cdef int k
        while self.level <= self.top and n < ranges.shape[0] and found < objects:
            k = self.level
            if self.next[k] == self.end[k]:
                self.level += 1
                continue
            begin = self.child[k]
            self.read(k, &parent)
            self.boxes_read += 1
            if self.rays is not None:
                near = rays_near(self.rays, planes, <const Box*>&parent)
            else:
                near = box_near(<const Box*>&parent, planes, self.subspace)
            if not near:
                continue
            if k > 1:
                self.descend(k - 1, begin, parent.end)
                continue
            found += parent.end - begin
            if (parents is None and n and ranges[n - 1, 1] == begin
                    and parent.end - ranges[n - 1, 0] <= JOINED):
                ranges[n - 1, 1] = parent.end
            else:
                ranges[n, 0], ranges[n, 1] = begin, parent.end
                if parents is not None:
                    memcpy(&parents[n, 0], &parent, BOX_BYTES)
                n += 1
        return n

    cdef int read(self, int k, Parent* parent) except -1 nogil:
        """Read the next record of a level."""
        parent[0] = (<const Parent*>take(<Reader>self.reader[k], PARENT_BYTES))[0]
        self.next[k] += 1
        if not 0 < parent.end <= self.counts[k - 1] or parent.end < self.child[k]:
            self.refuse(k, parent.end)
        self.child[k] = parent.end
        return 0

    cdef int refuse(self, int k, int64_t end) except -1 nogil:
        """Raise `StoreError`: records of a level have to tell ascending ends of their children."""
        with gil:
            raise StoreError(
                f"{self.path}: level {k}: found a box whose children end at {end}, "
                f"expected {self.child[k]} to {self.counts[k - 1]}"
            )

    cdef int descend(self, int k, int64_t begin, int64_t end) except -1 nogil:
        """Go on with the records [begin, end) of level k; the one before tells where their
        children begin."""
        cdef int64_t between = begin - self.next[k]
        cdef Parent before
        if between > 0:
            skip(<Reader>self.reader[k], (between - 1) * PARENT_BYTES)
            self.next[k] = begin - 1
            self.read(k, &before)
        self.end[k] = end
        self.level = k
        return 0

    def counts_read(self):
        """Return the boxes and bytes read and the seeks since the last call."""
        boxes, self.boxes_read = self.boxes_read, 0
        counts = [file.counts() for file in self.files]
        return boxes, sum(c[0] for c in counts), sum(c[1] for c in counts)
