"""The exactness rules, DESIGN section 4: one test each, named after what its rule says.

d is 2^-30 of the diagonal of the scene's bounds. "Both" are the fast path and the slow twin.
"""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
from boxes import boxes_of
from one_object import meet, outside, rays_through
from scenes import flat_scene, joined, lattice_scene, random_objects, random_rays, units

from bfrt.grid.grid import Grid
from bfrt.grid.partition import partition, resolution
from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.image.film import Film
from bfrt.phases import preprocess, traversal
from bfrt.phases._traversal import RayPool
from bfrt.phases.eye import EyeRays
from bfrt.phases.outliers import Outliers
from bfrt.phases.preprocess import grid_of, padding_of
from bfrt.records import HIT, INDEX_BITS, RAY, Kind, RayKind
from bfrt.reference import _kernels, exhaustive, independent
from bfrt.reference.independent import Objects, agree, stable
from bfrt.scan.given_order import GivenOrder
from bfrt.store.model import Camera
from bfrt.workers import Workers

ORIGIN = (0.0, 0.0, 0.0)
START, UP = 6, 2  # faces: none, and that below
NOWHERE = 0xFFFFFFFF


def rays_of(rng, objects, n, *sorts):
    rays = random_rays(rng, objects, n)
    chosen = [rays[sort] for sort in sorts or rays]
    return tuple(np.concatenate(some) for some in zip(*chosen, strict=True))


def check_both(store, origins, directions, scratch, capacities=fast.ROOMY):
    """The two paths agree bit for bit; returns t."""
    t, ids = exhaustive.nearest(store, origins, directions)
    found = fast.nearest(store, origins, directions, scratch, capacities)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.ids, ids)
    return t


def check_oracle(objects, store, origins, directions):
    """The slow twin agrees with the oracle; returns how many rays were compared."""
    expected = independent.nearest(objects, origins, directions)
    t, ids = exhaustive.nearest(store, origins, directions)
    mask = stable(objects, origins, directions, *expected)
    assert agree(*expected, t, ids, mask).wrong == 0
    return mask.sum()


def spans(box, padding, origins, directions):
    boxes = np.tile(np.array(box, np.float32), (len(origins), 1))
    return _kernels.spans(boxes, padding, np.ascontiguousarray(origins), directions)


def one_record(kind, objects):
    """The numbers of the first object."""
    if kind == Kind.POLYGON:
        return objects.vertices[: objects.counts[0]]
    tables = (objects.spheres, objects.cones, objects.triangles, objects.patches)
    return tables[kind][0]


def test_rule_1_a_hit_counts_within_the_span_of_the_grown_box(tmp_path):
    """Seen edge on, the t of a flat kind is noise: it is brought into the box, and of a round one
    that is outside of the box it is no hit."""
    rng = np.random.default_rng(1)
    brought = kept = 0
    for _ in range(600):
        corners = rng.normal(size=(3, 3))
        box = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
        weight = rng.uniform(-3, 3, (400, 2))
        in_plane = corners[0] + weight @ (corners[1:] - corners[0])
        directions = rng.normal(size=(400, 2)) @ (corners[1:] - corners[0])
        origins = in_plane - 3 * directions
        padding = 2.0**-30 * np.linalg.norm(box[3:] - box[:3])
        alone = meet(Kind.TRIANGLE, corners, origins, directions)
        ruled = meet(Kind.TRIANGLE, corners, origins, directions, padding)
        near, far = spans(alone.box, padding, origins, directions).T
        inside = np.clip(alone.t, near, far)
        met = alone.hit & (near <= far) & (inside > 0)
        np.testing.assert_array_equal(ruled.t, np.where(met, inside, np.inf))
        brought += (met & (inside != alone.t)).sum()
        kept += met.sum()
    assert brought > 10
    assert kept > 1000
    # Every kernel keeps to the span: a box shrunk by a fifth shows it.
    for kind in Kind:
        record = one_record(kind, random_objects(rng, 3, [kind], spread=0.1, size=4.0))
        box = meet(kind, record, [[0, 0, 0]], [[0, 0, 1]]).box
        shrink = -0.2 * float((box[3:] - box[:3]).min())
        origins, directions = rays_through(rng, box, 2000)
        alone = meet(kind, record, origins, directions)
        ruled = meet(kind, record, origins, directions, shrink)
        near, far = spans(alone.box, shrink, origins, directions).T
        within = (near <= alone.t) & (alone.t <= far)
        np.testing.assert_array_equal(ruled.t[within], alone.t[within])
        rest = ruled.t[ruled.hit]
        assert ((near[ruled.hit] <= rest) & (rest <= far[ruled.hit])).all()
        assert (alone.hit & ~within).sum() > 50
    # Both take the same d: seen edge on, where d is as large as the objects, nonsense is anywhere.
    size = 2.0**-29
    corners = rng.normal(size=(20, 3, 3)) * size
    objects = Objects(triangles=corners.reshape(-1, 9), spheres=[[1, 0, 0, 0.1]])
    store = fast.gridded(fast.write(fast.stored(objects), tmp_path / "tiny.bfrt", origin=ORIGIN))
    owner = rng.integers(20, size=8000)
    edges = corners[owner, 1:] - corners[owner, :1]
    directions = np.einsum("ij,ijk->ik", rng.normal(size=(8000, 2)), edges)
    beside = np.einsum("ij,ijk->ik", rng.uniform(-3, 3, (8000, 2)), edges)
    origins = corners[owner, 0] + beside - 3 * directions
    check_both(store, origins, directions, tmp_path)
    # And d is enough: walls that their boxes fit tightly are hit wherever the oracle hits them.
    objects = fast.stored(joined(lattice_scene(rng), flat_scene(rng, 30)))
    store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
    origins, directions = rays_of(rng, objects, 60)
    assert check_oracle(objects, store, origins, directions) > 300
    check_both(store, origins, directions, tmp_path)


def test_rule_2_slabs_and_crossings_are_one_expression(tmp_path):
    """(plane - o) inv with inv = 1 / d, to the last bit, in boxes and in walks alike."""
    rng = np.random.default_rng(2)
    grid = Grid(rng.normal(size=3) - 5, rng.normal(size=3) + 5, (11, 7, 13), 1e-9)
    planes = grid.tables
    origins = rng.normal(size=(400, 3)) * 8
    directions = rng.normal(size=(400, 3)) * 3 - origins
    inv = 1.0 / directions
    box = np.float32([-1.1, -2.2, -3.3, 1.3, 2.1, 3.7])
    found = spans(box, 0.125, origins, directions)
    low, high = box[:3].astype(float) - 0.125, box[3:].astype(float) + 0.125
    a, b = (low - origins) * inv, (high - origins) * inv
    near = np.maximum(np.minimum(a, b).max(axis=1), 0.0)
    far = np.maximum(a, b).min(axis=1)
    met = near <= far
    assert 50 < met.sum() < 350
    np.testing.assert_array_equal(found[met], np.column_stack([near, far])[met])
    assert np.isinf(found[~met]).all()
    steps = 0
    for origin, direction, times in zip(origins, directions, inv, strict=True):
        for voxel, face, t in grid.walk(origin, direction):
            k = face % 3
            at = (voxel % 11, voxel // 11 % 7, voxel // 77)[k]
            if face != START:
                assert t == (planes[k][at + (direction[k] < 0)] - origin[k]) * times[k]
                steps += 1
    assert steps > 2000


def test_rule_3_a_range_is_that_of_the_box_grown_by_2d(tmp_path):
    """By the table of planes: a box that ends on a plane is in the voxels of both sides."""
    padding = 2.0**-20
    grid = Grid([0.0] * 3, [8.0] * 3, (8, 8, 8), padding)
    for near_plane in (0.0, 1.5 * padding, -1.5 * padding):
        box = [float(np.float32(grid.tables[k][i] + s * near_plane))
               for i, s in ((3, 1), (5, -1)) for k in range(3)]  # fmt: skip
        first, last = grid.range_of(box)
        for k, planes in enumerate(grid.tables):
            assert planes[first[k]] <= box[k] - 2 * padding
            assert planes[last[k] + 1] > box[3 + k] + 2 * padding
            assert (first[k], last[k]) == (2, 5)
    # So no ray through corners of the grid slips past what ends there.
    rng = np.random.default_rng(3)
    objects = fast.stored(lattice_scene(rng))
    store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
    rays = rays_of(rng, objects, 300, "along an axis from a corner of the grid",
                   "through two corners of the grid", "at a corner of the grid")  # fmt: skip
    for voxels in (8**3, 16**3, 4**3):
        check_both(
            store,
            *rays,
            tmp_path,
            fast.limited(replace(fast.ROOMY, candidates=1 << 14), voxels=voxels),
        )


def test_rule_4_an_axis_without_direction_never_steps(tmp_path):
    """The ray is inside where lo <= o <= hi, ends included; also where 1 / d overflows."""
    box = [-1, -1, -1, 1, 1, 1]
    padding = 2.0**-30
    edge = 1.0 + padding
    for zero in (0.0, -0.0, 1e-310, -1e-310):
        origins = np.array([[-3, y, 0] for y in (
            edge, np.nextafter(edge, 2), -edge, np.nextafter(-edge, -2), 0.5)])  # fmt: skip
        directions = np.tile([1.0, zero, zero], (5, 1))
        found = spans(box, padding, origins, directions)
        np.testing.assert_array_equal(np.isfinite(found[:, 0]), [True, False, True, False, True])
        assert (found[np.isfinite(found)].reshape(-1, 2) == [2 - padding, 4 + padding]).all()
        grid = Grid([0.0] * 3, [8.0] * 3, (8, 8, 8), padding)
        for y in (grid.tables[1][3], 2.5):  # on a plane, and between two
            way = grid.walk([-1.0, y, y], [1.0, zero, -zero])
            at = np.array([(v % 8, v // 8 % 8, v // 64) for v, _, _ in way])
            row = 3 if y == grid.tables[1][3] else 2
            np.testing.assert_array_equal(at, [(x, row, row) for x in range(8)])
    rng = np.random.default_rng(4)
    objects = fast.stored(lattice_scene(rng))
    store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
    sorts = ("along an axis from a corner of the grid", "almost parallel", "in a plane of the grid")
    check_both(store, *rays_of(rng, objects, 200, *sorts), tmp_path)


def test_rule_5_the_grid_spans_the_grown_boxes_and_walks_start_where_they_are(tmp_path):
    rng = np.random.default_rng(5)
    objects = fast.stored(flat_scene(rng, 40))
    store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
    (group,) = store.groups
    d = padding_of(store)
    assert d == 2.0**-30 * store.bounds.diagonal
    grid = grid_of(store, group, resolution(group.grid_bounds, 4000))
    low, high = ([p[end] for p in grid.tables] for end in (0, -1))
    assert (low <= group.grid_bounds.lo - 2 * d).all()
    assert (high >= group.grid_bounds.hi + 2 * d).all()
    # The start: its crossings bracket it, where a position computed from t would be a voxel off.
    grid = Grid([-1.0] * 3, [1.0] * 3, (40, 40, 40), 2.0**-30)
    off = 0
    corners = np.column_stack([rng.choice(p, 4000) for p in grid.tables])
    corners[:, 0] = grid.tables[0][0]  # rays that come in by grid lines of a face
    ways = units(rng, 4000) * [1, 0.3, 0.3] * 10.0 ** rng.uniform(-3, 3, (4000, 1))
    ways[:, 0] = np.abs(ways[:, 0])
    for corner, way in zip(corners, ways, strict=True):
        origin = corner - 7 * way
        walk = grid.walk(origin, way)
        if not walk:
            continue
        voxel, _, t = walk[0]
        at = (voxel % 40, voxel // 40 % 40, voxel // 1600)
        for k in range(3):
            a, b = ((grid.tables[k][at[k] + e] - origin[k]) * (1 / way[k]) for e in (0, 1))
            assert min(a, b) <= t <= max(a, b)
            x = origin[k] + t * way[k]
            guess = np.searchsorted(grid.tables[k], x, side="right") - 1
            off += guess != at[k]
    assert off > 100


def test_rule_6_far_origins_are_advanced(tmp_path):
    """Not to the bounds but to before them, or what lies in the bounds would be lost."""
    rng = np.random.default_rng(6)
    for objects in (flat_scene(rng, 60), lattice_scene(rng), random_objects(rng, 80, size=3.0)):
        objects = fast.stored(objects)
        store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
        low, high = store.bounds
        target = rng.uniform(low, high, (40, 3))
        compared = 0
        for exponent in (10, 15.9, 16.1, 18, 20, 21, 24, 28, 60, 900):
            for way in (units(rng, 40), np.eye(3)[rng.integers(3, size=40)]):
                origins = target - 2.0**exponent * store.bounds.diagonal * way
                check_both(store, origins, way, tmp_path)
                if exponent < 30:
                    compared += check_oracle(objects, store, origins, way)
        assert compared > 300
    # Exactly: along an axis nothing is lost, however far; the t is that of the whole way.
    ball = fast.write(Objects(spheres=[[0, 0, 0, 1]]), tmp_path / "ball.bfrt", origin=ORIGIN)
    for distance in (2.0**20, 2.0**40, 2.0**51):
        origins, way = [[-distance, 0.0, 0.0]], [[1.0, 0.0, 0.0]]
        assert check_both(ball, origins, way, tmp_path)[0] == distance - 1
        near, moved = exhaustive.advanced(ball, origins, way)
        assert -8 < near[0, 0] < -2
        assert moved[0] == near[0, 0] + distance
    for origin, way in (((-1e30, 0, 0), (1, 0, 0)), ((0, 0, 1e200), (0, 0, -1e-3))):
        assert -8 < exhaustive.advanced(ball, [origin], [way])[0].min() < 8
        t = check_both(ball, [origin], [way], tmp_path)
        assert t[0] == np.abs(origin).max() / np.abs(way).max()
    away = exhaustive.advanced(ball, [[-1e30, 0, 0]], [[-1.0, 0, 0]])
    assert (away[0][0, 0], away[1][0]) == (-1e30, 0.0)
    # Eye rays, too.
    camera = Camera(eye=(0, -1e12, 0), at=(0, 0, 0), angle=1e-10, resolution=(4, 4))
    eye = EyeRays(ball, [camera], 0).read(25)
    assert (np.abs(eye["oy"]) < 100).all()


def test_rule_7_a_voxel_and_a_face_are_the_whole_state(tmp_path, monkeypatch):
    rng = np.random.default_rng(7)
    grid = Grid([-1.0] * 3, [1.0] * 3, (9, 10, 11), 1e-9)
    resumed = 0
    for origin, way in zip(rng.uniform(-1, 1, (90, 3)), units(rng, 90), strict=True):
        walk = grid.walk(origin, way)
        for k in range(len(walk)):
            assert grid.walk(origin, way, *walk[k][:2]) == walk[k:]
            resumed += 1
    assert resumed > 500
    # A pass each candidate, with as many hand-overs as there can be, finds the same.
    objects = fast.stored(random_objects(rng, 500, spread=3.0, size=0.4))
    store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
    rays = rays_of(rng, objects, 30)
    once = fast.nearest(store, *rays, tmp_path)
    monkeypatch.setattr(traversal, "quota", lambda *_, **__: 1)
    capacities = fast.limited(fast.ROOMY, voxels=20**3)
    many = fast.nearest(store, *rays, tmp_path, capacities)
    np.testing.assert_array_equal(many.ids, once.ids)
    np.testing.assert_array_equal(many.t, once.t)
    assert many.counters.passes > once.counters.passes


def walker(t, voxel, face):
    """A pool with a ray on its way up through the middle of a grid, its nearest hit so far at
    t."""
    pool = RayPool(1, 8)
    rays, _ = pool.all
    rays[:] = np.zeros(1, RAY)
    rays[["ox", "oy", "oz", "dz"]] = (0.5, 0.5, -1.0, 1.0)
    rays[["t", "voxel", "face", "kind"]] = (t, voxel, face, RayKind.REFLECTION)
    pool.come(1)
    return pool


def walked(pool, grid, marks, quota):
    """How many candidates a ray finds in the one brick of a grid of 1 x 1 x 8 voxels."""
    bricks = np.zeros((1, 512), np.uint8)
    bricks[0, ::64] = marks
    workers = Workers(1)
    slabs = Slabs(grid, OneBrick(bricks), 512, workers)
    slabs.load(0)
    pool.enter_grid()
    pool.keep_order()
    pool.begin_walk(0, quota)
    assert pool.walk(0, 1, slabs, VoxelRays(grid.shape))[0] == 0
    return pool.stored


class OneBrick:
    """Marks of a grid of one brick."""

    occupied = np.ones((1, 1, 1), np.uint8)
    first = np.array([0, 1])
    at = np.array([0, 512])

    def __init__(self, bricks):
        self.bricks = bricks

    def read(self, layer, out):
        out[:] = self.bricks


def test_rule_8_what_ties_is_met(tmp_path, monkeypatch):
    """A box that begins at the very t of the hit is not culled, nor a voxel that does."""
    # So far out the diagonal's d is less than a unit in the last place: boxes begin where their
    # objects do. A wall, an outlier and so met first, coincides with plates in the grid, whose ids
    # are less.
    monkeypatch.setattr(preprocess, "ROUNDED", 0.0)
    far = 2.0**30
    square = np.array([[-1.0, -1, far], [1, -1, far], [1, 1, far], [-1, 1, far]])
    plates = np.concatenate([square[[0, 1, 2]], square[[0, 2, 3]]]).reshape(-1, 9)
    wall = square * [8, 8, 1]
    objects = Objects(triangles=np.tile(plates, (3, 1)), vertices=wall, counts=[4])
    store = fast.write(objects, tmp_path / "s.bfrt", np.float32)
    (group,) = store.groups
    group = replace(group, outliers=[Kind.POLYGON << INDEX_BITS])
    store = replace(store, groups=[group])
    assert far + padding_of(store) == far
    x = np.linspace(-0.9, 0.8, 7)
    origins = np.column_stack([x, x * 0.5, np.full(7, far + 0.5)])
    directions = np.tile([0, 0, -1.0], (7, 1))
    assert (check_both(store, origins, directions, tmp_path) == 0.5).all()
    assert (exhaustive.nearest(store, origins, directions)[1] >> INDEX_BITS == Kind.TRIANGLE).all()

    # The voxel at z = 3 is entered at t = 4.
    grid = Grid([0.0] * 3, [1.0, 1.0, 8.0], (1, 1, 8), 0.0)
    marks = np.full(8, 1 << UP, np.uint8)
    for t, found, sentinel in ((4.0, 4, NOWHERE), (np.nextafter(4.0, 3.0), 3, NOWHERE)):
        pool = walker(t, 0, UP)
        assert walked(pool, grid, marks, 8) == found
        assert pool.in_flight["voxel"][0] == sentinel
    pool = walker(4.0, 0, UP)
    assert walked(pool, grid, marks, 3) == 3
    assert pool.in_flight["voxel"][0] == 3
    for t, left in ((4.0, 1), (np.nextafter(4.0, 3.0), 0)):
        film, hits = Film(1, 1, 1), np.zeros(1, HIT)
        assert walker(t, 3, UP).retire(0, 1, grid, film, np.zeros(3), hits)[0] == left
    # On its way in, too, when it has met an outlier.
    marks[:3] = 0
    for height, voxel in ((3.0, 3), (np.nextafter(np.float32(3.0), np.float32(0.0)), NOWHERE)):
        objects = Objects(vertices=wall * [1, 1, 0] + [0, 0, height], counts=[4])
        store = fast.write(objects, tmp_path / "wall.bfrt", np.float32)
        outliers = Outliers(
            store, replace(store.groups[0], outliers=[Kind.POLYGON << INDEX_BITS]), GivenOrder([])
        )
        queued = fast.queued([[0.5, 0.5, -1.0]], [[0.0, 0.0, 1.0]], RayKind.REFLECTION)
        pool = RayPool(1, 8)
        pool.admit(queued, 0, 1, grid, outliers)
        pool.come(1)
        assert walked(pool, grid, marks, 0) == 0
        (ray,) = pool.in_flight
        assert (ray["t"], ray["voxel"]) == (height + 1.0, voxel)


def test_rule_9_bounds_contain_what_kernels_return(tmp_path):
    """Polygons that are not flat; and small round things far away keep their digits."""
    rng = np.random.default_rng(9)
    beyond = 0.0
    for _ in range(30):
        vertices = rng.normal(size=(int(rng.integers(4, 9)), 3))
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        probe = np.concatenate([low - 1, high + 1])
        met = meet(Kind.POLYGON, vertices, *rays_through(rng, probe, 2000), 0.0)
        points = met.points[met.hit]
        assert outside(met.box, points).max(initial=0) <= 1e-12
        beyond = max(beyond, outside([*low, *high], points).max(initial=0))
    assert beyond > 0.1
    for kind in Kind:
        objects = fast.stored(random_objects(rng, 200, [kind], size=0.02))
        store = fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN)
        target = objects.bounds()[0] + rng.random((300, 3)) * np.ptp(objects.bounds(), axis=0)
        if kind in (Kind.SPHERE, Kind.CONE):
            table = objects.spheres if kind == Kind.SPHERE else objects.cones
            target = table[rng.integers(len(table), size=300), :3] + 0.002 * units(rng, 300)
        way = units(rng, 300)
        for distance in (10.0, 1e3, 1e5):
            assert check_oracle(objects, store, target - distance * way, way) > 150


def test_rule_10_each_ray_meets_each_box_once(tmp_path):
    """Faces are decided by the whole range, not by the part at hand, or entries are met again.

    Boxes of many voxels each, and rays that hit nothing, so that none is cut short: the tests that
    were made are the pairs of ray and box whose voxels the ray comes through.
    """
    rng = np.random.default_rng(10)
    kinds = [Kind.TRIANGLE, Kind.POLYGON, Kind.CONE, Kind.PATCH, Kind.SPHERE]
    objects = fast.stored(random_objects(rng, 60, kinds, spread=4.0, size=4.0))
    store = fast.gridded(fast.write(objects, tmp_path / "s.bfrt", origin=ORIGIN))
    (group,) = store.groups
    # Rays that begin inside and outside.
    origins, directions = rays_of(rng, objects, 150, "random", "along an axis", "from inside")
    free = np.isinf(exhaustive.nearest(store, origins, directions)[0])
    origins, directions = origins[free], directions[free]
    assert len(origins) > 50
    for voxels in (1, 5**3, 20**3, 40**3):
        capacities = fast.limited(fast.ROOMY, voxels=voxels)
        cut = partition(group.grid_bounds, 1 << 30, capacities.limits)
        grid = grid_of(store, group, cut.shape)
        for refine in ("sg", "sgb"):
            boxes = boxes_of(store, quantised=refine == "sgb")
            found = fast.nearest(store, origins, directions, tmp_path, capacities, refine)
            assert found.counters.box_tests == pairs(grid, boxes, origins, directions)


def pairs(grid, boxes, origins, directions):
    """How many (ray, box) there are where the ray's way leads through the box's voxels."""
    nx, ny, _ = grid.shape
    ranges = np.array([grid.range_of(box) for box in boxes])
    count = 0
    for origin, direction in zip(origins, directions, strict=True):
        way = np.array([step[0] for step in grid.walk(origin, direction)], np.int64)
        at = np.column_stack([way % nx, way // nx % ny, way // (nx * ny)])[:, None]
        inside = ((ranges[:, 0] <= at) & (at <= ranges[:, 1])).all(axis=2)
        count += int(inside.any(axis=0).sum())
    return count
