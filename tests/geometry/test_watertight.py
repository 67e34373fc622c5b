"""Closed meshes hold every ray, and each ray crosses them an odd number of times from inside.

Of triangles, polygons, and both; flat and not; as float32 and float64; near the origin and far from
it; turned or along the axes. Rays start inside, and aim anywhere, at edges, and at corners.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import bfrt

#: Rays that are sent at a mesh, and at how many with ``-m slow``.
RAYS, MANY = 20_000, 1_000_000


def cube(rng):
    """Six squares."""
    corners = np.array(list(product((-0.5, 0.5), repeat=3)))
    return corners, np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )


def bumpy(rng):
    """A ball of quadrilaterals, none of which is flat; those at the poles are triangles."""
    rows, columns = 12, 17
    up = np.linspace(0.0, np.pi, rows)[1:-1, None]
    around = 2 * np.pi * np.arange(columns) / columns
    ball = np.stack(
        [np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up) + 0 * around], axis=-1
    )
    ball *= rng.uniform(0.8, 1.0, (*ball.shape[:2], 1))
    corners = np.concatenate([ball.reshape(-1, 3), [[0, 0, 1.0], [0, 0, -1.0]]])
    index = np.arange(ball.shape[0] * columns).reshape(-1, columns)
    beside = np.roll(index, -1, axis=1)
    sides = np.stack([index[:-1], index[1:], beside[1:], beside[:-1]], axis=-1).reshape(-1, 4)
    north, south = len(corners) - 2, len(corners) - 1
    top = np.stack([index[0], beside[0], np.full(columns, north)], axis=-1)
    bottom = np.stack([beside[-1], index[-1], np.full(columns, south)], axis=-1)
    return corners, [*sides, *top, *bottom]


def prism(rng):
    """Two flat outlines of 40 corners, concave, and the squares between: a gear."""
    angle = 2 * np.pi * np.arange(40) / 40
    reach = np.where(np.arange(40) % 4 < 2, 1.0, 0.7)[:, None]
    outline = reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([outline, np.full(40, -0.3)])
    corners = np.concatenate([low, low + np.array([0, 0, 0.6])])
    i = np.arange(40)
    j = (i + 1) % 40
    sides = np.stack([i, j, j + 40, i + 40], axis=1)
    return corners, [*sides, i[::-1], i + 40]


MESHES = {"cube": cube, "bumpy": bumpy, "prism": prism}

#: Which faces are written as triangles.
WRITTEN = {"polygons": 0, "triangles": 1, "both": 2}


def written(path, corners, faces, dtype, triangulated):
    """A store of the faces, of which every so many is a fan of triangles; the others polygons."""
    with bfrt.SceneWriter(path, dtype=dtype) as writer:
        for number, face in enumerate(faces):
            if triangulated and number % triangulated == 0 and len(face) < 5:
                fan = [[face[0], face[k], face[k + 1]] for k in range(1, len(face) - 1)]
                writer.triangles(corners[fan])
            else:
                writer.polygons(corners[face], [len(face)])
    return bfrt.open(path)


def aimed(rng, corners, faces, n):
    """From inside: at edges, at corners, from the middle itself, and anywhere."""
    middle = corners.mean(axis=0)
    size = np.linalg.norm(corners - middle, axis=1).max()
    edges = np.array(
        [[a, b] for face in faces for a, b in zip(face, np.roll(face, 1), strict=True)]
    )
    a, b = corners[edges[rng.integers(len(edges), size=n)]].swapaxes(0, 1)
    weight = np.where(
        rng.random((n, 1)) < 0.5, rng.random((n, 1)), rng.choice([0, 0.5, 1.0], (n, 1))
    )
    origins = middle + 0.1 * size * rng.uniform(-1, 1, (n, 3))
    origins[::3] = middle
    directions = a + weight * (b - a) - origins
    directions[1::5] = rng.normal(size=directions[1::5].shape)
    directions[2::50] = np.eye(3)[rng.integers(3, size=len(directions[2::50]))]
    return origins, directions


def check(tmp_path, name, form, dtype, offset, turned, n):
    rng = np.random.default_rng(len(name) + len(form))
    corners, faces = MESHES[name](rng)
    if turned:
        corners = corners @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    corners = (corners + offset).astype(dtype).astype(float)
    scene = written(tmp_path / "mesh.bfrt", corners, faces, dtype, WRITTEN[form])
    origins, directions = aimed(rng, corners, faces, n)
    assert scene.occluded(origins, directions)["occluded"].all()
    assert np.isfinite(scene.cast_rays(origins, directions)["t_hit"]).all()
    counts = scene.count_intersections(origins, directions)["counts"]
    assert (counts % 2 == 1).all()
    if name == "cube":
        assert (counts == 1).all()
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    away = scene.count_intersections(origins - 100 * unit, directions)["counts"]
    assert (away % 2 == 0).all()


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("form", WRITTEN)
@pytest.mark.parametrize("name", MESHES)
def test_no_ray_leaves_a_closed_mesh(tmp_path, name, form, dtype, offset, turned):
    check(tmp_path, name, form, dtype, offset, turned, RAYS)


@pytest.mark.slow
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("form", WRITTEN)
@pytest.mark.parametrize("name", MESHES)
def test_of_a_million_rays_none_leaves(tmp_path, name, form, dtype, offset, turned):
    check(tmp_path, name, form, dtype, offset, turned, MANY)


def test_crossings_of_a_cube_are_one(tmp_path):
    """Through the middle of a face, where its triangles meet, and at a corner of six."""
    corners, faces = cube(None)
    scene = written(tmp_path / "cube.bfrt", corners, faces, "float32", 1)
    origins = np.zeros((3, 3))
    directions = [[0, 0, 1.0], [1, 1, 1], [1, 0, 1]]
    assert scene.count_intersections(origins, directions)["counts"].tolist() == [1, 1, 1]
    every = scene.list_intersections(origins, directions)
    np.testing.assert_allclose(every["t_hit"], [0.5] * 3)
    np.testing.assert_array_equal(scene.cast_rays(origins, directions)["t_hit"], every["t_hit"])


def test_neighbours_wound_either_way_share_a_crossing(tmp_path):
    """A wall of two triangles, of which one is turned round: the edge between belongs to one."""
    wall = np.array([[[0, 0, 0], [2, 0, 0], [2, 2, 0]], [[0, 0, 0], [2, 2, 0], [0, 2, 0]]], float)
    at = np.linspace(0.1, 1.9, 500)[:, None] * [1.0, 1.0, 0.0]
    origins = at + np.array([0.3, -0.2, 1.0])
    for flip in (slice(None), slice(None, None, -1)):
        wall[1] = wall[1][flip]
        with bfrt.SceneWriter(tmp_path / "wall.bfrt") as writer:
            writer.triangles(wall)
        scene = bfrt.open(tmp_path / "wall.bfrt")
        counts = scene.count_intersections(origins, at - origins)["counts"]
        assert (counts == 1).all()
        assert scene.occluded(origins, at - origins)["occluded"].all()
