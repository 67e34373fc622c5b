"""Distances from a few points to the nearest of very many, without the GIL."""

from libc.math cimport INFINITY


def meet(
    const double[:, ::1] points not None,
    const double[:, ::1] sample not None,
    double[::1] nearest not None,
):
    """Bring the least squared distances of a sample up to date.

    Parameters
    ----------
    points : (n, 3) float64
        Some of all points.
    sample : (3, k) float64
    nearest : (k,) float64
        Of each of the sample: the least squared distance so far to a point that is elsewhere.
    """
    cdef Py_ssize_t i, j
    cdef Py_ssize_t count = sample.shape[1]
    cdef double x, y, z, dx, dy, dz, d
    cdef const double *sx
    cdef const double *sy
    cdef const double *sz
    cdef double *least
    if count == 0 or points.shape[0] == 0:
        return
    if points.shape[1] != 3 or sample.shape[0] != 3 or nearest.shape[0] != count:
        raise ValueError("points of another number of coordinates, or distances of another sample")
    sx, sy, sz, least = &sample[0, 0], &sample[1, 0], &sample[2, 0], &nearest[0]
    with nogil:
        for i in range(points.shape[0]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            # Without a branch: the compiler makes vectors of it.
            for j in range(count):
                dx = x - sx[j]
                dy = y - sy[j]
                dz = z - sz[j]
                d = dx * dx + dy * dy + dz * dz
                d = d if d > 0.0 else INFINITY
                least[j] = d if d < least[j] else least[j]
