"""Inside or outside, against formulas: round meshes, boxes, tori, one in another, open ones."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest
from injected import dividing, holding

import bfrt
from bfrt.errors import SettingError
from bfrt.queries import answers
from bfrt.queries import points as points_room
from bfrt.scene import Scene

WAYS = {"base": "given", "sgb": "given", "sg": "given", "tree": "spatial"}
CUBE = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def corners(half, middle=(0.0, 0, 0)):
    grid = np.array(np.meshgrid([-1, 1.0], [-1, 1.0], [-1, 1.0], indexing="ij"))
    return half * grid.reshape(3, -1).T + np.array(middle)


def triangles_of(quads):
    return [[a, b, c] for q in quads for a, b, c in (q[:3], [q[0], q[2], q[3]])]


def lattice(across, around, place):
    """A closed mesh of a torus' topology, or a sphere's where its ends meet in points."""
    u, v = np.meshgrid(np.arange(across), np.arange(around), indexing="ij")
    vertices = place(2 * np.pi * u / across, 2 * np.pi * v / around).reshape(-1, 3)
    a, b = u * around + v, (u + 1) % across * around + v
    c, d = (u + 1) % across * around + (v + 1) % around, u * around + (v + 1) % around
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    return vertices, triangles_of(quads.tolist())


def torus(u, v):
    return np.stack([(2 + 0.7 * np.cos(v)) * np.cos(u), (2 + 0.7 * np.cos(v)) * np.sin(u),
                     0.7 * np.sin(v)], axis=-1)  # fmt: skip


def in_torus(points):
    """1 and 0, and -1 where a mesh and a torus may differ."""
    off = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 2, points[:, 2])
    return np.where(off < 0.68, 1, np.where(off > 0.7, 0, -1))


def icosphere(fine):
    """A mesh of the unit sphere, of an icosahedron whose faces are cut in four, again and again."""
    golden = (1 + 5**0.5) / 2
    vertices = [[i, j * golden, 0] for i in (-1, 1) for j in (-1, 1)]
    vertices = np.array([np.roll(v, k) for v in vertices for k in range(3)], float)
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 2.1
    faces = [(i, j, k) for i in range(12) for j in range(i) for k in range(j)
             if near[i, j] and near[j, k] and near[i, k]]  # fmt: skip
    for _ in range(fine):
        made = {}
        vertices = list(vertices)

        def middle(i, j, made=made, vertices=vertices):
            key = min(i, j), max(i, j)
            if key not in made:
                made[key] = len(vertices)
                vertices.append((vertices[i] + vertices[j]) / 2)
            return made[key]

        faces = [
            face for a, b, c in faces for x, y, z in [(middle(a, b), middle(b, c), middle(c, a))]
            for face in ((a, x, z), (b, y, x), (c, z, y), (x, y, z))
        ]  # fmt: skip
    vertices = np.array(vertices)
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), [list(f) for f in faces]


def made(path, *meshes, order="given", **settings):
    with bfrt.SceneWriter(path, order=order, **settings) as writer:
        for vertices, faces in meshes:
            writer.mesh(vertices, faces)
    return bfrt.open(path)


def test_a_sphere_of_triangles(tmp_path):
    """However faces are wound: those here are wound by chance."""
    points = np.random.default_rng(1).uniform(-1.3, 1.3, (20_000, 3))
    radius = np.linalg.norm(points, axis=1)
    for fine in (2, 4):
        with made(tmp_path / f"{fine}.bfrt", icosphere(fine)) as scene:
            found = scene.contains(points)
        assert found["inside"].dtype == np.int8 and found.stats.unsure_points == 0
        least = {2: 0.95, 4: 0.997}[fine]
        assert (found["inside"][radius < least] == 1).all()
        assert (found["inside"][radius > 1] == 0).all()
        assert (radius < least).any() and found["inside"].sum() < (radius < 1).sum()


@pytest.mark.parametrize("order", ["given", "spatial"])
def test_a_torus(tmp_path, order):
    points = np.random.default_rng(2).uniform([-3, -3, -1], [3, 3, 1], (20_000, 3))
    with made(tmp_path / "t.bfrt", lattice(200, 80, torus), order=order) as scene:
        found = scene.contains(points)["inside"]
    sure = in_torus(points) >= 0
    np.testing.assert_array_equal(found[sure], in_torus(points)[sure])


@pytest.mark.parametrize("middle", [(0.0, 0, 0), (5e5, 4.5e6, -120.0)])
@pytest.mark.parametrize("faces", ["polygons", "triangles"])
def test_a_box_to_the_last_bit(tmp_path, faces, middle):
    """Points a hair inside and outside of faces; rays through edges count once."""
    with bfrt.SceneWriter(tmp_path / "c.bfrt", origin=middle) as writer:
        if faces == "triangles":
            writer.mesh(corners(1.0, middle), triangles_of(CUBE))
        else:
            writer.polygons(corners(1.0, middle)[np.concatenate(CUBE)], [4] * 6)
    rng = np.random.default_rng(3)
    places = rng.uniform(-1, 1, (3000, 3))
    exact = rng.integers(-4, 5, (3000, 3)) / 4.0  # on a grid
    places[::2] = exact[::2]
    axis, side = rng.integers(3, size=3000), rng.choice([-1.0, 1.0], 3000)
    hair = 1e-8
    with bfrt.open(tmp_path / "c.bfrt") as scene:
        for off, expected in ((-hair, 1), (hair, 0)):
            points = places * (1 - hair)
            points[np.arange(3000), axis] = side * (1 + off)
            found = scene.contains(points + np.array(middle))
            np.testing.assert_array_equal(found["inside"], expected)
            assert found.stats.unsure_points == 0


def test_one_in_another(tmp_path):
    """A box in a box in a box: a wall, a cavity, and what is in it."""
    boxes = [(corners(half), triangles_of(CUBE)) for half in (1.0, 2.0, 3.0)]
    points = np.random.default_rng(4).uniform(-4, 4, (5000, 3))
    deep = np.abs(points).max(axis=1)
    with made(tmp_path / "n.bfrt", *boxes) as scene:
        found = scene.contains(points)["inside"]
    np.testing.assert_array_equal(found, (deep < 1) | ((deep > 2) & (deep < 3)))


def test_what_is_there_twice_is_not_there(tmp_path):
    """Of two surfaces in one place each is crossed."""
    box = corners(1.0), triangles_of(CUBE)
    points = np.random.default_rng(5).uniform(-1.5, 1.5, (2000, 3))
    deep = np.abs(points).max(axis=1) < 1
    with made(tmp_path / "2.bfrt", box, box) as scene:
        assert (scene.contains(points)["inside"] == 0).all()
    with made(tmp_path / "3.bfrt", box, box, box) as scene:
        np.testing.assert_array_equal(scene.contains(points)["inside"], deep)


def test_spheres(tmp_path):
    """Closed, whatever their sign; where two overlap is outside."""
    rng = np.random.default_rng(6)
    middles, radii = rng.uniform(-2, 2, (40, 3)), rng.uniform(0.2, 1, 40)
    with bfrt.SceneWriter(tmp_path / "s.bfrt") as writer:
        writer.spheres(middles, radii * rng.choice([-1, 1], 40))
    points = rng.uniform(-3, 3, (5000, 3))
    far = np.linalg.norm(points[:, None] - middles, axis=2)
    sure = (np.abs(far - radii) > 1e-9).all(axis=1)
    with bfrt.open(tmp_path / "s.bfrt") as scene:
        found = scene.contains(points)
        assert (scene.contains(middles[:1])["inside"] >= 0).all()
    expected = (far < radii).sum(axis=1) % 2
    np.testing.assert_array_equal(found["inside"][sure], expected[sure])
    assert 0.1 < expected.mean() < 0.6 and sure.all()


def test_an_open_box_is_unsure(tmp_path, caplog):
    """Without its top: below it the rays disagree; beside it both miss, or agree."""
    box = corners(1.0), triangles_of([face for face in CUBE if face != [1, 5, 7, 3]])
    points = np.random.default_rng(7).uniform(-0.9, 0.9, (3000, 3))
    with made(tmp_path / "o.bfrt", box) as scene:
        found = scene.contains(points)
        unsure = found["inside"] == -1
        assert 0.2 < unsure.mean() < 0.9 and (found["inside"][~unsure] == 1).all()
        assert found.stats.unsure_points == unsure.sum()
        assert f"of {unsure.sum()} points two rays disagree" in caplog.text
        assert found.stats.as_dict()["unsure_points"] == unsure.sum()
        high = points.copy()
        high[:, 2] += 2.5
        assert (scene.contains(high)["inside"] != 1).all()


def test_a_single_face_and_cones_are_open(tmp_path):
    with bfrt.SceneWriter(tmp_path / "f.bfrt") as writer:
        writer.triangles([[[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]])
        writer.cones([[0.0, 0, 20]], [1.0], [[0, 0, 24]], [1.0])
    with bfrt.open(tmp_path / "f.bfrt") as scene:
        found = scene.contains([[0, 0, 1], [0, 0, -1], [0, 0, 22], [99, 0, 0]])
    np.testing.assert_array_equal(found["inside"], [-1, -1, 1, 0])


def test_the_same_bits_in_every_way(tmp_path, monkeypatch):
    monkeypatch.setattr(answers, "ROWS", 23)
    half = lattice(20, 12, torus)
    meshes = [half, (corners(0.5), triangles_of(CUBE[:5])), icosphere(2)]
    for order in set(WAYS.values()):
        made(tmp_path / f"{order}.bfrt", *meshes, order=order).close()
    points = np.random.default_rng(8).uniform(-3, 3, (5, 90, 3))
    points[2, 3], points[4, 4, 1] = np.nan, np.inf
    expected = bfrt.contains(tmp_path / "given.bfrt", points)
    assert set(np.unique(expected["inside"])) == {-1, 0, 1} and expected["inside"].shape == (5, 90)
    assert expected["inside"][2, 3] == expected["inside"][4, 4] == -1
    assert expected.stats.bad_rays == 4
    for way, order in WAYS.items():
        with bfrt.open(tmp_path / f"{order}.bfrt") as scene:
            out = {"out": tmp_path / "out", "checkpoint": tmp_path / "kept", "every": 0}
            for settings in ({}, {"threads": 1, "memory": "110MiB"}, {"threads": 3}, out):
                found = scene.contains(points, refine=way, **settings)
                np.testing.assert_array_equal(found["inside"], expected["inside"])
                assert found.stats.unsure_points == expected.stats.unsure_points
            if order == "given":
                poor = holding(Scene(scene.store), fast.TIGHT)
            else:
                tight = {"resident": False, "rays": 61, "candidates": 150, "queue": 11}
                poor = dividing(scene, lambda held, tight=tight: replace(held, **tight))
            monkeypatch.setattr(points_room, "RAYS_AT_ONCE", 100)
            np.testing.assert_array_equal(
                poor.contains(points, refine=way)["inside"], expected["inside"]
            )
            monkeypatch.undo()
            monkeypatch.setattr(answers, "ROWS", 23)


@pytest.mark.parametrize(
    ("points", "settings", "what"),
    [
        (np.zeros((2, 2)), {}, r"points: found float64 of shape \(2, 2\), expected float32"),
        ("no.npy", {}, "no.npy: expected an .npy file of points"),
        (np.zeros((2, 3)), {"out": {"inside": np.zeros(2)}}, "out: found inside of float64"),
        (np.zeros((2, 3)), {"checkpoint": "x"}, "checkpoint: found no folder for the answer"),
    ],
)
def test_refused(tmp_path, points, settings, what):
    made(tmp_path / "c.bfrt", (corners(1.0), triangles_of(CUBE))).close()
    with pytest.raises(SettingError, match=what):
        bfrt.contains(tmp_path / "c.bfrt", points, **settings)
