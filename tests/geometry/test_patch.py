from __future__ import annotations

import numpy as np
import pytest
from one_object import meet, outside, rays_through
from scenes import units

from bfrt.records import Kind


@pytest.mark.parametrize("seed", range(10))
def test_bounds_contain_all_hits_and_normals_blend(seed):
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3, 3))
    normals = units(rng, 3)
    probe = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
    origins, directions = rays_through(rng, probe, 600)
    met = meet(Kind.PATCH, [corners, normals], origins, directions)
    plain = meet(Kind.TRIANGLE, corners, origins, directions)
    assert met.hit.sum() > 30
    for name in ("box", "t", "geometric", "uv"):
        np.testing.assert_array_equal(getattr(met, name), getattr(plain, name))
    assert outside(met.box, met.points[met.hit]).max() <= 1e-14
    u, v = met.uv[met.hit].T
    blend = np.column_stack([1 - u - v, u, v]) @ normals
    blend /= np.linalg.norm(blend, axis=1, keepdims=True)
    np.testing.assert_allclose(met.shading[met.hit], blend, atol=1e-12)


def test_the_origin_moves_corners_not_normals():
    place = np.array([1e6, 2e6, 3e6])
    corners = np.add([[0, 0, 0], [4, 0, 0], [0, 4, 0]], place)
    normals = np.tile([0.0, 0.6, 0.8], (3, 1))
    met = meet(Kind.PATCH, [corners, normals], [[1, 1, 3]], [[0, 0, -1]], origin=place)
    assert met.t[0] == 3.0
    np.testing.assert_allclose(met.shading[0], [0, 0.6, 0.8], rtol=1e-15)
    np.testing.assert_array_equal(met.box, [0, 0, 0, 4, 4, 0])


def test_normals_that_cancel_leave_the_face():
    normals = [[1, 0, 0], [-1, 0, 0], [0, 0, 0]]
    corners = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]
    origins = [[0.5, 2, 3], [2, 0, 3]]
    met = meet(Kind.PATCH, [corners, normals], origins, [[0, 0, -1.0]] * 2)
    np.testing.assert_array_equal(met.uv, [[0.125, 0.5], [0.5, 0.0]])
    np.testing.assert_array_equal(met.shading, [[1, 0, 0], [0, 0, 1]])
