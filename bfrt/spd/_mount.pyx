"""A square of the mountain: halved until its cells are its own, and written as triangles."""

cimport cython
from libc.stdint cimport int32_t, int64_t

cdef double DIAGONAL = 1.4142136  # the package's square root of 2, for the middle of a square

ctypedef fused scalar:
    float
    double

# Where noise comes from: which hash, of which size of mountain, and what its values stand for.
cdef struct Source:
    const double* deviates
    int size
    bint jenkins


cdef inline int64_t shifted(int64_t a, int bits) noexcept nogil:
    """Shift left; a negative shift leaves 0, as of 16 bits."""
    return a << bits if 0 <= bits < 16 else 0


cdef inline int64_t package_hash(int64_t x, int64_t y, int size) noexcept nogil:
    return (shifted(x, 23 - size) + shifted(y, 15 - size) + shifted(x, 7 - size)) & 0xFFFF


cdef inline int32_t minus(int32_t a, int32_t b, int32_t c) noexcept nogil:
    """Return a - b - c, modulo 2^32."""
    return <int32_t>(<unsigned int>a - <unsigned int>b - <unsigned int>c)


cdef inline int32_t left(int32_t a, int bits) noexcept nogil:
    return <int32_t>(<unsigned int>a << bits)


cdef inline void mix(int32_t* m, int first, int second, int third) noexcept nogil:
    m[0] = minus(m[0], m[1], m[2]) ^ (m[2] >> first)
    m[1] = minus(m[1], m[2], m[0]) ^ left(m[0], second)
    m[2] = minus(m[2], m[0], m[1]) ^ (m[1] >> third)


cdef inline int64_t jenkins_hash(int64_t x, int64_t y, int size) noexcept nogil:
    """Mix three signed 32-bit integers by Bob Jenkins's hash."""
    cdef int32_t m[3]
    m[0], m[1], m[2] = <int32_t>x, <int32_t>y, size
    mix(m, 13, 8, 13)
    mix(m, 12, 16, 5)
    mix(m, 3, 10, 15)
    return m[2] & 0xFFFF


cdef inline double noise_at(const Source* source, int64_t x, int64_t y) noexcept nogil:
    if source.jenkins:
        return source.deviates[jenkins_hash(x, y, source.size)]
    return source.deviates[package_hash(x, y, source.size)]


@cython.final
cdef class Noise:
    """Gives a mountain its noise, which is taken from a table by a hash of where a point is.

    Parameters
    ----------
    size : int
        Of the mountain.
    jenkins : bool
        Whether the hash is Bob Jenkins's, not the package's first.
    deviates : (65536,) float64
        The noise of each value of the hash.
    """

    cdef Source source
    cdef const double[::1] deviates

    def __cinit__(self, int size, bint jenkins, const double[::1] deviates):
        self.deviates = deviates
        self.source.deviates, self.source.size, self.source.jenkins = &deviates[0], size, jenkins

    def halve(self, const double[:, ::1] z, int64_t x, int64_t y, int64_t side, double rise,
              double[:, ::1] finer):
        """Halve squares: points between neighbors, and in the middle of four.

        Parameters
        ----------
        z : (m + 1, m + 1) float64
            IN. Heights at the corners of m x m squares, row by row in y.
        x, y, side : int
            The first corner, and the side of a square, in cells.
        rise : float
            The factor of the noise.
        finer : (2m + 1, 2m + 1) float64
            OUT.
        """
        cdef Source source = self.source  # which no store to `finer` can change
        cdef int64_t i, j, m = z.shape[0] - 1, half = side // 2, px, py
        with nogil:
            for j in range(m + 1):
                py = y + side * j
                for i in range(m + 1):
                    px = x + side * i
                    finer[2 * j, 2 * i] = z[j, i]
                    if i < m:
                        finer[2 * j, 2 * i + 1] = ((z[j, i] + z[j, i + 1]) / 2.0
                                                   + rise * noise_at(&source, px + half, py))
                    if j < m:
                        finer[2 * j + 1, 2 * i] = ((z[j, i] + z[j + 1, i]) / 2.0
                                                   + rise * noise_at(&source, px, py + half))
                    if i < m and j < m:
                        finer[2 * j + 1, 2 * i + 1] = (
                            (z[j, i] + z[j, i + 1] + z[j + 1, i + 1] + z[j + 1, i]) / 4.0
                            + DIAGONAL * rise * noise_at(&source, px + half, py + half))


cdef inline scalar* point(scalar* out, double x, double y, double z) noexcept nogil:
    out[0], out[1], out[2] = <scalar>x, <scalar>y, <scalar>z
    return out + 3


cdef inline int64_t even_bits(int64_t code) noexcept nogil:
    """Return every other bit of an index, closed up: its part along one axis."""
    cdef int64_t value = 0
    cdef int bit
    for bit in range(16):
        value |= (code >> bit) & ((<int64_t>1) << bit)
    return value


def triangles(const double[:, ::1] z, const double[::1] xs, const double[::1] ys,
              scalar[:, ::1] records):
    """Make two triangles for each cell, in the order of the halving.

    Quarters come lower left, lower right, upper right, upper left, at every level.

    Parameters
    ----------
    z : (m + 1, m + 1) float64
        IN. Heights, row by row in y; m is a power of two, 2^15 or less.
    xs, ys : (m + 1,) float64
        IN.
    records : (2 m^2, 9) float32 or float64
        OUT.
    """
    cdef int64_t cell, upper, across, i, j
    cdef scalar* out = &records[0, 0]
    with nogil:
        for cell in range(records.shape[0] // 2):
            upper = even_bits(cell >> 1)
            across = even_bits(cell) ^ upper
            i, j = across, upper
            out = point(out, xs[i], ys[j], z[j, i])
            out = point(out, xs[i + 1], ys[j], z[j, i + 1])
            out = point(out, xs[i + 1], ys[j + 1], z[j + 1, i + 1])
            out = point(out, xs[i + 1], ys[j + 1], z[j + 1, i + 1])
            out = point(out, xs[i], ys[j + 1], z[j + 1, i])
            out = point(out, xs[i], ys[j], z[j, i])
