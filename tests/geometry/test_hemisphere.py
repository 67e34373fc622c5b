"""Directions around a normal: by the core, by NumPy, and as dense as their cosine."""

from __future__ import annotations

import numpy as np
import pytest
from shading import dot, unit

from bfrt.reference._kernels import cosine_directions
from bfrt.reference.openness import directions, mixed, seeds_of, uniform

#: Axes, what is nearly one, and what has no sign.
STEEP = [
    (0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, -0.0), (0, 1, 0), (0, -1, 0),
    (1e-9, -1e-9, 1), (1e-9, 1e-9, -1), (1e-200, 0, -1), (1, 1, 1), (-1, 2, -1e-12),
]  # fmt: skip


def normals(count):
    rng = np.random.default_rng(7)
    steep = np.array(STEEP, float)
    return unit(np.concatenate([steep, rng.normal(size=(count - len(steep), 3))]))


@pytest.mark.parametrize("v", [0.0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1 - 2.0**-53])
def test_a_turn_is_that_of_the_library(v):
    """Where quarters meet, and between: z is up, so that x and y are cosine and sine."""
    near = np.clip(v + np.linspace(-1e-3, 1e-3, 501), 0, 1 - 2.0**-53)
    up = np.broadcast_to((0.0, 0.0, 1.0), (501, 3)).copy()
    found = cosine_directions(up, np.ones(501), near)
    angle = 2 * np.pi * near
    expected = np.stack([np.cos(angle), np.sin(angle), np.zeros(501)], axis=1)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)  # of the angle, rounded


def test_quarters_are_exact():
    up = np.broadcast_to((0.0, 0.0, 1.0), (4, 3)).copy()
    found = cosine_directions(up, np.ones(4), np.arange(4) / 4)
    assert found.tolist() == [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]


def test_directions_are_unit_and_as_steep_as_u_says():
    n = normals(20_000)
    rng = np.random.default_rng(1)
    u, v = rng.random((2, len(n)))
    u[:4] = 0, 1 - 2.0**-53, 0.5, 1e-300
    found = cosine_directions(n, u, v)
    np.testing.assert_allclose(dot(found, found), 1, rtol=0, atol=3e-15)
    np.testing.assert_allclose(dot(found, n), np.sqrt(1 - u), rtol=0, atol=1e-15)


def test_directions_are_those_of_the_slow_twin():
    """For seeds of all bits: the twin's k-th direction is that of its two numbers."""
    n = normals(3000)
    seeds = seeds_of(np.arange(3000), np.arange(3000) % 5)
    twin = directions(n, seeds, 7)
    for k in range(7):
        u = (k + uniform(mixed(seeds + np.uint64(k)))) / 7
        v = uniform(seeds + np.uint64(k * 0x9E3779B97F4A7C15 % 2**64))
        np.testing.assert_allclose(cosine_directions(n, u, v), twin[:, k], rtol=0, atol=2e-15)


def test_they_are_as_dense_as_their_cosine():
    """Put down along the normal they fill the disk evenly: rings of one area have as many."""
    n = normals(40)
    ways = directions(n, seeds_of(np.arange(40), 0), 4096)
    seen = dot(ways, n[:, None]).ravel()
    counts, _ = np.histogram(1 - seen**2, 16, (0, 1))
    assert (np.abs(counts / (40 * 4096 / 16) - 1) < 0.001).all()
    mean = ways.mean(axis=1)  # of cosine-weighted directions: 2/3 of the normal
    np.testing.assert_allclose(mean, 2 / 3 * n, atol=0.005)
