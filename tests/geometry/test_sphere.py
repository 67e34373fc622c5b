from __future__ import annotations

import numpy as np
import pytest
from one_object import meet, outside, rays_through

from bfrt.records import Kind


@pytest.mark.parametrize("seed", range(20))
def test_bounds_contain_all_hits_and_normals_are_radii(seed):
    rng = np.random.default_rng(seed)
    center, radius = rng.normal(size=3) * 10, 10 ** rng.uniform(-6, 2)
    sign = (-1.0) ** seed
    probe = np.concatenate([center - radius, center + radius])
    met = meet(Kind.SPHERE, [*center, sign * radius], *rays_through(rng, probe, 400))
    assert met.hit.sum() > 200
    points = met.points[met.hit]
    slack = 1e-14 * (np.abs(center).max() + 10 * radius)
    assert outside(met.box, points).max() <= slack
    out = points - center
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), radius, atol=10 * slack)
    normals = met.geometric[met.hit]
    np.testing.assert_allclose(normals, sign * out / radius, rtol=1e-9)
    np.testing.assert_array_equal(met.shading[met.hit], normals)


def test_the_box_is_as_tight_as_float32_allows():
    met = meet(Kind.SPHERE, [0.1, 0.2, 1e6, -0.3], [[0, 0, 0]], [[1, 0, 0]])
    low, high = met.box[:3], met.box[3:]
    exact_low, exact_high = np.array([0.1, 0.2, 1e6]) - 0.3, np.array([0.1, 0.2, 1e6]) + 0.3
    assert (low <= exact_low).all()
    assert (np.nextafter(low, np.float32(np.inf)) > exact_low).all()
    assert (high >= exact_high).all()
    assert (np.nextafter(high, np.float32(-np.inf)) < exact_high).all()


@pytest.mark.parametrize("distance", [1e3, 1e5, 1e7])
def test_a_small_sphere_far_away_keeps_its_digits(distance):
    """b^2 - 4ac would have none of the radius left."""
    origins = [[-distance, 0.5 * 2.0**-10, 0.0]]
    met = meet(Kind.SPHERE, [0, 0, 0, 2.0**-10], origins, [[1.0, 0, 0]])
    assert met.t[0] == pytest.approx(distance - 2.0**-10 * np.sqrt(0.75), rel=2e-16)


def test_a_ray_from_the_surface_does_not_see_it_at_zero():
    met = meet(Kind.SPHERE, [0, 0, 0, 1], [[1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
    np.testing.assert_array_equal(met.t, [np.inf, 2.0])
