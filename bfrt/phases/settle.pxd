"""Deferred tests: a ray that meets a box waits for the object's geometry, and is settled when that
has come.

What waits, and how its geometry is prefetched, is deferred.pxd's.
"""

from libc.stdint cimport int64_t, uint32_t

from bfrt.geometry.box cimport Box, box_pad, padded_span
from bfrt.geometry.lanes cimport LANES
from bfrt.geometry.shape cimport BoxHit, shape_bounds, shape_load
from bfrt.phases.nearest cimport ray_line
from bfrt.phases.pending cimport Pending, prefetch_ray, test_pending
from bfrt.records cimport Delayed, Ray
from bfrt.scan.deferred cimport (
    DeferredTests, delay, end_delays, full, piece_end, prefetch_piece, turn,
)
from bfrt.scan.geometry cimport GeometryCursor, records_of, seek_records
from bfrt.scan.scan cimport StreamScan, object_id
from bfrt.streams.atomic cimport atomic_load

cdef enum:
    SOON = 8  # delayed rays: so long before it is looked at, each is fetched


cdef inline int load_object(GeometryCursor g, DeferredTests d, const Delayed* waits,
                            int64_t n) except -1 nogil:
    """Read the geometry that the first of n delayed rays waits for, and the box around it: that
    of the scan may be quantised."""
    cdef int64_t first = waits[0].first
    cdef Box box
    if first >= d.known:
        d.known = piece_end(waits, n, g.reader.gap // g.stride)
        seek_records(g, first, d.known)
    g.objects_read += 1
    d.loaded = waits[0].id
    d.degenerate = not shape_load(
        g.kind, records_of(g, first, waits[0].count), waits[0].count, &g.frame, &d.shape
    )
    if not d.degenerate:
        shape_bounds(&d.shape, &box)
        box_pad(&box, d.padding, &d.own)
    return 0


cdef inline void meet_own_box(Pending* p, DeferredTests d, uint32_t ray) noexcept nogil:
    """Make a delayed ray pending if it meets its object's own box, not only the quantised."""
    cdef const Ray* r = &p.rays[ray]
    cdef BoxHit* m = &p.meetings[p.n]
    m.line = ray_line(r)
    m.mark = ray
    if not d.degenerate and padded_span(&d.own, &m.line, &m.span):
        p.n += m.span.near <= atomic_load(&r.t)


cdef inline int settle_half(Pending* p, GeometryCursor g, DeferredTests d,
                            int half) except -1 nogil:
    """Find the hits of the rays that wait in a half. An object may be the last of the other, too.
    """
    cdef const Delayed* waits = &d.halves[half, 0]
    cdef int64_t i = 0, n = d.count[half]
    while i < n:
        if waits[i].id != d.loaded:
            load_object(g, d, &waits[i], n - i)
        while i < n and waits[i].id == d.loaded and p.n < LANES:
            prefetch_ray(&p.rays[waits[min(i + SOON, n - 1)].ray])
            meet_own_box(p, d, waits[i].ray)
            i += 1
        if p.n:
            test_pending(p, &d.shape, d.loaded)
    return 0


cdef inline int settle_all(Pending* p, GeometryCursor g, DeferredTests d) except -1 nogil:
    """Find the hits of all rays that still wait, at the end of a stream."""
    prefetch_piece(d, g.reader)
    settle_half(p, g, d, 1 - d.half)
    settle_half(p, g, d, d.half)
    end_delays(d)
    return 0


cdef inline int defer_test(Pending* p, StreamScan w, DeferredTests d, int place,
                           uint32_t ray) except -1 nogil:
    """Have a ray that met the box of an object of the scan's block wait for the geometry."""
    cdef Delayed wait
    if full(d):
        prefetch_piece(d, w.geometry.reader)
        settle_half(p, w.geometry, d, 1 - d.half)
        turn(d)
    wait.id, wait.ray = object_id(w, place), ray
    wait.first, wait.count = w.boxes.first + place, 1
    if w.geometry.counted:
        wait.first = w.boxes.ends[place]
        wait.count = w.boxes.ends[place + 1] - w.boxes.ends[place]
    delay(d, w.geometry.reader, w.geometry.stride, &wait)
    return 0
