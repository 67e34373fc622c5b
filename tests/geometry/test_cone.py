from __future__ import annotations

import numpy as np
import pytest
from one_object import meet, outside
from scenes import frames, units

from bfrt.records import Kind


def discs(base, rb, apex, ra, n=2000):
    """Points on the rims of both ends."""
    axis = (apex - base) / np.linalg.norm(apex - base)
    one, two = (v[0] for v in frames(axis[None]))
    angle = np.linspace(0, 2 * np.pi, n)[:, None]
    around = np.cos(angle) * one + np.sin(angle) * two
    return base + rb * around, apex + ra * around


def random_cone(rng, seed):
    base = rng.normal(size=3) * 3
    axis = units(rng, 1)[0] if seed % 4 else np.eye(3)[seed // 4 % 3]
    apex = base + axis * 10 ** rng.uniform(-2, 1)
    rb = 10 ** rng.uniform(-2, 1)
    ra = (0.0, rb, rng.uniform(0.1, 2) * rb)[seed % 3]
    return base, rb, apex, ra


@pytest.mark.parametrize("seed", range(24))
def test_bounds_contain_all_hits_and_normals_cross_the_rulings(seed):
    rng = np.random.default_rng(seed)
    base, rb, apex, ra = random_cone(rng, seed)
    sign = (-1.0) ** seed
    rims = discs(base, rb, apex, ra)
    ends = np.concatenate(rims)
    probe = np.concatenate([ends.min(axis=0), ends.max(axis=0)])
    record = [*base, sign * rb, *apex, sign * ra]
    size = np.abs(probe).max() + np.linalg.norm(probe[3:] - probe[:3])
    way = units(rng, 600)
    surface = rims[0] + rng.random((2000, 1)) * (rims[1] - rims[0])
    start = surface[:600] - way * size * rng.uniform(0, 3, (600, 1)) * (rng.random((600, 1)) < 0.8)
    met = meet(Kind.CONE, record, start, way)
    assert met.hit.sum() > 400
    points, normals = met.points[met.hit], met.geometric[met.hit]
    assert outside(met.box, points).max() <= 1e-13 * size
    axis = apex - base
    s = (points - base) @ axis / (axis @ axis)
    assert ((s >= -1e-9) & (s <= 1 + 1e-9)).all()
    out = points - base - s[:, None] * axis
    radius = np.linalg.norm(out, axis=1)
    np.testing.assert_allclose(radius, rb + s * (ra - rb), atol=1e-11 * size)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    clear = radius > 1e-3 * max(rb, ra)
    ruling = (axis + (ra - rb) * out / radius[:, None])[clear]
    ruling /= np.linalg.norm(ruling, axis=1, keepdims=True)
    np.testing.assert_allclose((ruling * normals[clear]).sum(axis=1), 0, atol=1e-7)
    assert (sign * (normals * out).sum(axis=1)[clear] > 0).all()


@pytest.mark.parametrize("seed", range(12))
def test_the_box_is_tight(seed):
    """It is that of the two rims, to float32."""
    cone = random_cone(np.random.default_rng(seed), seed)
    ends = np.concatenate(discs(*cone))
    base, rb, apex, ra = cone
    box = meet(Kind.CONE, [*base, rb, *apex, ra], [[0, 0, 0]], [[1, 0, 0]]).box
    exact = np.concatenate([ends.min(axis=0), ends.max(axis=0)])
    np.testing.assert_allclose(box, exact, atol=1e-5 * np.abs(exact).max())


def test_the_normal_at_a_tip_is_the_axis():
    """Outside there; a negative radius turns it."""
    for sign in (1.0, -1.0):
        record = [0, 0, 0, sign, 0, 0, 2, 0]
        met = meet(Kind.CONE, record, [[-1, 0, 2]], [[1, 0, 0]])
        assert met.t[0] == 1.0
        np.testing.assert_array_equal(met.geometric[0], [0, 0, sign])


@pytest.mark.parametrize("distance", [1e3, 1e5, 1e7])
def test_a_thin_cylinder_far_away_keeps_its_digits(distance):
    r = 2.0**-10
    record = [0, 0, -1, r, 0, 0, 1, r]
    met = meet(Kind.CONE, record, [[-distance, 0.5 * r, 0]], [[1.0, 0, 0]])
    assert met.t[0] == pytest.approx(distance - r * np.sqrt(0.75), rel=2e-16)


def test_no_caps():
    record = [0, 0, 0, 1, 0, 0, 2, 1]
    origins = [[0.5, 0, -1], [0, 0, 1], [0.5, 0, -1]]
    met = meet(Kind.CONE, record, origins, [[0, 0, 1], [0, 0, 1], [0.125, 0, 1]])
    np.testing.assert_array_equal(met.t, np.inf)
