"""Ray queries against other programs: Open3D's RaycastingScene and trimesh with embreex.

::

    a mesh, rays, float32 ─► bfrt, float64 throughout ─┐
                          └► a peer, Embree's float32 ─┴► differ? ─► Möller and Trumbore, float64:
                                                                     bfrt is right, and the peer
                                                                     is within float32's rounding

Both peers see the same float32 numbers and trace with Embree. Of the rays on which two programs
differ, a brute force tells which triangles they meet, where, and how far inside its edges. What a
program says is permitted if rounding by so much could make it say so: for bfrt `FLOAT64`, for a
peer `FLOAT32`.

Where they mean different things:

- a miss is -1 here, INVALID_ID in Open3D, and no row in trimesh; t is inf;
- a ray that begins on a triangle hits it in Open3D, not here (nor is a hit at t_min one);
- all hits of a ray are in order here, in none in Open3D, and one behind the other in trimesh;
- of hits at one t that share an edge Open3D may tell of one only, and trimesh may step past some;
- trimesh has neither t nor uv nor an end of rays.
"""

from __future__ import annotations

import functools
import importlib
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import bfrt
from bfrt.records import Kind

RAYS = 100_000
AT_EDGES = 400
LISTED = 20_000  # of them, those of which all hits are found
T_FAR = 0.75

#: What float32 may shift a line or a point by, times how far away from the ray's origin the mesh's
#: far end is.
FLOAT32 = 16 * float(np.finfo(np.float32).eps)
#: The same of float64. What is nearer to an edge than this is nobody's error.
FLOAT64 = 64 * float(np.finfo(np.float64).eps)


# --- meshes and rays ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (v, 3) float32 and faces (n, 3); `starts`: where each geometry's faces begin;
    `closed`: whether it is a surface around the origin, all of which is seen from there."""

    vertices: np.ndarray
    faces: np.ndarray
    starts: tuple[int, ...] = (0,)
    closed: bool = False

    @property
    def corners(self):
        return self.vertices[self.faces]

    def geometries(self):
        return np.split(self.faces, self.starts[1:])

    def numbered(self, geometries, primitives, missed):
        """Geometry and place there, as one number among all faces; -1 where it is a miss."""
        first = np.array(self.starts)[np.where(missed, 0, geometries).astype(np.int64)]
        return np.where(missed, -1, first + primitives.astype(np.int64))


def soup(rng):
    """Random triangles in a cube, in two geometries."""
    corners = rng.uniform(-1, 1, (20_000, 1, 3)) + rng.uniform(-0.05, 0.05, (20_000, 3, 3))
    faces = np.arange(60_000).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3).astype(np.float32), faces, (0, 7_000))


def squares(grid):
    """Two triangles for each square of a grid of the indices of vertices."""
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def field_of_hills(rng):
    """A height field."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, 101)] * 2, indexing="ij")
    z = 0.2 * np.sin(5 * x) * np.cos(7 * y) + rng.uniform(0, 0.02, x.shape)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    return Mesh(vertices, squares(np.arange(101 * 101).reshape(101, 101)))


def ball(rng):
    """A closed sphere with bumps: a cube of 6 grids, blown up; its centre sees all of it."""
    n = 41
    i, j = np.meshgrid(*[np.arange(-n, n + 1, 2)] * 2, indexing="ij")
    grids = []
    for axis in range(3):
        for side in (-n, n):
            points = np.stack([np.full_like(i, side), i, j], axis=-1)
            points = points if side > 0 else points.swapaxes(0, 1)
            grids.append(np.roll(points, axis, axis=-1))
    grid, index = np.unique(np.reshape(grids, (-1, 3)), axis=0, return_inverse=True)
    faces = np.concatenate([squares(grid) for grid in index.reshape(6, n + 1, n + 1)])
    directions = grid / np.linalg.norm(grid, axis=1, keepdims=True)
    bumps = 1 + 0.15 * np.prod(np.sin(9 * directions + [0, 1, 2]), axis=1)
    return Mesh((directions * bumps[:, None]).astype(np.float32), faces, closed=True)


MESHES = {"soup": soup, "field": field_of_hills, "ball": ball}


def rays_through(mesh, rng):
    """From outside and inside, long and short, and along the axes; in no order."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    quarter = RAYS // 4
    inside = rng.uniform(low, high, (4, quarter, 3))
    outside = rng.normal(size=(quarter, 3))
    outside *= 4 / np.linalg.norm(outside, axis=1, keepdims=True)
    axes = np.zeros((quarter, 3))
    axes[np.arange(quarter), rng.integers(0, 3, quarter)] = rng.choice([-3.0, 0.5, 1.0], quarter)
    along = inside[3] - np.where(rng.random(quarter) < 0.5, 4.0, 0.0)[:, None] * axes
    origins = np.concatenate([outside, inside[0], inside[1], along])
    directions = np.concatenate(
        [inside[2] - outside, rng.normal(size=(quarter, 3)), inside[2] - inside[1], axes]
    )
    order = rng.permutation(RAYS)
    return origins[order].astype(np.float32), directions[order].astype(np.float32)


def rays_at_edges(mesh, n=AT_EDGES):
    """At points of edges, vertices among them, as near as float32 comes: from outside, and from
    the middle."""
    rng = np.random.default_rng(2)
    corners = mesh.corners[rng.integers(0, len(mesh.faces), n)].astype(np.float64)
    weights = rng.random((n, 1)) * (rng.random((n, 1)) < 0.7)
    ends = corners[:, 0] + weights * (corners[:, 1] - corners[:, 0])
    origins = rng.normal(size=(n, 3))
    origins *= 4 / np.linalg.norm(origins, axis=1, keepdims=True)
    origins[::2] = 0.0
    origins = origins.astype(np.float32)
    return origins, (ends - origins).astype(np.float32)


# --- answers -----------------------------------------------------------------------------------


@dataclass
class Answers:
    """What a program says of rays; None is what it is not asked.

    `ids` are numbers among all faces, -1 for a miss. `pairs` are all hits of the first `LISTED`
    rays, ray and id, ascending, `depths` their t, and `counts` how many a program counts.
    """

    t: np.ndarray
    ids: np.ndarray
    occluded: np.ndarray
    pairs: np.ndarray
    depths: np.ndarray
    counts: np.ndarray
    normals: np.ndarray | None = None
    uvs: np.ndarray | None = None
    nearly: np.ndarray | None = None  # occluded before T_FAR


def ascending(rays, ids, t):
    """`pairs` and `depths` of all hits, each once."""
    both = np.stack([rays, ids], axis=1).astype(np.int64)
    pairs, first = np.unique(both, axis=0, return_index=True)
    return pairs, t[first]


def ask_bfrt(scene, mesh, origins, directions, **settings):
    """Ask all four questions, whose answers must fit together."""
    nearest = scene.cast_rays(origins, directions, **settings)
    some = origins[:LISTED], directions[:LISTED]
    every = scene.list_intersections(*some, **settings)
    splits = every["ray_splits"]
    first = splits[:-1][np.diff(splits) > 0]
    listed = every["ray_ids"][first]
    expected = nearest["t_hit"][:LISTED][listed]
    # A triangle whose edge a ray meets is hit, and not listed where another owns that point.
    u, v = nearest["primitive_uvs"][:LISTED][listed].T
    inner = np.minimum(np.minimum(u, v), 1 - u - v) > 1e-6
    assert (every["t_hit"][first] >= expected).all()
    np.testing.assert_array_equal(every["t_hit"][first][inner], expected[inner])
    missed = nearest["primitive_ids"] < 0
    np.testing.assert_array_equal(nearest["geometry_ids"] < 0, missed)
    assert (nearest["geometry_ids"][~missed] % 16 == Kind.TRIANGLE).all()
    groups = nearest["geometry_ids"] // 16, every["geometry_ids"] // 16
    found = mesh.numbered(groups[1], every["primitive_ids"], np.False_)
    pairs, depths = ascending(every["ray_ids"], found, every["t_hit"])
    assert len(pairs) == len(found)  # none of them twice
    ordered = np.lexsort((found, every["t_hit"], every["ray_ids"]))
    np.testing.assert_array_equal(ordered, np.arange(len(found)))
    answers = Answers(
        t=nearest["t_hit"],
        ids=mesh.numbered(groups[0], nearest["primitive_ids"], missed),
        occluded=scene.occluded(origins, directions, **settings)["occluded"],
        pairs=pairs,
        depths=depths,
        counts=scene.count_intersections(*some, **settings)["counts"],
        normals=nearest["primitive_normals"],
        uvs=nearest["primitive_uvs"],
        nearly=scene.occluded(origins, directions, t_max=T_FAR, **settings)["occluded"],
    )
    np.testing.assert_array_equal(answers.occluded, ~missed)
    np.testing.assert_array_equal(answers.nearly, answers.t < T_FAR)
    np.testing.assert_array_equal(answers.counts, np.diff(splits))
    return answers


def load(name):
    """A peer's module; skips where it is not there, or wants a library that is not."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        pytest.skip(f"{name} is not there, of the extra 'peers': {error}")


def ask_open3d(mesh, origins, directions):
    """Open3D: misses are inf and INVALID_ID, all hits of a ray come in no order."""
    geometry = load("open3d.t.geometry")
    scene = geometry.RaycastingScene()
    for faces in mesh.geometries():
        scene.add_triangles(mesh.vertices, faces.astype(np.uint32))
    rays = np.hstack([origins, directions])
    nearest = {key: value.numpy() for key, value in scene.cast_rays(rays).items()}
    every = {key: value.numpy() for key, value in scene.list_intersections(rays[:LISTED]).items()}
    missed = nearest["primitive_ids"] == scene.INVALID_ID
    np.testing.assert_array_equal(np.isinf(nearest["t_hit"]), missed)
    found = mesh.numbered(every["geometry_ids"], every["primitive_ids"], np.False_)
    pairs, depths = ascending(every["ray_ids"], found, every["t_hit"])
    return Answers(
        t=nearest["t_hit"],
        ids=mesh.numbered(nearest["geometry_ids"], nearest["primitive_ids"], missed),
        occluded=scene.test_occlusions(rays).numpy(),
        pairs=pairs,
        depths=depths,
        counts=scene.count_intersections(rays[:LISTED]).numpy(),
        normals=nearest["primitive_normals"],
        uvs=nearest["primitive_uvs"],
        nearly=scene.test_occlusions(rays, tfar=T_FAR).numpy(),
    )


def ask_trimesh(mesh, origins, directions):
    """trimesh: places, not t; all hits of a ray are found by starting again behind each."""
    trimesh = load("trimesh")
    embree = load("trimesh.ray.ray_pyembree")
    bodies = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    tracer = embree.RayMeshIntersector(bodies)

    def hits(o, d, **settings):
        places, rows, faces = tracer.intersects_location(o, d, **settings)
        o, d = o[rows].astype(np.float64), d[rows].astype(np.float64)
        return rows, faces, ((places - o) * d).sum(axis=1) / (d * d).sum(axis=1)

    t, ids = np.full(len(origins), np.inf), np.full(len(origins), -1)
    rows, faces, t_hit = hits(origins, directions, multiple_hits=False)
    t[rows], ids[rows] = t_hit, faces
    pairs, depths = ascending(*hits(origins[:LISTED], directions[:LISTED]))
    return Answers(
        t=t,
        ids=ids,
        occluded=tracer.intersects_any(origins, directions),
        pairs=pairs,
        depths=depths,
        counts=np.bincount(pairs[:, 0], minlength=len(origins[:LISTED])),
        normals=np.where(ids[:, None] < 0, 0, bodies.face_normals[ids]),
    )


PEERS = {"open3d": ask_open3d, "trimesh": ask_trimesh}


# --- who is right ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Met:
    """The triangles that a ray meets, or misses by little, in float64.

    `margin` is how far inside the nearest edge the ray passes, in units of the scene, negative
    outside; `slope` how much nearer to the triangle's plane the ray comes while t grows by one.
    """

    ids: np.ndarray
    t: np.ndarray
    margin: np.ndarray
    slope: np.ndarray


def reaches(mesh, origins):
    """How far from each origin the farthest point of the mesh's box is."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    o = origins.astype(np.float64)
    return np.linalg.norm(np.maximum(np.abs(o - low), np.abs(o - high)), axis=1)


def truth(mesh, origins, directions):
    """Brute force, by Moeller and Trumbore, of what each line comes near; one `Met` a ray."""
    corners = mesh.corners.astype(np.float64)
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    found = []
    for o, d in zip(origins.astype(np.float64), directions.astype(np.float64), strict=True):
        way = middles - o
        across = np.linalg.norm(way - np.outer(way @ d / (d @ d), d), axis=1)
        ids = np.flatnonzero(across <= 1.001 * radii + 1e-3)
        a, b, c = corners[ids].swapaxes(0, 1)
        one, two, three = b - a, c - a, c - b
        p, q = np.cross(d, two), np.cross(o - a, one)
        det = (one * p).sum(axis=1)
        u, v = ((o - a) * p).sum(axis=1), q @ d
        with np.errstate(all="ignore"):
            t = (two * q).sum(axis=1) / det
            inside = np.sign(det) * np.stack([u, v, det - u - v])
            edges = [np.linalg.norm(np.cross(d, edge), axis=1) for edge in (two, one, three)]
            margin = (inside / edges).min(axis=0)
            slope = np.abs(det) / np.linalg.norm(np.cross(one, two), axis=1)
        found.append(Met(ids, np.nan_to_num(t), margin, slope))
    return found


def permitted(met, answers, ray, rounding):
    """Whether a program that rounds so may say what it says of a ray."""
    with np.errstate(divide="ignore"):
        slack = rounding / met.slope
    may = (met.margin >= -rounding) & (met.t >= -slack)
    must = (met.margin > rounding) & (met.t > slack)
    if answers.ids[ray] < 0:
        if must.any():
            return False
    else:
        own = np.flatnonzero(may & (met.ids == answers.ids[ray]))
        if not len(own) or np.abs(met.t[own] - answers.t[ray]) > slack[own]:
            return False
        if (must & (met.t + slack < met.t[own] - slack[own])).any():
            return False
    for dark, end in ((answers.occluded, np.inf), (answers.nearly, T_FAR)):
        if dark is not None and dark[ray] and not (may & (met.t - slack <= end)).any():
            return False
        if dark is not None and not dark[ray] and (must & (met.t + slack < end)).any():
            return False
    if ray >= LISTED:
        return True
    first, last = np.searchsorted(answers.pairs[:, 0], [ray, ray + 1])
    listed = answers.pairs[first:last, 1]
    told = np.isin(met.ids, listed)
    if (told & may).sum() < last - first:
        return False
    depths = answers.depths[first:last][np.searchsorted(listed, met.ids[told])]
    if (np.abs(depths - met.t[told]) > slack[told]).any():
        return False
    return not (must & ~told).any()


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces as rays meet them, in float64: `slope` is as in `Met`, `size` twice the area."""

    one: np.ndarray
    two: np.ndarray
    size: np.ndarray
    slope: np.ndarray
    longest: np.ndarray


def faces_of(mesh, ids, directions):
    corners = mesh.corners[ids].astype(np.float64)
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(one, two)
    size = np.linalg.norm(cross, axis=1)
    slope = np.abs((cross * directions).sum(axis=1)) / size
    return Faces(one, two, size, slope, np.linalg.norm([one, two, two - one], axis=2).max(axis=0))


def differing(mesh, rays, ours, theirs):
    """The rays of which two programs say different things; t may differ as float32 may.

    Where they have the same hit, normals and uv must be the same too.
    """
    origins, directions = rays
    rounding = FLOAT32 * reaches(mesh, origins)
    differs = (ours.ids != theirs.ids) | (ours.occluded != theirs.occluded)
    if theirs.nearly is not None:
        differs |= ours.nearly != theirs.nearly
    differs[:LISTED] |= ours.counts != theirs.counts

    hit = np.flatnonzero((ours.ids >= 0) & (ours.ids == theirs.ids))
    faces, within = faces_of(mesh, ours.ids[hit], directions[hit]), rounding[hit]
    differs[hit] |= np.abs(ours.t[hit] - theirs.t[hit]) * faces.slope > within
    turned = np.linalg.norm(ours.normals[hit] - theirs.normals[hit], axis=1)
    assert (turned <= 2 * within * faces.longest / faces.size).all()  # of slivers less certain
    if theirs.uvs is not None:
        u, v = (ours.uvs[hit] - theirs.uvs[hit]).astype(np.float64).T[:, :, None]
        moved = np.linalg.norm(u * faces.one + v * faces.two, axis=1)
        assert (moved * faces.slope <= within * np.linalg.norm(directions[hit], axis=1)).all()

    keys = [answers.pairs @ [len(mesh.faces), 1] for answers in (ours, theirs)]
    differs[np.setxor1d(*keys) // len(mesh.faces)] = True
    _, a, b = np.intersect1d(*keys, return_indices=True)
    row, ids = ours.pairs[a].T
    slope = faces_of(mesh, ids, directions[row]).slope
    apart = np.abs(ours.depths[a] - theirs.depths[b]) * slope > rounding[row]
    differs[row[apart]] = True
    return np.flatnonzero(differs)


def judged(mesh, rays, ours, theirs):
    """How many rays differ, and how many of them a peer's rounding does not excuse.

    Of each ray that differs bfrt must be right.
    """
    rows = differing(mesh, rays, ours, theirs)
    origins, directions = (part[rows] for part in rays)
    reach = reaches(mesh, origins)
    wrong = 0
    for ray, far, met in zip(rows, reach, truth(mesh, origins, directions), strict=True):
        assert permitted(met, ours, ray, FLOAT64 * far), f"bfrt is wrong: ray {ray}"
        wrong += not permitted(met, theirs, ray, FLOAT32 * far)
    return len(rows), wrong


# --- tests -------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Asked:
    """A mesh in a store, rays, and bfrt's answers."""

    mesh: Mesh
    scene: bfrt.Scene
    rays: tuple[np.ndarray, np.ndarray]
    answers: Answers


def stored(mesh, path):
    with bfrt.SceneWriter(path) as writer:
        for group, faces in enumerate(mesh.geometries()):
            writer.triangles(mesh.vertices[faces], group=group)
    return bfrt.open(path)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Meshes by name, each asked once."""

    @functools.cache
    def make(name):
        rng = np.random.default_rng(1)
        mesh = MESHES[name](rng)
        scene = stored(mesh, tmp_path_factory.mktemp("peers") / "mesh.bfrt")
        rays = rays_through(mesh, rng)
        return Asked(mesh, scene, rays, ask_bfrt(scene, mesh, *rays))

    return make


@pytest.fixture(params=MESHES)
def asked(request, made):
    return made(request.param)


@pytest.mark.parametrize("peer", PEERS)
def test_peers_say_the_same(asked, peer):
    """One ray of ten thousand may differ, and of those none by more than float32's rounding."""
    theirs = PEERS[peer](asked.mesh, *asked.rays)
    assert 0.1 < asked.answers.occluded.mean() < 0.9
    differ, wrong = judged(asked.mesh, asked.rays, asked.answers, theirs)
    assert differ <= RAYS // 10_000
    assert wrong == 0


@pytest.mark.parametrize("peer", PEERS)
def test_peers_at_edges(asked, peer):
    """Here about half of all rays differ, in which of the triangles at the edge they hit."""
    rays = rays_at_edges(asked.mesh)
    ours = ask_bfrt(asked.scene, asked.mesh, *rays)
    theirs = PEERS[peer](asked.mesh, *rays)
    _, wrong = judged(asked.mesh, rays, ours, theirs)
    assert wrong == 0
    missed = (ours.ids < 0) != (theirs.ids < 0)
    assert missed.sum() <= 0.05 * AT_EDGES


@pytest.mark.parametrize("asked", ["ball"], indirect=True)
def test_no_ray_leaves_a_closed_mesh(asked):
    """From its middle, at edges and vertices. In Open3D about 4 of 1000 such rays leave it."""
    origins, directions = (part[::2] for part in rays_at_edges(asked.mesh, 20_000))
    assert asked.scene.occluded(origins, directions)["occluded"].all()


@pytest.mark.parametrize("asked", ["ball"], indirect=True)
def test_the_judge_finds_errors(asked):
    """Rays that are moved by 1e-4 of the scene are not excused, neither ours nor a peer's."""
    rays = rays_at_edges(asked.mesh, 100)
    ours = ask_bfrt(asked.scene, asked.mesh, *rays)
    moved = ask_bfrt(asked.scene, asked.mesh, rays[0] + np.float32(1e-4), rays[1])
    moved = replace(moved, normals=ours.normals, uvs=None)
    differ, wrong = judged(asked.mesh, rays, ours, moved)
    assert wrong > 0.8 * differ > 50
    with pytest.raises(AssertionError, match="bfrt is wrong"):
        judged(asked.mesh, rays, replace(moved, uvs=ours.uvs), replace(ours, uvs=None))


def test_keys_mean_what_they_mean_in_open3d(tmp_path):
    """Weights of the second and third corner, normals counterclockwise and unit, what misses are,
    the side that a ray comes from, and rays that begin on a surface: only that differs."""
    geometry = load("open3d.t.geometry")
    corners = np.array([[[0, 0, 0], [2, 0, 0], [0, 4, 0]]], np.float32)
    mesh = Mesh(corners[0], np.array([[0, 1, 2]]))
    scene = geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices, mesh.faces.astype(np.uint32))
    x, y, z = 0.5, 2.0, 0.0
    origins = np.array([[x, y, 1], [x, y, -1], [x, y, 1], [9, 9, 1], [x, y, z]], np.float32)
    ways = np.array([[0, 0, -2], [0, 0, 2], [0, 0, 1], [0, 0, -1], [0, 0, 1]], np.float32)
    ours = stored(mesh, tmp_path / "one.bfrt").cast_rays(origins, ways)
    theirs = scene.cast_rays(np.hstack([origins, ways]))
    theirs = {key: value.numpy() for key, value in theirs.items()}
    np.testing.assert_allclose(theirs["t_hit"], [0.5, 0.5, np.inf, np.inf, 0], rtol=1e-6)
    np.testing.assert_array_equal(ours["t_hit"], [0.5, 0.5, np.inf, np.inf, np.inf])
    for key in ("primitive_uvs", "primitive_normals"):
        np.testing.assert_allclose(ours[key][:4], theirs[key][:4], rtol=1e-6)
    np.testing.assert_array_equal(ours["primitive_uvs"][0], [0.25, 0.5])
    np.testing.assert_array_equal(ours["primitive_normals"][1], [0, 0, 1])
    invalid = scene.INVALID_ID
    np.testing.assert_array_equal(theirs["primitive_ids"], [0, 0, invalid, invalid, 0])
    np.testing.assert_array_equal(ours["primitive_ids"], [0, 0, -1, -1, -1])


def least(scene):
    """The least budget that works, of which the refusal tells."""
    with pytest.raises(bfrt.BudgetError) as refusal:
        scene.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), memory="1MiB")
    return re.search(r"expected (\d+MiB) or more", str(refusal.value))[1]


@pytest.mark.parametrize(
    ("asked", "memory"),
    [("soup", "least"), ("soup", "96MiB"), ("ball", "least")],
    indirect=["asked"],
)
def test_little_memory_says_the_same(asked, memory):
    budget = least(asked.scene) if memory == "least" else memory
    again = ask_bfrt(
        asked.scene, asked.mesh, *(part[:LISTED] for part in asked.rays), memory=budget
    )
    assert again.pairs.shape == asked.answers.pairs.shape
    for key, expected in vars(asked.answers).items():
        np.testing.assert_array_equal(getattr(again, key), expected[: len(getattr(again, key))])
