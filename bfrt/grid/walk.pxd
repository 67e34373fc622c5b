"""The walk of a ray through the voxels of a grid (exactness rules 2 and 4 to 7).

Crossings of planes are computed from the index each time, so that a walk resumed from (voxel, face)
goes on exactly as if it had never stopped.
"""

from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport HIGH, LOW, Span, slab_axis
from bfrt.geometry.vector cimport Line, larger, smaller
from bfrt.grid.planes cimport START, Planes, layer_of, locate

# The walk's axes are arrays, because a step picks one.
cdef struct Walk:
    const Planes* planes
    double o[3]
    double d[3]
    double inv[3]
    double exit[3]  # t where the ray leaves the voxel on each axis
    const double* border[3]  # the plane by which it does
    int at[3]
    int step[3]
    int hop[3]      # of the voxel's number, with a step
    int side[3]     # the face by which a step comes into the next voxel
    uint32_t voxel
    int face
    double enter    # t where the ray came into the voxel


cdef inline double crossing(const Walk* w, int k, int plane) noexcept nogil:
    return (w.planes.plane[k][plane] - w.o[k]) * w.inv[k]


cdef inline double axis_enter(const Walk* w, int k) noexcept nogil:
    """Return the t at which the ray comes into its voxel's layer of axis k."""
    if w.step[k] == 0:
        return -INFINITY
    return crossing(w, k, w.at[k] + (w.step[k] < 0))


cdef inline double axis_exit(const Walk* w, int k) noexcept nogil:
    if w.step[k] == 0:
        return INFINITY
    return crossing(w, k, w.at[k] + (w.step[k] > 0))


cdef inline void walk_line(Walk* w, const Planes* g, const Line* l) noexcept nogil:
    cdef int k
    w.planes = g
    w.o[0] = l.o.x
    w.o[1] = l.o.y
    w.o[2] = l.o.z
    w.d[0] = l.d.x
    w.d[1] = l.d.y
    w.d[2] = l.d.z
    w.inv[0] = l.inv.x
    w.inv[1] = l.inv.y
    w.inv[2] = l.inv.z
    for k in range(3):
        w.step[k] = (w.inv[k] > 0.0) - (w.inv[k] < 0.0)
        w.hop[k] = w.step[k] * <int>g.stride[k]
        w.side[k] = (LOW if w.step[k] > 0 else HIGH) + k


cdef inline void walk_settle(Walk* w) noexcept nogil:
    """Derive the voxel's number and the exits from `at`."""
    cdef const Planes* g = w.planes
    cdef int k
    w.voxel = <uint32_t>(
        w.at[0] * g.stride[0] + w.at[1] * g.stride[1] + w.at[2] * g.stride[2]
    )
    for k in range(3):
        w.border[k] = g.plane[k] + w.at[k] + (w.step[k] > 0)
        w.exit[k] = axis_exit(w, k)


cdef inline int entry_axis(const Walk* w, double start) noexcept nogil:
    """Return the axis by whose border plane the ray comes into the grid at t = start, or -1."""
    cdef int k
    for k in range(3):
        if w.step[k] > 0 and w.at[k] == 0 and axis_enter(w, k) == start:
            return k
        if w.step[k] < 0 and w.at[k] == w.planes.n[k] - 1 and axis_enter(w, k) == start:
            return k
    return -1


cdef inline bint walk_start(Walk* w, const Planes* g, const Line* l) noexcept nogil:
    """Begin where the ray, from t = 0 on, first meets the grid; false if it never does.

    The voxel is corrected until its crossings bracket the start (rule 5). A ray that comes in
    from outside enters by a border face, where every box that holds the voxel begins: so the
    voxel's marks for that face tell whether it is a candidate, as for any later one. (The design
    makes each start a candidate; only those inside the grid have to be.)
    """
    cdef Span s
    cdef int k
    s.near = 0.0
    s.far = INFINITY
    walk_line(w, g, l)
    for k in range(3):
        if not slab_axis(g.plane[k][0], g.plane[k][g.n[k]], w.o[k], w.inv[k], &s):
            return False
    for k in range(3):
        w.at[k] = locate(g, k, w.o[k] + s.near * w.d[k] if w.step[k] != 0 else w.o[k])
        while axis_enter(w, k) > s.near and 0 <= w.at[k] - w.step[k] < g.n[k]:
            w.at[k] -= w.step[k]
        while axis_exit(w, k) < s.near and 0 <= w.at[k] + w.step[k] < g.n[k]:
            w.at[k] += w.step[k]
    walk_settle(w)
    w.enter = s.near
    w.face = START
    k = entry_axis(w, s.near) if s.near > 0.0 else -1
    if k >= 0:
        w.face = w.side[k]
    return True


cdef inline void walk_resume(Walk* w, const Planes* g, const Line* l, uint32_t voxel,
                             int face) noexcept nogil:
    """Take up a walk again from its state (rule 7). A start is taken up as at t = 0."""
    cdef int k
    walk_line(w, g, l)
    for k in range(3):
        w.at[k] = layer_of(g, k, voxel)
    walk_settle(w)
    w.face = face
    w.enter = 0.0
    if face != START:
        w.enter = axis_enter(w, face % 3)


cdef inline double voxel_enter(const Planes* g, const Line* l, uint32_t voxel,
                               int face) noexcept nogil:
    """Return the t at which a walk with this state came into its voxel, as walk_resume finds it."""
    if face == START:
        return 0.0
    if face % 3 == 0:
        return (g.plane[0][layer_of(g, 0, voxel) + (face >= HIGH)] - l.o.x) * l.inv.x
    if face % 3 == 1:
        return (g.plane[1][layer_of(g, 1, voxel) + (face >= HIGH)] - l.o.y) * l.inv.y
    return (g.plane[2][layer_of(g, 2, voxel) + (face >= HIGH)] - l.o.z) * l.inv.z


cdef inline bint walk_step(Walk* w) noexcept nogil:
    """Step to the next voxel; false when the ray leaves the grid."""
    cdef int k = 0
    if w.exit[1] < w.exit[k]:
        k = 1
    if w.exit[2] < w.exit[k]:
        k = 2
    if w.step[k] == 0:
        return False
    w.enter = w.exit[k]
    w.at[k] += w.step[k]
    if not 0 <= w.at[k] < w.planes.n[k]:
        return False
    w.face = w.side[k]
    w.voxel += w.hop[k]
    w.border[k] += w.step[k]
    w.exit[k] = (w.border[k][0] - w.o[k]) * w.inv[k]
    return True


cdef inline bint crossed(const Walk* w, int k, int plane, double t, int axis) noexcept nogil:
    """Tell whether a walk crosses a plane of axis k before it crosses one of `axis` at t.

    A step takes the least exit, and of equal ones the first axis.
    """
    cdef double own = crossing(w, k, plane)
    return own < t or (own == t and k < axis)


cdef inline bint walk_leave(Walk* w, int shift) noexcept nogil:
    """Step to the first voxel beyond this cube of 2^shift a side; false as for `walk_step`.

    The walk is then where so many steps would have brought it, to the last bit: steps come in
    the order of their crossings, and all that come before the cube's own are taken.
    """
    cdef const Planes* g = w.planes
    cdef double t, leave = INFINITY
    cdef int k, first, after, at, up, axis = -1, beyond = 0
    for k in range(3):
        if w.step[k] == 0:
            continue
        first = w.at[k] >> shift << shift
        after = min(first + (1 << shift), g.n[k])
        t = crossing(w, k, after if w.step[k] > 0 else first)
        if t < leave:
            leave = t
            axis = k
            beyond = after if w.step[k] > 0 else first - 1
    if axis < 0 or not 0 <= beyond < g.n[axis]:
        return False
    for k in range(3):
        if k == axis or w.step[k] == 0:
            continue
        first = w.at[k] >> shift << shift
        after = min(first + (1 << shift), g.n[k])
        up = w.step[k] > 0
        t = (w.o[k] + leave * w.d[k] - g.plane[k][0]) * g.inverse[k]
        if up:
            at = <int>smaller(larger(t, w.at[k]), after - 1)
        else:
            at = <int>smaller(larger(t, first), w.at[k])
        while crossed(w, k, at + up, leave, axis):
            at += w.step[k]
        while at != w.at[k] and not crossed(w, k, at + 1 - up, leave, axis):
            at -= w.step[k]
        w.at[k] = at
    w.at[axis] = beyond
    walk_settle(w)
    w.enter = leave
    w.face = w.side[axis]
    return True
