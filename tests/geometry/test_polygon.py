from __future__ import annotations

import numpy as np
import pytest
from one_object import meet, outside, rays_through
from scenes import frames, units

from bfrt.records import Kind

NOTCH = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0]]
STAR = [[0, 3, 0], [2, -3, 0], [-3, 1, 0], [3, 1, 0], [-2, -3, 0]]


def random_polygon(rng, warp):
    """A star around a centre, its vertices off its plane by `warp`."""
    n = int(rng.integers(4, 12))
    normal = units(rng, 1)
    one, two = frames(normal)
    angle = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
    reach = rng.uniform(0.3, 1.0, n)[:, None]
    around = reach * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two)
    return rng.normal(size=3) + around + warp * rng.normal(size=(n, 1)) * normal


@pytest.mark.parametrize("warp", [0.0, 1e-7, 0.05, 0.5])
@pytest.mark.parametrize("seed", range(8))
def test_bounds_contain_all_hits(seed, warp):
    """Of polygons that are not flat, too."""
    rng = np.random.default_rng(seed)
    vertices = random_polygon(rng, warp)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    probe = np.concatenate([low - warp, high + warp])
    met = meet(Kind.POLYGON, vertices, *rays_through(rng, probe, 3000), 0.0)
    assert met.hit.sum() > 50
    assert outside(met.box, met.points[met.hit]).max() <= 1e-14
    if warp == 0.0:
        np.testing.assert_allclose(met.box, [*low, *high], atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_the_normal_is_newells(seed):
    rng = np.random.default_rng(seed)
    vertices = random_polygon(rng, 0.1)
    center = vertices.mean(axis=0)
    around = vertices - center
    normal = np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    met = meet(Kind.POLYGON, vertices, [center + normal * 2], [-normal])
    assert met.t[0] == pytest.approx(2.0, rel=1e-14)
    np.testing.assert_allclose(met.geometric[0], normal, rtol=1e-12)


def test_concave_and_wound_twice():
    down = [[0, 0, -1.0]]
    for vertices, point, hit in [
        (NOTCH, (2, 2, 3), False), (NOTCH, (0.5, 3, 3), True), (NOTCH, (2, 0.9, 3), True),
        (STAR, (0, 2, 3), True), (STAR, (0, 0, 3), False), (STAR, (5, 0, 3), False),
    ]:  # fmt: skip
        assert meet(Kind.POLYGON, vertices, [point], down).hit[0] == hit


def test_tiles_own_each_point_once():
    """Six polygons tile a square: every ray hits one or more, also at their edges and vertices, and
    is owned by just one."""
    tiles = [
        [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)],
        [(2, 0), (4, 0), (4, 2), (3, 2), (2, 1)],
        [(2, 1), (3, 2), (2, 3), (1, 2), (1, 1)],
        [(4, 2), (4, 4), (3, 4), (3, 2)],
        [(0, 2), (1, 2), (2, 3), (2, 4), (0, 4)],
        [(3, 2), (3, 4), (2, 4), (2, 3)],
    ]
    xy = np.stack(np.meshgrid(np.arange(16), np.arange(16)), -1).reshape(-1, 2) / 4
    for axes in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        origins = np.column_stack([xy, np.full(len(xy), 3.0)])[:, axes]
        direction = np.array([0.0, 0.0, -1.0])[axes]
        ways = np.tile(direction, (len(xy), 1))
        hits, owned = np.zeros((2, len(xy)), int)
        for tile in tiles:
            vertices = np.column_stack([tile, np.zeros(len(tile))])[:, axes]
            met = meet(Kind.POLYGON, vertices, origins, ways)
            hits += met.hit
            owned += met.crossings
        assert (hits >= 1).all()
        inside = (xy > 0).all(axis=1) & (xy < 4).all(axis=1)
        np.testing.assert_array_equal(owned[inside], 1)
        assert owned.max() == 1
        assert hits.max() > 1


def test_in_the_plane_is_a_miss():
    square = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]]
    assert not meet(Kind.POLYGON, square, [[-1, 1, 0]], [[1, 0, 0]]).hit[0]
