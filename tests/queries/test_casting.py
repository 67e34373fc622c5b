"""Ray queries against brute force: nearest, any and all hits, in memory and beyond."""

from __future__ import annotations

import resource
import sys
from fractions import Fraction
from pathlib import Path

import fast
import numpy as np
import pytest
from capped import memory_cap
from failing import refuse_reads
from injected import holding
from memory_cap import run_in
from scenes import hard_scenes, random_rays

import bfrt
from bfrt.errors import SceneError, SettingError
from bfrt.queries import answers
from bfrt.queries import given as given_module
from bfrt.records import INDEX_BITS, NO_HIT
from bfrt.reference import exhaustive
from bfrt.scene import Scene
from bfrt.store import atomic_folder

#: An array that nothing can be put into.
READ_ONLY = np.zeros(2)
READ_ONLY.flags.writeable = False

#: Of two elements in each row the first has no value.
MASKED = np.ma.masked_equal(np.tile([7.0, 1.0, 1.0], (2, 1)), 7.0)

NAMES = sorted(hard_scenes(np.random.default_rng(0)))

#: Budgets as a query gets them: plenty, and so little that all goes to disk.
PLANS = {"roomy": fast.ROOMY, "tight": fast.TIGHT}


@pytest.fixture(params=PLANS)
def planned(request, monkeypatch):
    """What a query's budget holds."""
    monkeypatch.setattr(answers, "ROWS", 97)
    return PLANS[request.param]


def make(tmp_path, name, plan, n=40):
    """A scene whose budgets hold `plan`, and rays."""
    rng = np.random.default_rng(NAMES.index(name))
    objects = hard_scenes(rng)[name]
    store = fast.write(objects, tmp_path / "s.bfrt")
    rays = random_rays(rng, objects, n)
    origins, directions = (np.concatenate(some) for some in zip(*rays.values(), strict=True))
    return holding(Scene(store), plan), origins, directions


def ids_of(answer):
    ids = (answer["geometry_ids"].astype(np.uint64) << np.uint64(INDEX_BITS)) | answer[
        "primitive_ids"
    ].astype(np.uint64)
    return np.where(answer["primitive_ids"] < 0, np.uint64(NO_HIT), ids)


@pytest.mark.parametrize("name", NAMES)
def test_cast_rays_is_brute_force(tmp_path, planned, name):
    scene, origins, directions = make(tmp_path, name, planned)
    answer = scene.cast_rays(origins, directions)
    t, ids = exhaustive.nearest(scene.store, origins - np.array(scene.origin), directions)
    np.testing.assert_array_equal(answer["t_hit"], t)
    np.testing.assert_array_equal(ids_of(answer), ids)
    missed = ids == NO_HIT
    lengths = np.linalg.norm(answer["primitive_normals"], axis=1)
    np.testing.assert_allclose(lengths[~missed], 1.0, atol=1e-5)
    assert (lengths[missed] == 0.0).all()


@pytest.mark.parametrize("name", NAMES)
def test_occluded_is_brute_force(tmp_path, planned, name):
    scene, origins, directions = make(tmp_path, name, planned)
    end = np.random.default_rng(5).uniform(0.0, 3.0, len(origins))
    expected = exhaustive.occluded(scene.store, origins - np.array(scene.origin), directions, end)
    answer = scene.occluded(origins, directions, t_max=end)
    near = exhaustive.advanced(scene.store, origins - np.array(scene.origin), directions)[1] == 0.0
    np.testing.assert_array_equal(answer["occluded"][near], expected[near])
    infinite = scene.occluded(origins, directions)["occluded"]
    np.testing.assert_array_equal(
        infinite, exhaustive.occluded(scene.store, origins - np.array(scene.origin), directions)
    )


@pytest.mark.parametrize("name", NAMES)
def test_all_intersections_are_brute_force(tmp_path, planned, name):
    scene, origins, directions = make(tmp_path, name, planned, 15)
    ray, t, ids = exhaustive.crossings(scene.store, origins - np.array(scene.origin), directions)
    answer = scene.list_intersections(origins, directions)
    np.testing.assert_array_equal(answer["ray_ids"], ray)
    np.testing.assert_array_equal(answer["t_hit"], t)
    np.testing.assert_array_equal(ids_of(answer), ids)
    counts = np.bincount(ray, minlength=len(origins))
    np.testing.assert_array_equal(np.diff(answer["ray_splits"]), counts)
    counted = scene.count_intersections(origins, directions)["counts"]
    np.testing.assert_array_equal(counted, counts)


@pytest.mark.parametrize("refine", ["base", "sg"])
@pytest.mark.parametrize("name", NAMES)
def test_refinements_answer_alike(tmp_path, name, refine):
    scene, origins, directions = make(tmp_path, name, fast.ROOMY)
    for ask in (scene.cast_rays, scene.list_intersections):
        one, other = ask(origins, directions), ask(origins, directions, refine=refine, threads=1)
        for key, values in one.items():
            np.testing.assert_array_equal(values, other[key])


@pytest.fixture
def spheres(tmp_path):
    """Two spheres and a triangle on the x axis."""
    with bfrt.SceneWriter(tmp_path / "x.bfrt") as writer:
        writer.spheres([[2.0, 0, 0], [6.0, 0, 0]], [1.0, 1.0])
        writer.triangles([[[9.0, -1, -1], [9.0, 3, -1], [9.0, -1, 3]]])
    return bfrt.open(tmp_path / "x.bfrt")


def test_where_rays_begin_and_end(spheres):
    o, d = np.zeros((6, 3)), np.tile([2.0, 0, 0], (6, 1))
    t_min, t_max = [0, 0.5, 0.6, 0, 0, 4.5], [9, 9, 9, 0.5, 0.51, 4.5]
    t = spheres.cast_rays(o, d, t_min=t_min, t_max=t_max)["t_hit"]
    np.testing.assert_array_equal(t, [0.5, 1.5, 1.5, np.inf, 0.5, np.inf])
    dark = spheres.occluded(o, d, t_min=t_min, t_max=t_max)["occluded"]
    np.testing.assert_array_equal(dark, [True, True, True, False, True, False])
    counts = spheres.count_intersections(o, d, t_min=t_min, t_max=t_max)["counts"]
    np.testing.assert_array_equal(counts, [5, 4, 4, 0, 1, 0])


@pytest.mark.parametrize("t_min", [-1e300, -3.0, 0.0, 1e-300, 4.4999, 1e17, 1e300, np.inf])
@pytest.mark.parametrize("t_max", [-np.inf, -1e300, -1.0, 0.0, 1e-300, 4.5, 1e17, 1e300, np.inf])
def test_any_begin_and_end(spheres, t_min, t_max):
    """No end makes a query hang, and none lets a hit through that is not before it."""
    o, d = np.zeros((1, 3)), np.array([[2.0, 0, 0]])
    every = spheres.list_intersections(o, d, t_min=t_min, t_max=t_max)
    assert ((every["t_hit"] >= t_min) & (every["t_hit"] < t_max)).all()
    if abs(t_min) < 1e17:
        inside = [t for t in (0.5, 1.5, 2.5, 3.5, 4.5) if t_min <= t < t_max]
        np.testing.assert_allclose(every["t_hit"], inside)


def test_keys_as_documented(spheres):
    answer = spheres.cast_rays(np.zeros((2, 3), np.float32), [[0, 0, 1.0], [-1, 0, 0]])
    assert {k: (v.dtype.str, v.shape) for k, v in answer.items()} == {
        "t_hit": ("<f8", (2,)),
        "geometry_ids": ("<i4", (2,)),
        "primitive_ids": ("<i8", (2,)),
        "primitive_normals": ("<f4", (2, 3)),
        "primitive_uvs": ("<f4", (2, 2)),
    }
    assert (answer["primitive_ids"] == -1).all() and (answer["geometry_ids"] == -1).all()
    hit = spheres.cast_rays([[10.0, 0, 0]], [[-1.0, 0, 0]])
    assert hit["geometry_ids"] == 2
    np.testing.assert_allclose(hit["primitive_uvs"], [[0.25, 0.25]])
    np.testing.assert_allclose(hit["primitive_normals"], [[1, 0, 0]])


def test_bad_rays_are_counted_and_hit_nothing(spheres, caplog):
    o = np.array([[0, 0, 0], [np.nan, 0, 0], [0, 0, 0], [0, np.inf, 0.0]])
    d = np.array([[1.0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]])
    for ask, key, expected in (
        (spheres.cast_rays, "t_hit", [1, np.inf, np.inf, np.inf]),
        (spheres.occluded, "occluded", [True, False, False, False]),
        (spheres.count_intersections, "counts", [5, 0, 0, 0]),
        (spheres.list_intersections, "ray_splits", [0, 5, 5, 5, 5]),
    ):
        answer = ask(o, d)
        np.testing.assert_array_equal(answer[key], expected)
        assert answer.stats.bad_rays == 3
    assert "3 rays were NaN" in caplog.text


def miss_distance(origin, direction):
    """How far a line passes the origin of coordinates, worked out without rounding."""
    o, d = ([Fraction(float(x)) for x in row] for row in (origin, direction))
    cross = [o[i - 2] * d[i - 1] - o[i - 1] * d[i - 2] for i in range(3)]
    return float(sum(c * c for c in cross) / sum(x * x for x in d)) ** 0.5


@pytest.mark.parametrize("exponent", [5, 14, 15, 16, 17, 20, 40, 100, 250])
def test_rays_from_far_away_lose_no_hit(tmp_path, exponent):
    """Along an axis and slanted: what the line of float64 meets, a ray of it meets."""
    with bfrt.SceneWriter(tmp_path / "ball.bfrt") as writer:
        writer.spheres([[0.0, 0, 0]], [1.0])
    scene = bfrt.open(tmp_path / "ball.bfrt")
    rng = np.random.default_rng(exponent)
    way = rng.normal(size=(300, 3))
    way[:100] = np.eye(3)[rng.integers(3, size=100)] * rng.choice([-1, 1], (100, 1))
    # Of any way float64 has places so far away that the line goes through the ball by chance only:
    # whole numbers times a power of two do so always.
    way[100:200] = rng.integers(-9, 10, (100, 3))
    way[(way == 0).all(axis=1)] = [1.0, 2.0, 3.0]
    aside = np.where(way == 0.0, rng.uniform(-0.9, 0.9, (300, 3)), 0.0)
    origins = aside - 2.0 ** (np.log2(10) * exponent // 1) * way
    passes = np.array([miss_distance(*ray) for ray in zip(origins, way, strict=True)])
    assert (passes[:200] < 1.3).all()
    answer = scene.cast_rays(origins, way)
    sure = np.abs(passes - 1.0) > 1e-6
    np.testing.assert_array_equal(np.isfinite(answer["t_hit"])[sure], (passes < 1.0)[sure])
    counts = scene.count_intersections(origins, way)["counts"]
    np.testing.assert_array_equal(counts[sure], 2 * (passes < 1.0)[sure])
    t = np.abs(origins).max(axis=1) / np.abs(way).max(axis=1)
    hit = np.isfinite(answer["t_hit"])
    np.testing.assert_allclose(answer["t_hit"][hit], t[hit], rtol=1e-4)


@pytest.mark.parametrize("power", [-1060, -1000, -538, -65, 0, 65, 500, 1020])
def test_a_direction_has_any_length(tmp_path, planned, power):
    """t counts in lengths of the direction, bit for bit; where it would be no number there is no
    hit."""
    scene, origins, directions = make(tmp_path, NAMES[0], planned)
    directions = directions[np.isfinite(origins).all(axis=1)]
    origins = origins[np.isfinite(origins).all(axis=1)]
    # Few digits: no power of two costs one.
    directions = directions.astype(np.float32).astype(float)
    expected = scene.cast_rays(origins, directions)
    with np.errstate(over="ignore", under="ignore"):
        scaled = np.ldexp(directions, power)
        t = np.ldexp(expected["t_hit"], -power)
    exact = (np.ldexp(scaled, -power) == directions).all(axis=1) & np.isfinite(scaled).all(axis=1)
    exact &= (t == np.inf) | (np.abs(t) > 1e-300)
    assert exact.sum() > 40
    answer = scene.cast_rays(origins[exact], scaled[exact])
    np.testing.assert_array_equal(answer["t_hit"], t[exact])
    same = np.isfinite(t[exact])
    for key in ("primitive_ids", "primitive_normals", "primitive_uvs"):
        np.testing.assert_array_equal(answer[key][same], expected[key][exact][same])
    assert (answer["primitive_ids"][~same] == -1).all()
    every = scene.list_intersections(origins[exact], scaled[exact])
    ray, t, ids = exhaustive.crossings(
        scene.store, origins[exact] - np.array(scene.origin), scaled[exact]
    )
    np.testing.assert_array_equal(every["ray_ids"], ray)
    np.testing.assert_array_equal(every["t_hit"], t)
    np.testing.assert_array_equal(ids_of(every), ids)
    nearest, ids = exhaustive.nearest(
        scene.store, origins[exact] - np.array(scene.origin), scaled[exact]
    )
    np.testing.assert_array_equal(answer["t_hit"], nearest)
    assert answer.stats.bad_rays == (~directions[exact].any(axis=1)).sum()


@pytest.mark.parametrize("dtype", [">f4", ">f8", ">i4"])
def test_rays_of_any_byte_order(spheres, tmp_path, dtype):
    o, d = np.array([[0, 0, 0], [1, 9, 2]], dtype), np.array([[2, 0, 0], [0, -3, -1]], dtype)
    np.save(tmp_path / "o.npy", o)
    expected = spheres.cast_rays(o.astype(float), d.astype(float), t_max=9.0)
    for answer in (
        spheres.cast_rays(o, d, t_max=np.array([9, 9], ">f8")),
        spheres.cast_rays(tmp_path / "o.npy", d, t_max=9.0),
    ):
        for key, values in expected.items():
            np.testing.assert_array_equal(answer[key], values)


def test_a_call_of_one_ray_costs_alike_with_any_budget(tmp_path):
    """By the pages that are touched, which the system clears."""
    scene = bfrt.open(bfrt.spd.rings(2).write(tmp_path / "r.bfrt").path)

    def pages(memory):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(10):
            scene.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), memory=memory, threads=1)
        return (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) / 10

    pages("64MiB")
    assert pages("2GiB") < 1.2 * pages("64MiB") + 20


def test_files_and_blocks_are_as_good_as_arrays(tmp_path, planned):
    scene, origins, directions = make(tmp_path, NAMES[0], planned)
    np.save(tmp_path / "o.npy", origins)
    np.save(tmp_path / "d.npy", directions)
    expected = scene.cast_rays(origins, directions)
    blocks = ((origins[i : i + 7], directions[i : i + 7]) for i in range(0, len(origins), 7))
    filled = {"t_hit": np.zeros(len(origins))}
    for answer in (
        scene.cast_rays(tmp_path / "o.npy", str(tmp_path / "d.npy"), out=tmp_path / "answer"),
        scene.cast_rays(blocks),
        scene.cast_rays(origins, directions, out=filled),
    ):
        for key, values in expected.items():
            np.testing.assert_array_equal(answer[key], values)
    np.testing.assert_array_equal(filled["t_hit"], expected["t_hit"])
    np.testing.assert_array_equal(np.load(tmp_path / "answer" / "t_hit.npy"), expected["t_hit"])
    every = scene.list_intersections(origins, directions)
    written = scene.list_intersections(origins, directions, out=tmp_path / "all")
    for key, values in every.items():
        np.testing.assert_array_equal(written[key], values)
    assert not list((tmp_path / "all").glob(".*"))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["f4", "f8", "i2", "u8"])
def test_files_of_rays_are_read_by_blocks(spheres, tmp_path, monkeypatch, dtype, order):
    """Not mapped: a disk that fails would end the process."""
    monkeypatch.setattr(given_module, "RAYS_AT_ONCE", 7)
    monkeypatch.setattr(np, "memmap", None)
    o = np.arange(60).reshape(20, 3).astype(dtype, order)
    d = (9 - np.arange(60).reshape(20, 3) % 7).astype(dtype, order)
    np.save(tmp_path / "o.npy", o)
    np.save(tmp_path / "d.npy", d)
    t_max = np.arange(20.0)
    expected = spheres.cast_rays(o, d, t_max=t_max)
    files = spheres.cast_rays(tmp_path / "o.npy", str(tmp_path / "d.npy"), t_max=t_max)
    mixed = spheres.cast_rays(o, tmp_path / "d.npy", t_max=t_max)
    pairs = spheres.count_intersections(iter([(tmp_path / "o.npy", d), (o, tmp_path / "d.npy")]))
    for key, values in expected.items():
        np.testing.assert_array_equal(files[key], values)
        np.testing.assert_array_equal(mixed[key], values)
    np.testing.assert_array_equal(
        pairs["counts"], np.tile(spheres.count_intersections(o, d)["counts"], 2)
    )


def test_a_read_of_rays_that_is_refused(spheres, tmp_path, monkeypatch):
    """At the first read, the second, and so on: one error with its place, and no answers."""
    monkeypatch.setattr(given_module, "RAYS_AT_ONCE", 7)
    path, out = tmp_path / "rays.npy", tmp_path / "out"
    np.save(path, np.ones((20, 3)))

    def check():
        assert not out.exists()

    reads = refuse_reads(monkeypatch, path, lambda: spheres.cast_rays(path, path, out=out), check)
    assert reads > 10


def test_a_cut_file_of_rays(spheres, tmp_path, monkeypatch):
    monkeypatch.setattr(given_module, "RAYS_AT_ONCE", 7)
    path, cut, out = tmp_path / "rays.npy", tmp_path / "cut.npy", tmp_path / "out"
    np.save(path, np.ones((20, 3)))
    data = path.read_bytes()
    for size in range(0, len(data), 29):
        cut.write_bytes(data[:size])
        kind = SettingError if size < 128 else bfrt.ShortReadError
        for ask in (spheres.cast_rays, spheres.list_intersections):
            with pytest.raises(kind) as caught:
                ask(path, cut, out=out)
            assert str(caught.value).startswith(f"{cut}: ")
            assert "\n" not in str(caught.value)
        assert not out.exists()
    cut.write_bytes(data + b"x")
    with pytest.raises(SceneError, match="byte 608: found more bytes than an array of shape"):
        spheres.cast_rays(path, cut, out=out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("array", "what"),
    [
        (
            np.zeros((2, 2)),
            r"found float64 of shape \(2, 2\), expected float32 or float64",
        ),
        (np.zeros(3), r"found float64 of shape \(3,\), expected float32 or float64 of shape"),
        (np.zeros((2, 3), "f2"), "found float16 of shape"),
        (np.zeros((2, 3), "?"), "found bool of shape"),
        (np.zeros((2, 3), "U1"), "found <U1 of shape"),
        (np.array([[None] * 3]), "found object of shape .* expected numbers in rows, .* for direc"),
        (np.ones((17, 2)).T, "found float64 of shape .* in Fortran order, expected numbers in"),
        (b"text", "expected NumPy's header of an array, for directions"),
        (b"", "expected NumPy's header of an array, for directions"),
    ],
)
def test_files_that_are_no_rays(spheres, tmp_path, array, what):
    path = tmp_path / "d.npy"
    if isinstance(array, bytes):
        path.write_bytes(array)
    else:
        np.save(path, array, allow_pickle=True)
    with pytest.raises(SettingError, match=what) as caught:
        spheres.cast_rays(np.zeros((2, 3)), path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_paths_that_are_no_files(spheres, tmp_path):
    for path in (tmp_path, tmp_path / "none" / "no.npy"):
        with pytest.raises(SettingError, match=r"expected an \.npy file of origins: ") as caught:
            spheres.cast_rays(path, path)
        assert str(caught.value).startswith(f"{path}: ")


def test_no_rays(spheres):
    none = np.zeros((0, 3))
    assert len(spheres.cast_rays(none, none)["t_hit"]) == 0
    assert len(spheres.cast_rays(iter([]))["t_hit"]) == 0
    assert list(spheres.list_intersections(none, none)["ray_splits"]) == [0]


def test_no_objects(tmp_path):
    with bfrt.SceneWriter(tmp_path / "empty.bfrt"):
        pass
    scene = bfrt.open(tmp_path / "empty.bfrt")
    assert scene.cast_rays(np.zeros((2, 3)), np.ones((2, 3)))["t_hit"].tolist() == [np.inf] * 2
    assert scene.occluded(np.zeros((2, 3)), np.ones((2, 3)))["occluded"].tolist() == [False] * 2


@pytest.mark.parametrize(
    ("arguments", "settings", "what"),
    [
        ((np.zeros((2, 3)), np.zeros((3, 3))), {}, "expected one shape"),
        ((np.zeros((2, 2)), np.zeros((2, 2))), {}, "expected float32 or float64 of shape"),
        ((np.zeros((2, 3)),), {}, "directions: found none"),
        ((iter([1]),), {}, "expected origins and directions"),
        ((iter([]),), {"t_max": [1.0]}, "expected one t_min and t_max"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"t_max": [1.0]}, "t_max: found float64"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": {"t": np.zeros(2)}}, "out: found 't'"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": {"t_hit": np.zeros(3)}}, "of shape"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"refine": "no"}, "refine: found"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": 5}, "out: found int, expected arrays by key"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": b"x"}, "out: found bytes"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": {"t_hit": [0.0, 0.0]}}, "t_hit that is list"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"out": {"t_hit": READ_ONLY}}, "that is read-only"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"t_max": [[1], [1, 2]]}, "t_max: found rows of sev"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"t_min": [[1], [1, 2]]}, "t_min: found rows of sev"),
        ((iter([]),), {"t_max": [[1], [1, 2]]}, "t_max: found rows of several lengths"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"progress": None}, "progress: found None, expected"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"progress": 1}, "progress: found 1, expected True"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"scratch": 7}, "scratch: found int, expected a pa"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"scratch": "a\0"}, "scratch: .* without NUL"),
        (("a\0.npy", "a\0.npy"), {}, "origins: found 'a.x00.npy', expected a path without NUL"),
        ((MASKED, np.ones((2, 3))), {}, "origins: found masked elements, expected numbers"),
        ((np.ones((2, 3)), MASKED), {}, "directions: found masked elements"),
        (([*MASKED], np.ones((2, 3))), {}, "origins: found masked elements"),
        (([(MASKED, np.ones((2, 3)))],), {}, "origins: found masked elements"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"t_max": MASKED[0, :2]}, "t_max: found masked"),
        ((np.zeros((2, 3)), np.ones((2, 3))), {"t_min": np.ma.masked}, "t_min: found masked"),
        (
            (np.zeros((2, 3)), np.ones((2, 3))),
            {"out": {"t_hit": MASKED[0, :2]}},
            "t_hit that is ma",
        ),
        (([[0, 0, 0], [0, 0]], np.ones((2, 3))), {}, "origins: found rows of several lengths"),
        (("no.npy", "no.npy"), {}, "no.npy: expected an .npy file of origins"),
    ],
)
def test_refused_in_one_sentence(spheres, arguments, settings, what):
    with pytest.raises(SettingError, match=what):
        spheres.cast_rays(*arguments, **settings)


def test_what_is_no_scene():
    rays = np.zeros((1, 3)), np.ones((1, 3))
    with pytest.raises(SettingError, match="store: found int, expected a path"):
        bfrt.cast_rays(3, *rays)
    with pytest.raises(SettingError, match=r"store: found 'a.x00b', expected a path without NUL"):
        bfrt.open("a\0b")
    with pytest.raises(SettingError, match="store: found NoneType, expected a path"):
        bfrt.render(None)


def test_an_array_without_a_masked_element_is_one(spheres):
    rays = np.zeros((1, 3)), np.ones((1, 3))
    found = spheres.cast_rays(*map(np.ma.asarray, rays), out={"t_hit": np.ma.zeros(1)})
    np.testing.assert_array_equal(found["t_hit"], spheres.cast_rays(*rays)["t_hit"])


def test_answers_are_put_into_no_file_and_no_store(spheres, tmp_path):
    (tmp_path / "file").touch()
    rays = np.zeros((1, 3)), np.ones((1, 3))
    before = sorted(spheres.path.iterdir())
    for ask in (spheres.cast_rays, spheres.list_intersections):
        with pytest.raises(SettingError, match=r"found the file .*, expected a folder"):
            ask(*rays, out=tmp_path / "file")
        for folder in (spheres.path, spheres.path / "out"):
            with pytest.raises(SettingError, match="found it to be in the store"):
                ask(*rays, out=folder)
    assert sorted(spheres.path.iterdir()) == before


def test_a_ray_may_begin_any_way_before_the_scene(spheres):
    o, d = np.array([[7.5, 0.2, 0.3]]), np.array([[1.0, 0.0, 0.0]])
    expected = spheres.list_intersections(o, d, t_min=-9.0)
    assert len(expected["t_hit"]) == 5
    for t_min in (-100.0, -1e7, -1e16, -1e300, -np.inf):
        found = spheres.list_intersections(o, d, t_min=t_min)
        assert found.stats.bad_rays == 0
        assert (found["primitive_ids"] == expected["primitive_ids"]).all()
        assert np.allclose(found["t_hit"], expected["t_hit"], rtol=1e-14)


def test_long_directions_from_the_far_end_of_numbers(spheres):
    far = np.float64(1.7e308)
    d = np.array([[1.0, 0.0, 0.0]])
    o = np.array([[-far, 0.0, 0.5]])
    expected = spheres.count_intersections(o * 1e-300, d)["counts"]
    for length in (1.0, 1e20, 1e40, 1e300):
        assert spheres.count_intersections(o, d * length)["counts"] == expected


def test_a_list_goes_to_a_folder(spheres):
    with pytest.raises(SettingError, match="expected a folder"):
        spheres.list_intersections(np.zeros((1, 3)), np.ones((1, 3)), out={})


@pytest.mark.parametrize("error", [KeyboardInterrupt, bfrt.DiskFullError("a", 0, 28, "writing")])
def test_files_are_whole_or_not_there(spheres, tmp_path, monkeypatch, error):
    put = answers.Columns.put

    def fail(columns, block):
        put(columns, block)
        raise error

    monkeypatch.setattr(answers.Columns, "put", fail)
    with pytest.raises((KeyboardInterrupt, bfrt.DiskFullError)):
        spheres.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("ask", ["cast_rays", "list_intersections"])
@pytest.mark.parametrize("renamed", [0, 1, 4])
def test_all_files_are_there_or_none(spheres, tmp_path, monkeypatch, ask, renamed):
    """An interrupt between two files that get their names takes the first with it, in a folder
    that has other things; one of nothing else gets its name at once."""
    rename, done = Path.replace, []

    def interrupt(path, target):
        if len(done) == renamed:
            raise KeyboardInterrupt
        done.append(target)
        return rename(path, target)

    rays = np.zeros((1, 3)), np.ones((1, 3))
    (tmp_path / "mine").touch()
    monkeypatch.setattr(Path, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        getattr(spheres, ask)(*rays, out=tmp_path)
    assert len(done) == renamed
    assert sorted(tmp_path.iterdir()) == [tmp_path / "mine", spheres.path]
    found = getattr(spheres, ask)(*rays, out=tmp_path / "a" / "b")
    assert {path.stem for path in (tmp_path / "a" / "b").iterdir()} == set(found)


@pytest.mark.parametrize("ask", ["occluded", "list_intersections"])
def test_a_folder_gets_its_name_with_all_files(spheres, tmp_path, monkeypatch, ask):
    """An interrupt before that leaves nothing, or the answer that was there."""
    rays = np.zeros((1, 3)), np.ones((1, 3))
    rename, out = Path.rename, tmp_path / "a" / "b"

    def interrupt(path, target):
        if path.suffix == ".part":
            raise KeyboardInterrupt
        return rename(path, target)

    def fails(given):
        with monkeypatch.context() as now:
            now.setattr(Path, "rename", interrupt)
            now.setattr(atomic_folder, "exchange", lambda *_: False)
            with pytest.raises(KeyboardInterrupt):
                getattr(spheres, ask)(*given, out=out)

    fails(rays)
    assert sorted(tmp_path.iterdir()) == [spheres.path]
    found = getattr(spheres, ask)(*rays, out=out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert before.keys() == {f"{key}.npy" for key in found}
    fails((np.zeros((2, 3)), np.ones((2, 3))))
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert list(out.parent.iterdir()) == [out]
    getattr(spheres, ask)(np.zeros((2, 3)), np.ones((2, 3)), out=out)
    assert {path.name for path in out.iterdir()} == before.keys()
    assert list(out.parent.iterdir()) == [out]


def test_answers_of_two_queries_share_a_folder(spheres, tmp_path):
    """Neither takes the other's files for an answer of its own, nor what is beside them."""
    rays = np.zeros((2, 3)), np.ones((2, 3))
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine").touch()
    for _ in range(2):
        spheres.occluded(*rays, out=out)
        spheres.count_intersections(*rays, out=out)
    assert sorted(path.name for path in out.iterdir()) == ["counts.npy", "mine", "occluded.npy"]
    assert [path.name for path in tmp_path.iterdir() if path.name[0] == "."] == []


@pytest.mark.parametrize(
    ("place", "what"),
    [
        ("file/x/y", "out: found the file .*file, expected a folder .*file/x/y"),
        ("n" * 300, "found too long a name"),
        ("new/" + "n" * 300, "found too long a name"),
        ("n/" * 3000, "found too long a name"),
        ("a\0b", "expected a path without NUL"),
        ("taken", "that is no file, expected a file or nothing"),
        ("round", "expected a path to write to: Too many levels of symbolic links"),
    ],
)
def test_a_folder_that_cannot_be_is_found_before_tracing(
    spheres, tmp_path, monkeypatch, place, what
):
    (tmp_path / "file").touch()
    (tmp_path / "round").symlink_to(tmp_path / "round")
    for key in ("t_hit", "occluded", "counts"):
        (tmp_path / "taken" / f"{key}.npy").mkdir(parents=True)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(spheres._session, "tracer", lambda settings: pytest.fail("tracing"))
    for name in ("cast_rays", "occluded", "count_intersections", "list_intersections"):
        with pytest.raises(SettingError, match=what) as caught:
            getattr(spheres, name)(np.zeros((1, 3)), np.ones((1, 3)), out=f"{tmp_path}/{place}")
        assert len(str(caught.value)) < 1000
    assert sorted(tmp_path.rglob("*")) == before


def test_a_folder_that_is_not_ours_is_found_before_tracing(spheres, tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != tmp_path)
    with pytest.raises(SettingError, match="expected one that we may write to"):
        spheres.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), out=tmp_path / "new" / "er")


def test_an_unknown_setting_is_refused(spheres):
    with pytest.raises(TypeError, match="samples"):
        spheres.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), samples=4)


def test_too_small_a_budget_is_refused(spheres):
    with pytest.raises(bfrt.BudgetError, match=r"expected \d+MiB or more for rays of this scene"):
        spheres.cast_rays(np.zeros((1, 3)), np.ones((1, 3)), memory="1MiB")


@pytest.mark.parametrize("false", [False, np.False_])
def test_cancelled(spheres, false):
    with pytest.raises(bfrt.Cancelled, match="rays finished"):
        spheres.cast_rays(np.zeros((1, 3)), [[1.0, 0, 0]], progress=lambda _: false)


def test_groups_answer_together(tmp_path, planned):
    """Objects in three groups are met as in one."""
    rng = np.random.default_rng(3)
    centers, radii = rng.uniform(-1, 1, (60, 3)), rng.uniform(0.05, 0.2, 60)
    with bfrt.SceneWriter(tmp_path / "g.bfrt") as writer:
        for group in range(3):
            part = slice(20 * group, 20 * (group + 1))
            writer.spheres(centers[part], radii[part], group=group)
    scene = holding(bfrt.open(tmp_path / "g.bfrt"), planned)
    o, d = rng.normal(size=(200, 3)) * 2, rng.normal(size=(200, 3))
    start = o - np.array(scene.origin)
    t, ids = exhaustive.nearest(scene.store, start, d)
    answer = scene.cast_rays(o, d)
    np.testing.assert_array_equal(answer["t_hit"], t)
    np.testing.assert_array_equal(ids_of(answer), ids)
    dark = scene.occluded(o, d)["occluded"]
    np.testing.assert_array_equal(dark, np.isfinite(t))
    ray, t, ids = exhaustive.crossings(scene.store, start, d)
    every = scene.list_intersections(o, d)
    np.testing.assert_array_equal(every["t_hit"], t)
    np.testing.assert_array_equal(ids_of(every), ids)
    counted = scene.count_intersections(o, d)["counts"]
    np.testing.assert_array_equal(counted, np.bincount(ray, minlength=200))


MANY = """
import sys
import numpy as np
import bfrt

def blocks():
    rng = np.random.default_rng(2)
    for _ in range(10):
        o = rng.uniform(-1, 1, (100_000, 3))
        yield o, rng.uniform(-1, 1, (100_000, 3)) - o

scene = bfrt.open(sys.argv[1])
answer = scene.cast_rays(blocks(), memory="96MiB", out=sys.argv[2])
print(answer.stats.peak_rss_bytes, len(answer["t_hit"]))
"""


def test_more_rays_than_memory_holds(tmp_path):
    """A million rays, 190 MB of records and answers, inside a cgroup as large as the budget."""
    store = bfrt.spd.rings(5).write(tmp_path / "r.bfrt")
    with memory_cap(96 << 20) as group:
        if group is None:
            pytest.skip("no memory cgroup can be made here")
        command = [sys.executable, "-c", MANY, str(store.path), str(tmp_path / "out")]
        done = run_in(group, command, tmp_path)
    assert done.returncode == 0, done.stderr
    peak, rays = map(int, done.stdout.split())
    assert peak < 96 << 20
    assert rays == 1_000_000
    o, d = (np.concatenate(part) for part in zip(*blocks(), strict=True))
    some = slice(None, None, 1009)
    t = exhaustive.nearest(store.store, o[some] - np.array(store.origin), d[some])[0]
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "t_hit.npy")[some], t)


def blocks():
    """The rays of `MANY`."""
    rng = np.random.default_rng(2)
    for _ in range(10):
        o = rng.uniform(-1, 1, (100_000, 3))
        yield o, rng.uniform(-1, 1, (100_000, 3)) - o
