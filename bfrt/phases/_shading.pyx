"""The shading loop: local color, and the rays that go on from a hit."""

cimport cython
from libc.math cimport ceil, sqrt
from libc.stdint cimport int64_t, uint16_t, uint32_t, uint64_t

from bfrt.geometry.box cimport Box
from bfrt.geometry.departure cimport hit_error, meets_front
from bfrt.geometry.hemisphere cimport Basis, basis_around, cosine_direction
from bfrt.geometry.power cimport power
from bfrt.geometry.shape cimport Shape, Surface, shape_bounds, shape_load, shape_surface
from bfrt.geometry.vector cimport (
    Line, Vec, add, along, dot, largest, length, line, scale, sub, unit, vec,
)
from bfrt.image.film cimport Film, film_add, film_number
from bfrt.phases.hashing cimport GOLDEN, mixed, uniform
from bfrt.records cimport (
    EYE, INDEX_BITS, REFLECTION, REFRACTION, SHADOW, Hit, Material, Queued,
)
from bfrt.scan.geometry cimport GeometryCursor, next_records, pick_record, vertices_in
from bfrt.scan.column cimport ColumnCursor, next_number, pick_number
from bfrt.scan.scan cimport StreamScan

import numpy as np

from bfrt.errors import StoreError
from bfrt.records import QUEUED

#: Rays that a worker gathers while it shades.
GATHERED = 1024

cdef enum:
    COLUMNS = 7  # of a light: x y z w, red, green, blue

cdef struct Bent:
    bint total   # total internal reflection: there is no refracted ray
    Vec d

# An object that is shaded.
cdef struct Shaded:
    Shape shape
    Box box
    const Material* material
    uint64_t id    # by the order given

# A hit and the surface there, its normals turned to the ray.
cdef struct Interaction:
    const Hit* hit
    uint64_t id    # of the object
    const Material* material
    Surface surface
    Vec d          # the ray's direction, a unit vector
    Vec offset     # from the place to where new rays begin on the ray's side
    bint outside   # whether that is the side of the object's own normal


cdef inline void put(float* out, Vec v) noexcept nogil:
    out[0], out[1], out[2] = <float>v.x, <float>v.y, <float>v.z


cdef inline Vec reflected(Vec d, Vec n) noexcept nogil:
    return along(d, n, -2.0 * dot(d, n))


cdef inline Bent refracted(Vec d, Vec n, double eta) noexcept nogil:
    """Bend unit d at unit n, d.n <= 0, by Snell's law; eta is the index before over that behind."""
    cdef Bent b
    cdef double cosine = -dot(d, n)
    cdef double k = 1.0 - eta * eta * (1.0 - cosine * cosine)
    b.total = k < 0.0
    b.d = vec(0.0, 0.0, 0.0)
    if not b.total:
        b.d = add(scale(d, eta), scale(n, eta * cosine - sqrt(k)))
    return b


@cython.final
cdef class Shader:
    """Shades hits on the objects of a scene, and gathers one worker's outgoing rays.

    Parameters
    ----------
    palette : (materials,) records.MATERIAL
    lighting : bfrt.phases.lighting.Lighting
    viewpoints : bfrt.phases.viewpoints.Viewpoints
        Where Z is measured from, and the view of each element of the film.
    origin : (3,) float64
        The store's, in world coordinates: those of P.
    film : Film
    """

    cdef const Material[::1] palette
    cdef const double[:, :, ::1] lights
    cdef double ambient
    cdef int64_t occlusion  # rays of an eye hit
    cdef double reach       # their length
    cdef const double[:, ::1] eyes
    cdef int64_t across
    cdef Vec origin
    cdef Film film
    cdef Queued[::1] out
    cdef object rays
    cdef object emit
    cdef bint last
    cdef int64_t waiting
    cdef readonly int64_t reflection
    cdef readonly int64_t refraction
    cdef readonly int64_t shadow

    def __cinit__(self, const Material[::1] palette, lighting, viewpoints, origin, Film film):
        self.palette = palette
        self.lights = lighting.lights
        self.ambient = lighting.ambient
        self.occlusion, self.reach = lighting.rays, lighting.reach
        if self.lights.shape[2] != COLUMNS:
            raise ValueError(f"lights: found {self.lights.shape[2]} columns, expected {COLUMNS}")
        self.eyes, self.across = viewpoints.eyes, viewpoints.across
        self.origin = vec(origin[0], origin[1], origin[2])
        self.film = film
        self.out = self.rays = np.empty(GATHERED, QUEUED)

    def begin(self, emit, bint last):
        """Begin with the hits of a depth, of whose rays none is counted yet.

        Parameters
        ----------
        emit : callable
            Called with rays, (n,) of records.QUEUED; must copy.
        last : bool
            The maximum depth is reached: shadow rays only.
        """
        self.emit = emit
        self.last = last
        self.reflection = self.refraction = self.shadow = 0

    def shade(self, StreamScan scan, int64_t n, const Hit[::1] hits):
        """Shade the hits of the next n objects of a scan, all of which are read.

        Parameters
        ----------
        hits : (hits,) records.HIT
            IN. Ascending by id, all among those objects.
        """
        cdef GeometryCursor g = scan.geometry
        cdef ColumnCursor m = scan.materials, ids = scan.ids
        cdef Shaded shaded
        cdef int64_t at = 0, left = n
        cdef uint64_t first = <uint64_t>scan.number << INDEX_BITS
        cdef uint64_t id = first + <uint64_t>g.index
        cdef uint32_t material
        cdef int block, i
        with nogil:
            while left > 0:
                block = next_records(g, left)
                left -= block
                for i in range(block):
                    material = <uint32_t>next_number(m)
                    shaded.id = next_number(ids) | first
                    if at < hits.shape[0] and hits[at].id == id:
                        self.load(
                            g, g.block + i * g.stride, vertices_in(g, i), material, &shaded
                        )
                        at += self.shade_object(&shaded, &hits[at], hits.shape[0] - at)
                    id += 1

    def shade_picked(self, StreamScan scan, const Hit[::1] hits):
        """Shade hits on the objects that the scan picks: only those are read."""
        cdef GeometryCursor g = scan.geometry
        cdef ColumnCursor m = scan.materials, ids = scan.ids
        cdef Shaded shaded
        cdef const unsigned char* record
        cdef uint32_t material
        cdef int64_t at = 0
        with nogil:
            while at < hits.shape[0]:
                material = <uint32_t>pick_number(m)
                shaded.id = pick_number(ids) | <uint64_t>scan.number << INDEX_BITS
                record = pick_record(g)
                self.load(g, record, g.count, material, &shaded)
                at += self.shade_object(&shaded, &hits[at], hits.shape[0] - at)

    cdef int load(self, GeometryCursor g, const unsigned char* record, uint32_t count,
                  uint32_t material, Shaded* shaded) except -1 nogil:
        """Work out an object from its record, of `count` vertices (polygons only)."""
        if material >= self.palette.shape[0]:
            with gil:
                raise StoreError(
                    f"{g.reader.file.path}: found material {material}, "
                    f"expected one of {len(self.palette)}"
                )
        shaded.material = &self.palette[material]
        shape_load(g.kind, record, count, &g.frame, &shaded.shape)
        shape_bounds(&shaded.shape, &shaded.box)
        return 0

    cdef int64_t shade_object(self, const Shaded* shaded, const Hit* hits,
                              int64_t n) except -1 nogil:
        """Shade the first of `hits`, all hits of one object; return how many."""
        cdef int64_t at = 0
        while at < n and hits[at].id == hits[0].id:
            self.shade_hit(&hits[at], shaded)
            at += 1
        return at

    def flush(self):
        """Hand over the rays that wait."""
        if self.waiting:
            self.emit(self.rays[:self.waiting])
            self.waiting = 0

    cdef int shade_hit(self, const Hit* h, const Shaded* shaded) except -1 nogil:
        cdef const Material* m = shaded.material
        cdef Line l = line(vec(h.ox, h.oy, h.oz), vec(h.dx, h.dy, h.dz))
        cdef Interaction i
        cdef Surface* s = &i.surface
        cdef Vec own
        cdef int64_t k, view = 0 if self.lights.shape[0] == 1 else self.view_of(h.pixel)
        i.hit, i.id, i.material = h, shaded.id, m
        i.d = unit(l.d)
        shape_surface(&shaded.shape, &l, h.t, s)
        own = s.shading
        # Two-sided: both normals are turned to the ray, the shading one to the other's side.
        i.outside = meets_front(s, i.d)
        if not i.outside:
            s.geometric = scale(s.geometric, -1.0)
        if dot(s.shading, s.geometric) < 0.0:
            s.shading = scale(s.shading, -1.0)
        if h.kind == EYE:
            self.see(&i, own)
        i.offset = scale(s.geometric, hit_error(&l, h.t, s.place, &shaded.box))
        self.surround(&i)
        for k in range(self.lights.shape[1]):
            self.light(&i, &self.lights[view, k, 0])
        if not self.last and (m.ks > 0.0 or m.transmittance > 0.0):
            self.go_on(&i)
        return 0

    cdef int64_t view_of(self, uint32_t element) noexcept nogil:
        """Return the view that an element of the film is of."""
        if self.eyes.shape[0] == 1:
            return 0
        return film_number(self.film, element) // self.across % self.eyes.shape[0]

    cdef uint64_t number_of(self, uint32_t element) noexcept nogil:
        """Return the number that an element would have if its view were alone."""
        cdef int64_t number = film_number(self.film, element), views = self.eyes.shape[0]
        return number // self.across // views * self.across + number % self.across

    cdef void see(self, const Interaction* i, Vec n) noexcept nogil:
        """Store depth, normal n, id and channels on request, if the hit is of sample 0."""
        cdef const Hit* h = i.hit
        cdef const Material* m = i.material
        cdef Vec p = i.surface.place
        cdef int64_t element = h.pixel - self.film.first
        cdef float* seen = &self.film.depth_normal[element, 0]
        cdef const double* eye
        if h.sample:
            return
        eye = &self.eyes[self.view_of(h.pixel), 0]
        seen[0] = <float>length(sub(p, vec(eye[0], eye[1], eye[2])))
        put(seen + 1, n)
        self.film.ids[element] = i.id
        if self.film.positions.shape[0]:
            put(&self.film.positions[element, 0], add(p, self.origin))
        if self.film.albedos.shape[0]:
            put(&self.film.albedos[element, 0], vec(m.red, m.green, m.blue))

    cdef int surround(self, const Interaction* i) except -1 nogil:
        """Give the ambient light to the film, or send it along rays that may be stopped."""
        cdef const Hit* h = i.hit
        cdef const Material* m = i.material
        cdef Vec color = vec(
            self.ambient * m.kd * m.red * h.red, self.ambient * m.kd * m.green * h.green,
            self.ambient * m.kd * m.blue * h.blue,
        )
        if self.occlusion and largest(color) > 0.0:
            film_add(self.film, h.pixel, 0.0, 0.0, 0.0, h.kind == EYE)
            self.look_around(i, color)
        else:
            film_add(self.film, h.pixel, color.x, color.y, color.z, h.kind == EYE)
        return 0

    cdef int look_around(self, const Interaction* i, Vec color) except -1 nogil:
        """Send the ambient light along shadow rays, each with its part: as dense as their cosine.

        A hit of which less is seen sends less of them, a part of those of an eye hit. Ray k has one
        of as many rings around the normal, and is turned on by the golden ratio: so any number of
        them is spread evenly. A hash of pixel and sample turns them all.
        """
        cdef const Hit* h = i.hit
        cdef const Surface* s = &i.surface
        cdef Basis around = basis_around(s.shading)
        cdef Vec o = add(s.place, i.offset)
        cdef Vec d
        cdef double weight = min(1.0, largest(vec(h.red, h.green, h.blue)))
        # Weights are float32: what is a whole number but for that is no more.
        cdef int64_t k, rays = <int64_t>ceil(weight * self.occlusion * (1.0 - 1.0 / (1 << 20)))
        cdef uint64_t number = self.number_of(h.pixel)
        # 2^32 more than a pixel's: not the numbers that have placed its samples.
        cdef uint64_t seed = mixed(mixed(number + (<uint64_t>1 << 32)) + h.sample)
        color = scale(color, 1.0 / rays)
        for k in range(rays):
            d = cosine_direction(
                &around,
                (k + uniform(mixed(seed + <uint64_t>k))) / rays,
                uniform(seed + <uint64_t>k * GOLDEN),
            )
            if dot(d, s.geometric) < 0.0:  # an interpolated normal would send it into the surface
                d = reflected(d, s.geometric)
            self.send(SHADOW, h, o, scale(d, self.reach), color)
        self.shadow += rays
        return 0

    cdef int light(self, const Interaction* i, const double* light) except -1 nogil:
        """Send a shadow ray that carries what the light adds: Lambert and Phong.

        There is none where the surface faces away from the light (SPD's rule 10). The light is
        that of the place itself: only the shadow ray begins beside it.
        """
        cdef const Hit* h = i.hit
        cdef const Material* m = i.material
        cdef const Surface* s = &i.surface
        cdef Vec lamp = vec(light[0], light[1], light[2])
        cdef Vec way = sub(lamp, scale(s.place, light[3]))
        cdef Vec o = add(s.place, i.offset)
        cdef Vec to, color
        cdef double diffuse, specular = 0.0
        if not (dot(way, s.geometric) > 0.0 and dot(way, s.shading) > 0.0):
            return 0
        to = unit(way)
        diffuse = m.kd * dot(to, s.shading)
        if m.ks > 0.0:
            specular = m.ks * power(dot(reflected(i.d, s.shading), to), m.shine)
        color = vec(
            light[4] * (diffuse * m.red + specular) * h.red,
            light[5] * (diffuse * m.green + specular) * h.green,
            light[6] * (diffuse * m.blue + specular) * h.blue,
        )
        self.send(SHADOW, h, o, sub(lamp, scale(o, light[3])), color)
        self.shadow += 1
        return 0

    cdef int go_on(self, const Interaction* i) except -1 nogil:
        """Send a reflection ray, and where light passes a refraction ray (SPD's rules 8 and 9)."""
        cdef const Material* m = i.material
        cdef const Surface* s = &i.surface
        cdef Vec light = vec(i.hit.red, i.hit.green, i.hit.blue)
        cdef Vec r = reflected(i.d, s.shading)
        cdef double weight = m.ks
        cdef double ior = m.ior if m.ior > 0.0 else 1.0
        cdef double eta = 1.0 / ior if i.outside else ior
        cdef Bent b
        if m.transmittance > 0.0:
            b = refracted(i.d, s.shading, eta)
            if not b.total and dot(b.d, s.geometric) >= 0.0:  # it would come out on the ray's side
                b = refracted(i.d, s.geometric, eta)
            if b.total:
                weight += m.transmittance
            else:
                self.send(
                    REFRACTION, i.hit, sub(s.place, i.offset), b.d, scale(light, m.transmittance)
                )
                self.refraction += 1
        if dot(r, s.geometric) <= 0.0:  # an interpolated normal would send it into the surface
            r = reflected(i.d, s.geometric)
        self.send(REFLECTION, i.hit, add(s.place, i.offset), r, scale(light, weight))
        self.reflection += 1
        return 0

    cdef int send(self, uint16_t kind, const Hit* h, Vec o, Vec d, Vec color) except -1 nogil:
        """Send a ray on from a hit."""
        cdef Queued* q
        if self.waiting == self.out.shape[0]:
            with gil:
                self.flush()
        q = &self.out[self.waiting]
        q.ox, q.oy, q.oz = o.x, o.y, o.z
        q.dx, q.dy, q.dz = d.x, d.y, d.z
        q.pixel, q.sample, q.kind, q.power = h.pixel, h.sample, kind, 0
        q.red, q.green, q.blue = <float>color.x, <float>color.y, <float>color.z
        self.waiting += 1
        return 0
