"""The fast path against the slow twin: the same (t, id), bit for bit, whatever is tight."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import fast
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from properties import examples
from scenes import hard_scenes, joined, random_objects, random_rays, units

from bfrt.conversion.convert import convert
from bfrt.phases.eye import EyeRays
from bfrt.records import NO_HIT
from bfrt.reference import exhaustive
from bfrt.reference.independent import Objects

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("BFRT_SHARED", ROOT.parent / "shared"))
NFF = sorted((SHARED / "spd").glob("*.nff"))
NAMES = sorted(hard_scenes(np.random.default_rng(0)))
DTYPES = (np.float32, np.float64)


def check(store, origins, directions, scratch, capacities, sorts=None):
    """Both kinds of rays, by both paths; returns the fast path's answer."""
    t, ids = exhaustive.nearest(store, origins, directions)
    dark = exhaustive.occluded(store, origins, directions, fast.SHADOW_END)
    for refine in fast.OF_GRIDS:
        found = fast.nearest(store, origins, directions, scratch, capacities, refine)
        different = (found.t != t) | (found.ids != ids)
        wrong = np.flatnonzero(different)[:9]
        assert not different.any(), (refine, wrong, sorts and sorts[different])
        np.testing.assert_array_equal(
            fast.occluded(store, origins, directions, scratch, capacities, refine), dark
        )
    return found


def scene_and_rays(rng, objects, path, dtype, n):
    """A store, and `n` rays of each sort."""
    objects = fast.stored(objects, dtype)
    store = fast.write(objects, path, dtype)
    rays = random_rays(rng, objects, n).values()
    origins, directions = (np.concatenate(some) for some in zip(*rays, strict=True))
    return store, origins - np.array(store.origin), directions


@pytest.mark.parametrize("variation", fast.VARIATIONS)
@pytest.mark.parametrize("name", NAMES)
def test_hard_scenes(tmp_path, name, variation):
    rng = np.random.default_rng([1, NAMES.index(name)])
    dtype = DTYPES[(NAMES.index(name) + len(variation)) % 2]
    scene = hard_scenes(rng)[name]
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", dtype, 30)
    found = check(store, *rays, tmp_path, fast.VARIATIONS[variation])
    assert (name == "empty") == (found.ids == NO_HIT).all()
    if store.groups[0].outliers:
        check(fast.gridded(store), *rays, tmp_path, fast.VARIATIONS[variation])


@pytest.mark.parametrize("name", NAMES)
def test_one_ray_at_a_time(tmp_path, name):
    rng = np.random.default_rng([2, NAMES.index(name)])
    scene = hard_scenes(rng)[name]
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", np.float64, 2)
    check(store, *rays, tmp_path, fast.LONELY)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_hard_scenes_again(tmp_path, seed):
    rng = np.random.default_rng([3, seed])
    scene = hard_scenes(rng)[NAMES[seed % len(NAMES)]]
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", DTYPES[seed % 2], 1000)
    for capacities in fast.VARIATIONS.values():
        check(store, *rays, tmp_path, capacities)
        check(fast.gridded(store), *rays, tmp_path, capacities)


@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_of_any_capacities(tmp_path, seed):
    rng = np.random.default_rng([4, seed])
    n = int(10 ** rng.uniform(0, 3))
    scene = random_objects(rng, n, spread=10.0, size=10 ** rng.uniform(-1, 1))
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", DTYPES[seed % 2], 20)
    for turn in range(4):
        room = int(10 ** rng.uniform(0.5, 2.5))
        uppers = int(10 ** rng.uniform(0, 5))
        limits = fast.Limits(
            voxels=int(10 ** rng.uniform(0, 5)),
            slab=int(10 ** rng.uniform(3, 6)),
            single=min(uppers, int(10 ** rng.uniform(0, 5))),
            uppers=uppers,
        )
        capacities = replace(
            fast.ROOMY,
            limits=limits,
            blocks=int(rng.choice([0, 1, 20, 1000])),
            subspace=int(10 ** rng.uniform(2, 6)),
            rays=room,
            candidates=room + int(10 ** rng.uniform(0, 4)),
            hits=int(10 ** rng.uniform(0, 3)),
            queue=int(10 ** rng.uniform(0, 3)),
            read_buffer=fast.PAGE * int(rng.integers(1, 9)),
            threads=int(rng.integers(1, 4)),
        )
        check(fast.gridded(store) if turn % 2 else store, *rays, tmp_path, capacities)


@pytest.mark.parametrize("variation", fast.VARIATIONS)
def test_outliers(tmp_path, variation):
    """Walls far larger than the rest, two of them in one plane: both stay out of the grid."""
    rng = np.random.default_rng(5)
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 40
    walls = Objects(
        spheres=[[0, 0, -60, 20]],
        vertices=np.concatenate([square, square, square[:, [2, 0, 1]]]),
        counts=[4, 4, 4],
    )
    scene = joined(random_objects(rng, 300, spread=3.0, size=0.3), walls)
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", np.float64, 30)
    assert len(store.groups[0].outliers) == 4
    check(store, *rays, tmp_path, fast.VARIATIONS[variation])


def test_each_ray_ends_once_even_with_no_rays(tmp_path):
    store = fast.write(Objects(spheres=[[0, 0, 0, 1]]), tmp_path / "s.bfrt")
    found = fast.nearest(store, np.empty((0, 3)), np.empty((0, 3)), tmp_path)
    assert found.t.shape == (0,)


def test_rays_that_are_none(tmp_path):
    """They miss, and disturb no other."""
    store = fast.write(Objects(spheres=[[0, 0, 0, 1]]), tmp_path / "s.bfrt", origin=(0, 0, 0))
    nan, inf = np.nan, np.inf
    origins = np.array([[0, 0, 3], [0, 0, 3], [nan, 0, 0], [0, -inf, 0], [0, 0, 0]])
    directions = np.array([[0, 0, -1], [0, 0, 0], [0, 0, 1], [0, 0, 1], [0, nan, 0]])
    found = check(store, origins, directions, tmp_path, fast.VARIATIONS["some rays at a time"])
    np.testing.assert_array_equal(found.t, [2.0, inf, inf, inf, inf])


def test_enough_rays_for_every_thread(tmp_path):
    """So many that walks, sorting and objects are shared out, and not all fit in memory."""
    rng = np.random.default_rng(8)
    scene = random_objects(rng, 500, spread=3.0, size=0.3)
    store, *rays = scene_and_rays(rng, scene, tmp_path / "s.bfrt", np.float32, 1600)
    t, ids = exhaustive.nearest(store, *rays)
    for voxels in (64**3, 20**3, 2**3):
        for threads in (1, 2, 3):
            roomy = replace(fast.ROOMY, threads=threads, candidates=1 << 17)
            capacities = fast.limited(roomy, voxels=voxels)
            assert len(ids) > capacities.rays
            found = fast.nearest(store, *rays, tmp_path, capacities)
            np.testing.assert_array_equal(found.ids, ids)
            np.testing.assert_array_equal(found.t, t)


@pytest.mark.parametrize("shape", [(1, 1, 400), (300, 1, 1), (1, 50, 7)], ids=str)
def test_long_scenes(tmp_path, shape):
    """Grids with one voxel on some axes, and with as many as there may be on others."""
    rng = np.random.default_rng(6)
    scene = random_objects(rng, 300, spread=1.0, size=0.3)
    stretched = replace(scene, spheres=scene.spheres * [*shape, 1])
    stretched = replace(stretched, cones=scene.cones * [*shape, 1, *shape, 1])
    store, *rays = scene_and_rays(rng, stretched, tmp_path / "s.bfrt", np.float64, 20)
    for voxels in (1, 50, 5000):
        check(store, *rays, tmp_path, fast.limited(fast.ROOMY, voxels=voxels))


# --- the standard scenes -----------------------------------------------------------------------


def check_nff(file, scratch, rays, resolution, variations):
    store = convert(file, scratch / "s.bfrt", order="given").store
    rng = np.random.default_rng(7)
    eye = EyeRays(store, [replace(store.camera, resolution=(resolution, resolution))], 0)
    seen = eye.read(len(eye))
    bounds = store.bounds
    start = rng.uniform(bounds.lo - bounds.diagonal / 2, bounds.hi + bounds.diagonal / 2, (rays, 3))
    target = rng.uniform(bounds.lo, bounds.hi, (rays, 3))
    axis = np.repeat(np.eye(3), rays // 3, axis=0)
    origins = np.concatenate([
        np.column_stack([seen["o" + k] for k in "xyz"]), start, target,
        target[: len(axis)] - bounds.diagonal * axis,
    ])  # fmt: skip
    directions = np.concatenate([
        np.column_stack([seen["d" + k] for k in "xyz"]), target - start, units(rng, rays), axis,
    ])  # fmt: skip
    for name in variations:
        found = check(store, origins, directions, scratch, fast.VARIATIONS[name])
        assert np.isfinite(found.t[: len(seen)]).any()


@pytest.mark.parametrize("file", NFF or [None], ids=lambda file: file.stem if file else "none")
def test_standard_scenes(tmp_path, file):
    if file is None:
        pytest.skip(f"no NFF files in {SHARED / 'spd'}")
    check_nff(file, tmp_path, 99, 12, ["roomy", "some rays at a time"])


@pytest.mark.slow
@pytest.mark.parametrize("file", NFF or [None], ids=lambda file: file.stem if file else "none")
def test_standard_scenes_at_length(tmp_path, file):
    if file is None:
        pytest.skip(f"no NFF files in {SHARED / 'spd'}")
    check_nff(file, tmp_path, 3000, 100, fast.VARIATIONS)


# --- everything on one grid, so that hits tie and boxes end where voxels do ------------------

quarters = st.integers(-8, 8).map(lambda n: n / 4)
points = st.tuples(quarters, quarters, quarters)
sizes = st.sampled_from([0.25, 0.5, 0.75, 1.0, -0.5])
spheres = st.builds(lambda c, r: [*c, r], points, sizes)
cones = st.builds(
    lambda a, b, r, form: [*a, r, *b, (r, 0.0, 2 * r)[form]],
    points, points, sizes, st.integers(0, 2),
)  # fmt: skip
triangles = st.builds(lambda a, b, c: [*a, *b, *c], points, points, points)


@st.composite
def squares(draw):
    """A rectangle along two axes; or its fourth vertex anywhere, so that it is not flat."""
    corner = np.array(draw(points))
    one, two = draw(st.sampled_from([(0, 1), (1, 2), (2, 0)]))
    a, b = np.zeros((2, 3))
    a[one] = draw(st.integers(1, 6)) / 4
    b[two] = draw(st.integers(1, 6)) / 4
    last = corner + b if draw(st.booleans()) else np.array(draw(points))
    return [corner, corner + a, corner + a + b, last]


@st.composite
def lattice_objects(draw):
    faces = draw(st.lists(triangles, max_size=6))
    shading = np.tile([0.0, 0.0, 1.0], 3)
    flat = draw(st.lists(squares(), max_size=4))
    parts = {
        "spheres": draw(st.lists(spheres, max_size=4)),
        "cones": draw(st.lists(cones, max_size=4)),
        "triangles": faces,
        "patches": [[*face, *shading] for face in faces[: draw(st.integers(0, 3))]],
        "vertices": [vertex for square in flat for vertex in square],
    }
    tables = {name: rows for name, rows in parts.items() if rows}
    return Objects(**tables, counts=np.full(len(flat), 4))


@st.composite
def lattice_rays(draw):
    one = st.tuples(points, points.filter(any))
    rays = draw(st.lists(one, min_size=1, max_size=40))
    return np.array([ray[0] for ray in rays]), np.array([ray[1] for ray in rays])


tight = st.builds(
    lambda voxels, slab, single, rays, spare, threads: replace(
        fast.limited(fast.ROOMY, voxels=voxels, slab=slab, single=single), rays=rays,
        candidates=rays + spare, hits=5, queue=5, read_buffer=fast.PAGE, threads=threads,
        blocks=2, subspace=2000,
    ),
    st.sampled_from([1, 8, 27, 64, 343, 512, 4096]),
    st.sampled_from([2048, 1 << 20]),
    st.sampled_from([8, 64, 4096]),
    st.sampled_from([1, 3, 40]),
    st.sampled_from([0, 1, 40, 1000]),
    st.integers(1, 2),
)  # fmt: skip


def check_on_lattice(folder, objects, rays, capacities):
    store = fast.write(objects, folder / "s.bfrt", np.float32)
    check(store, *rays, folder, capacities)
    check(fast.gridded(store), *rays, folder, capacities)


@examples(60)
@given(objects=lattice_objects(), rays=lattice_rays(), capacities=tight)
def test_on_a_lattice(tmp_path_factory, objects, rays, capacities):
    check_on_lattice(tmp_path_factory.getbasetemp(), objects, rays, capacities)


@pytest.mark.slow
@examples(2000)
@given(objects=lattice_objects(), rays=lattice_rays(), capacities=tight)
def test_on_a_lattice_at_length(tmp_path_factory, objects, rays, capacities):
    check_on_lattice(tmp_path_factory.getbasetemp(), objects, rays, capacities)
