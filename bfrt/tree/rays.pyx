"""The rays that go through a forest: the loops that admit them, send them on, and let them go."""

cimport cython
from libc.math cimport INFINITY
from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from bfrt.geometry.vector cimport Line
from bfrt.image.film cimport Film
from bfrt.phases.crossings cimport CrossingBuffer, hand_over
from bfrt.phases.in_flight cimport RaysInFlight
from bfrt.phases.nearest cimport ray_bad, ray_line
from bfrt.phases.pending cimport prefetch_ray
from bfrt.phases.ray_records cimport LIGHT, take_over
from bfrt.records cimport NO_HIT, SHADOW, Hit, Queued, Ray
from bfrt.scan.given_order cimport GivenOrder, comes_first
from bfrt.streams.atomic cimport atomic_fetch_add, atomic_load, lock, unlock
from bfrt.tree.candidates cimport Candidates
from bfrt.tree.descent cimport ABREAST, Descent, Source, count_tests, descend_all
from bfrt.tree.forest cimport Forest
from bfrt.tree.pieces cimport TOGETHER, PieceReader
from bfrt.tree.sight cimport heading_of
from bfrt.tree.top cimport MOST_CANDIDATES, Entry, Look, entry_of, next_treelets
from bfrt.tree.walk cimport Piece, Range, Search, aim, look_for_leaves, walk_treelet

from bfrt.records import HIT_BYTES

#: Rays that a thread looks at together, and the bytes of those of them that are complete.
RAYS_AT_ONCE = 2048
RETIRED_BYTES = RAYS_AT_ONCE * HIT_BYTES

cdef enum:
    NO_TREELET = 0xFFFFFFFF
    SOON = 4    # rays of a treelet: so long before it is looked at, each is fetched
    MANY_RAYS = 32  # of a treelet: they come to most of it

# What becomes of `state`: whether a ray has a sentinel, or begins at the first treelet.
cdef enum:
    NEW = 0
    ON = 1
    OVER = 2


cdef inline void begin(Ray* r, double t, uint64_t id, int kind) noexcept nogil:
    """Set up a ray that has not yet met anything."""
    r.t, r.id = t, id
    r.voxel = NO_TREELET
    r.kind = <uint8_t>kind
    r.face = r.lock = 0
    r.state = OVER if ray_bad(r) else NEW


cdef inline void search_for(Search* s, const Ray* r, Forest f) noexcept nogil:
    """Begin a ray's search, with its hit so far."""
    cdef Line l = ray_line(r)
    aim(s, &l, f.padding)
    s.kind, s.id = r.kind, r.id
    s.t = atomic_load(&r.t)


cdef inline void head_for(Search* s, const Ray* r, Forest f) noexcept nogil:
    """Begin a look at nodes alone."""
    cdef Line l = ray_line(r)
    s.line, s.heading = l, heading_of(&l, f.padding)
    s.t = atomic_load(&r.t)


cdef inline void keep(Ray* r, const Search* s) noexcept nogil:
    """Take a search's hit, if it is nearer than the one that the ray has by now."""
    if s.id == NO_HIT:
        return
    lock(&r.lock)
    if s.t < r.t or (
        s.t == r.t and (r.id == NO_HIT or comes_first(<GivenOrder>s.order, s.id, r.id))
    ):
        r.t, r.id = s.t, s.id
    unlock(&r.lock)


@cython.final
cdef class TreeRays(RaysInFlight):
    """Holds rays in flight through a forest, and the loops over them.

    Where a ray is, its `voxel`, is its sentinel: the first treelet of its next pass.

    Parameters
    ----------
    forest : Forest
    capacity : int
        Rays at the most.
    candidates : int
        Candidates of all rays together, when there are `capacity` rays.
    """

    cdef Forest forest
    cdef Candidates candidates

    def __init__(self, Forest forest not None, int64_t capacity, int64_t candidates):
        super().__init__(capacity, Candidates.words(candidates))
        self.forest = forest
        self.candidates = Candidates(forest.treelets)

    @property
    def room(self):
        """Return how many candidates there is room for."""
        return Candidates.room(len(self.free()))

    def admit(self, const Queued[::1] queued, int64_t first, int64_t last):
        """Bring queued rays behind the active ones; return how many are bad, and meet nothing."""
        cdef const Queued* q
        cdef Ray* r
        cdef int64_t i, bad = 0
        with nogil:
            for i in range(first, last):
                q, r = &queued[i], &self.rays[self.active + i]
                take_over(r, &self.paths[self.active + i], &q.ox, &q.pixel)
                begin(r, LIGHT if q.kind == SHADOW else INFINITY, NO_HIT, q.kind)
                bad += r.state == OVER
        return bad

    def admit_again(self, const Hit[::1] asked, int64_t first, int64_t last):
        """Bring rays that have an end of their own, (n,) of records.HIT."""
        cdef const Hit* h
        cdef Ray* r
        cdef int64_t i
        with nogil:
            for i in range(first, last):
                h, r = &asked[i], &self.rays[self.active + i]
                take_over(r, &self.paths[self.active + i], &h.ox, &h.pixel)
                begin(r, h.t, h.id, h.kind)
        return 0

    def begin_pass(self):
        """Begin a pass, with no candidate."""
        self.candidates.begin(self.free())

    def collect(self, int64_t first, int64_t last, int each):
        """Find up to `each` candidates for every ray of a part, and its sentinel.

        Returns
        -------
        int
            Nodes tested.
        """
        cdef Entry found[MOST_CANDIDATES]
        cdef Look look
        cdef Line l
        cdef Ray* r
        cdef int64_t i, at
        cdef int k, n
        look.most, look.node_tests = min(each, MOST_CANDIDATES - 1) + 1, 0
        with nogil:
            for i in range(first, last):
                r = &self.rays[i]
                if r.state == OVER or r.t < 0.0:
                    r.state = OVER
                    continue
                l = ray_line(r)
                look.first.t, look.first.treelet, look.reach = -1.0, 0, r.t
                if r.state == ON:
                    entry_of(&self.forest.top, &l, r.voxel, &look.first)
                n = next_treelets(&self.forest.top, &l, &look, found)
                r.state = OVER
                if n == look.most:
                    n -= 1
                    r.state, r.voxel = ON, found[n].treelet
                at = atomic_fetch_add(&self.candidates.used, n)
                for k in range(n):
                    self.candidates.add(at + k, found[k].treelet, i)
        return look.node_tests

    def by_treelet(self):
        """Return the candidates of the pass, as `Candidates.by_treelet`."""
        return self.candidates.by_treelet()

    def retire(self, int64_t first, int64_t last, Film film, const double[::1] background,
               Hit[::1] hits):
        """Let complete rays of a part go, as `RaysInFlight.let_go`."""
        return self.let_go(first, last, film, background, hits)

    cdef bint complete(self, const Ray* r) noexcept nogil:
        cdef Entry sentinel
        cdef Line line
        if r.state == OVER:
            return True
        line = ray_line(r)
        entry_of(&self.forest.top, &line, r.voxel, &sentinel)
        return r.t < sentinel.t


# Rays in flight that go down a resident forest.
cdef struct Flight:
    void* forest    # a Forest
    Ray* rays
    int64_t next
    int64_t last


cdef bint next_in_flight(void* source, Descent* d) noexcept nogil:
    """Set up the search of the next ray in flight that is not over: then it is."""
    cdef Flight* t = <Flight*>source
    cdef Ray* r
    while t.next < t.last:
        r = t.rays + t.next
        d.row = t.next
        t.next += 1
        if r.state != OVER:
            r.state = OVER
            d.search.mark = <uint32_t>d.row
            search_for(&d.search, r, <Forest>t.forest)
            return True
    return False


cdef void take_in_flight(void* source, const Descent* d) noexcept nogil:
    """Keep a ray's hit."""
    cdef Ray* r = (<Flight*>source).rays + d.row
    if d.search.crossings == NULL:
        r.t, r.id = d.search.t, d.search.id


@cython.final
cdef class TreeIntersector:
    """Runs one worker's loops over treelets and the rays in flight.

    Parameters
    ----------
    forest : Forest
    order : GivenOrder
    room : tuple of 4 int, optional
        Memory for treelets that stream, as `pieces.rooms` returns it.
    """

    cdef Forest forest
    cdef GivenOrder order
    cdef PieceReader pieces
    cdef CrossingBuffer crossings
    cdef Search search
    cdef Descent abreast[ABREAST]
    cdef Flight flight

    def __cinit__(self, Forest forest not None, GivenOrder order not None, room=None):
        cdef int k
        self.forest, self.order = forest, order
        self.pieces = None if forest.resident else PieceReader(forest, room)
        self.search.order, self.flight.forest = <void*>order, <void*>forest
        self.search.spans = forest.top.spans
        self.search.crossings = NULL
        self.search.node_tests = self.search.object_tests = 0
        self.search.polygon_id = NO_HIT
        for k in range(ABREAST):
            self.abreast[k].search = self.search

    def begin(self, CrossingBuffer crossings=None):
        """Begin with nearest hits, or with all."""
        cdef int k
        self.crossings = crossings
        self.search.crossings = NULL if crossings is None else <void*>crossings
        for k in range(ABREAST):
            self.abreast[k].search.crossings = self.search.crossings

    def meet(self, TreeRays rays, const uint32_t[::1] found, const uint32_t[::1] treelets,
             const int64_t[::1] starts):
        """Test rays against the treelets that they enter, one treelet after another.

        Parameters
        ----------
        found : (n,) uint32
            IN. Rays, by treelet.
        treelets : (some,) uint32
            IN.
        starts : (some + 1,) int64
            IN. Where those of each begin.
        """
        cdef int64_t k = 0, last = treelets.shape[0]
        with nogil:
            while k < last:
                k += self.meet_some(rays, found, &treelets[k], &starts[k], last - k)
            if self.crossings is not None:
                hand_over(self.crossings)

    cdef int meet_some(self, TreeRays rays, const uint32_t[::1] found, const uint32_t* treelets,
                       const int64_t* starts, int64_t most) except -1 nogil:
        """Test rays against the first of `most` treelets; return how many there was room for."""
        cdef Range wanted[TOGETHER]
        cdef int count = self.pieces.begin(treelets, most), k, end, first = 0
        for k in range(count):
            wanted[k] = self.look_ahead(
                self.pieces.glance(k), rays, found, starts[k], starts[k + 1]
            )
        while first < count:
            end = self.pieces.read_objects(wanted, first)
            for k in range(first, end):
                if wanted[k].end:
                    self.go_down(self.pieces.whole(k), rays, found, starts[k], starts[k + 1])
            first = end
        return count

    cdef Range look_ahead(self, const Piece* p, TreeRays rays, const uint32_t[::1] found,
                          int64_t first, int64_t end) noexcept nogil:
        """Return what objects of a treelet some rays may come to: all where rays are many."""
        cdef Range wide
        cdef int64_t i
        cdef Ray* r
        wide.begin, wide.end = 0, p.objects if end - first > MANY_RAYS else 0
        if wide.end:
            return wide
        for i in range(first, end):
            prefetch_ray(&rays.rays[found[min(i + SOON, end - 1)]])
            r = &rays.rays[found[i]]
            if r.t >= 0.0:
                head_for(&self.search, r, self.forest)
                look_for_leaves(p, &self.search, &wide)
        return wide

    cdef int go_down(self, const Piece* p, TreeRays rays, const uint32_t[::1] found,
                     int64_t first, int64_t end) except -1 nogil:
        """Test some rays against the objects of a treelet."""
        cdef Search* s = &self.search
        cdef int64_t i
        cdef Ray* r
        for i in range(first, end):
            prefetch_ray(&rays.rays[found[min(i + SOON, end - 1)]])
            s.mark = found[i]
            r = &rays.rays[s.mark]
            if r.t < 0.0:  # a shadow ray that has met something already
                continue
            search_for(s, r, self.forest)
            s.id = NO_HIT  # of another thread's hit the id may belong to an earlier t
            walk_treelet(p, s)
            if s.crossings == NULL:
                keep(r, s)
        return 0

    def descend(self, TreeRays rays, int64_t first, int64_t last):
        """Test rays [first, last) against all that they may meet, of a resident forest."""
        cdef Source source
        self.flight.rays, self.flight.next, self.flight.last = &rays.rays[0], first, last
        source.source, source.next, source.take = &self.flight, next_in_flight, take_in_flight
        with nogil:
            descend_all(self.forest, self.abreast, &source)
            if self.crossings is not None:
                hand_over(self.crossings)

    def tests(self):
        """Return the nodes and the objects tested since the last call."""
        self.abreast[0].search.node_tests += self.search.node_tests
        self.abreast[0].search.object_tests += self.search.object_tests
        self.search.node_tests = self.search.object_tests = 0
        return count_tests(self.abreast)
