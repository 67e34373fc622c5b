"""Sequential merging: boxes in, in their order, fewer and larger boxes out; and boxes quantised in
those."""

cimport cython
from libc.stdint cimport int64_t

from bfrt.geometry.box cimport Box, box_add, box_clear, box_empty
from bfrt.geometry.packet cimport BOXES
from bfrt.geometry.quantised cimport Coding, Codings, codes_of, codings_of, coding_in
from bfrt.records cimport Parent


cdef inline double area_of(const Box* b) noexcept nogil:
    """Return the surface of a box."""
    cdef double x, y, z
    if box_empty(b):
        return 0.0
    x = <double>b.hi[0] - b.lo[0]
    y = <double>b.hi[1] - b.lo[1]
    z = <double>b.hi[2] - b.lo[2]
    return 2.0 * (x * y + y * z + z * x)


@cython.final
cdef class Merger:
    """Makes one level of a hierarchy of the one below (the paper's section 3.1).

    Parameters
    ----------
    limit : float
        The surface that a merged box has at the most: T A_all.
    most : int
        Boxes that are merged into one at the most.
    least : int
        Boxes that are merged into one whatever its surface, but for the last.
    """

    cdef Box box  # what is merged so far
    cdef double limit
    cdef int64_t most
    cdef int64_t least
    cdef int64_t begin
    cdef int64_t end

    def __cinit__(self, double limit, int64_t most, int64_t least=1):
        self.limit = limit
        self.most = most
        self.least = least
        box_clear(&self.box)

    def merge(self, const float[:, ::1] boxes, Parent[::1] out):
        """Take the next boxes.

        Parameters
        ----------
        boxes : (n, 6) float32
            IN.
        out : (n or more,) records.PARENT
            OUT. The boxes that are complete.

        Returns
        -------
        int
            Number of complete boxes.
        """
        cdef int64_t i, begin = self.begin, end = self.end, made = 0
        cdef Box box = self.box, both
        cdef const Box* next
        with nogil:
            for i in range(boxes.shape[0]):
                next = <const Box*>&boxes[i, 0]
                both = box
                box_add(&both, next)
                if end == 0 or end - begin < self.least or (
                    area_of(&both) <= self.limit and end - begin < self.most
                ):
                    box = both
                else:
                    (<Box*>&out[made].lox)[0] = box
                    out[made].end = end
                    made += 1
                    begin = end
                    box = next[0]
                end += 1
        self.box, self.begin, self.end = box, begin, end
        return made

    def finish(self, Parent[::1] out):
        """Complete the last box; how many that makes."""
        if self.end == 0:
            return 0
        (<Box*>&out[0].lox)[0] = self.box
        out[0].end = self.end
        return 1


def quantise(const float[:, ::1] boxes, const Parent[::1] parents, int64_t first,
             unsigned char[:, ::1] codes):
    """Code the boxes that lie in some parents.

    Parameters
    ----------
    boxes : (n, 6) float32
        IN. The children of the parents, in their order.
    parents : (m,) records.PARENT
        IN.
    first : int
        The number of the first box, in which parents' ends count.
    codes : (n, 6) uint8
        OUT. As bfrt/geometry/quantised.pxd has them.
    """
    cdef Coding coding
    cdef Codings all
    cdef int64_t end, i = 0, k
    cdef int n
    with nogil:
        for k in range(parents.shape[0]):
            coding_in(<const Box*>&parents[k].lox, &coding)
            codings_of(&coding, &all)
            end = min(parents[k].end - first, boxes.shape[0])
            while i < end:
                n = <int>min(<int64_t>BOXES, end - i)
                codes_of(&coding, &all, &boxes[i, 0], n, &codes[i, 0])
                i += n
