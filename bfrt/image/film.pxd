"""The film: sums that no order of additions changes."""

from libc.math cimport floor
from libc.stdint cimport int64_t, uint32_t, uint64_t

from bfrt.streams.atomic cimport atomic_add_saturating


cdef class Film:
    cdef int64_t[:, ::1] sums       # element, R G B A; units of 2^-32
    cdef float[:, ::1] depth_normal  # element: Z, N.X, N.Y, N.Z of sample 0
    cdef uint64_t[::1] ids          # element: object id of sample 0
    cdef float[:, ::1] positions    # element: P.X, P.Y, P.Z of sample 0; none if not asked for
    cdef float[:, ::1] albedos      # element: albedo.R, .G, .B of sample 0; likewise
    cdef const uint32_t[::1] numbers  # element: its number in the frame; or none: the same
    cdef const uint32_t[::1] lines  # row: which one of the frame it is; or none: the same
    cdef int64_t across             # elements of a row
    cdef int64_t first              # the element that is the first in memory
    cdef readonly int row           # the image row that it begins
    cdef readonly int held          # image rows in memory at a time
    cdef readonly tuple shape
    cdef readonly int samples
    cdef readonly int views         # that lie side by side
    cdef readonly bint corners


cdef inline int64_t fixed(double x) noexcept nogil:
    """Return x in units of 2^-32, rounded to nearest, saturating; what is not positive is 0."""
    if not x > 0.0:
        return 0
    if x >= 2147483648.0:
        return <int64_t>0x7FFFFFFFFFFFFFFF
    return <int64_t>floor(x * 4294967296.0 + 0.5)


cdef inline void film_add(Film film, uint32_t element, double red, double green, double blue,
                          double alpha) noexcept nogil:
    """Add a contribution. Threads may do so at once."""
    cdef int64_t* sums = &film.sums[element - film.first, 0]
    atomic_add_saturating(&sums[0], fixed(red))
    atomic_add_saturating(&sums[1], fixed(green))
    atomic_add_saturating(&sums[2], fixed(blue))
    atomic_add_saturating(&sums[3], fixed(alpha))


cdef inline uint32_t film_number(Film film, uint32_t element) noexcept nogil:
    """Return an element's number in the frame."""
    cdef int64_t row
    if film.numbers.shape[0]:
        return film.numbers[element]
    if film.lines.shape[0]:
        row = element // film.across
        return <uint32_t>(element + (film.lines[row] - row) * film.across)
    return element
