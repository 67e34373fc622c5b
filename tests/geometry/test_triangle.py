from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from one_object import meet, outside, rays_through
from scenes import units

from bfrt.records import Kind


@pytest.mark.parametrize("seed", range(20))
def test_bounds_contain_all_hits(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3, 3)) * 10 ** rng.uniform(-3, 3)
    if seed % 4 == 0:
        corners[:, seed // 4 % 3] = 0.1  # flat along an axis
    probe = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
    met = meet(Kind.TRIANGLE, corners, *rays_through(rng, probe, 1000))
    assert met.hit.sum() > 30
    points = met.points[met.hit]
    assert outside(met.box, points).max() <= 1e-14 * np.abs(probe).max()
    u, v = met.uv[met.hit].T
    assert (u >= 0).all()
    assert (v >= 0).all()
    assert (u + v <= 1 + 1e-15).all()
    a, b, c = corners
    there = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    np.testing.assert_allclose(there, points, atol=1e-11 * np.abs(probe).max())


def test_the_box_is_the_corners_rounded_outwards():
    corners = np.array([[0.1, -0.1, 1e-50], [1e6 + 0.1, 1.0, 0.0], [-1e6 - 0.1, 2.0, -1e-50]])
    box = meet(Kind.TRIANGLE, corners, [[0, 0, 0]], [[1, 0, 0]]).box
    low, high = corners.min(axis=0), corners.max(axis=0)
    assert (box[:3] <= low).all()
    assert (np.nextafter(box[:3], np.float32(np.inf)) > low).all()
    assert (box[3:] >= high).all()
    assert (np.nextafter(box[3:], np.float32(-np.inf)) < high).all()
    assert float(box[1]) < -0.1  # which itself is no float32
    assert box[4] == 2.0


def test_the_normal_sees_the_corners_counterclockwise():
    met = meet(Kind.TRIANGLE, [0, 0, 0, 4, 0, 0, 0, 4, 0], [[1, 1, 3], [1, 1, -3]], [[0, 0, -1.0],
               [0, 0, 1.0]])  # fmt: skip
    np.testing.assert_array_equal(met.geometric, [[0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(met.t, [3, 3])
    np.testing.assert_allclose(met.uv, [[0.25, 0.25]] * 2)


@pytest.mark.parametrize("seed", range(10))
def test_no_ray_passes_between_neighbours(seed):
    """A fan of triangles around a point, and rays at its inner edges and at the point itself."""
    rng = np.random.default_rng(seed)
    hub = rng.normal(size=3)
    angle = (np.arange(7) + rng.uniform(-0.4, 0.4, 7)) * np.pi / 3
    rim = hub + np.column_stack([np.cos(angle), np.sin(angle), 0.1 * rng.normal(size=7)])
    rim[-1] = rim[0]
    spoke = rim[rng.integers(6, size=300)]
    target = hub + rng.random((300, 1)) * (rng.random((300, 1)) < 0.9) * 0.9 * (spoke - hub)
    away = units(rng, 300)
    away[:, 2] = np.sign(away[:, 2]) * (np.abs(away[:, 2]) + 2)
    origins = target - 3 * away
    hits = np.zeros(300, int)
    for one, two in pairwise(rim):
        hits += meet(Kind.TRIANGLE, [hub, one, two], origins, target - origins).hit
    assert (hits >= 1).all()


def height(corners, point):
    """How far a point is off the plane of three corners, worked out without rounding."""
    a, b, c, p = ([Fraction(float(x)) for x in row] for row in (*corners, point))
    one, two, way = ([x - y for x, y in zip(row, a, strict=True)] for row in (b, c, p))
    normal = [one[i - 2] * two[i - 1] - one[i - 1] * two[i - 2] for i in range(3)]
    length = float(sum(n * n for n in normal)) ** 0.5
    return abs(float(sum(n * w for n, w in zip(normal, way, strict=True)))) / length


@pytest.mark.parametrize("aspect", [1e6, 1e8, 1e10])
@pytest.mark.parametrize("seed", range(4))
def test_a_hit_on_a_sliver_has_its_place_on_it(seed, aspect):
    """o + t d leaves it by the rounding of t, which grows with the aspect."""
    rng = np.random.default_rng(seed)
    a, along = rng.normal(size=(2, 3))
    across = np.cross(along, rng.normal(size=3))
    corners = np.array([a, a + along, a + 0.4 * along + across / aspect])
    weights = rng.dirichlet([1, 1, 1], 200)
    target = weights @ corners
    directions = units(rng, 200)
    met = meet(Kind.TRIANGLE, corners, target - 2 * directions, directions)
    assert met.hit.sum() > 50
    off = [height(corners, place) for place in met.places[met.hit]]
    assert max(off) < 4e-15
    assert max(height(corners, point) for point in met.points[met.hit]) > 100 * max(off)
