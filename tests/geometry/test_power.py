from __future__ import annotations

import math

import numpy as np
import pytest

from bfrt.reference._kernels import power


def expected(x, y):
    return np.array([math.pow(a, b) for a, b in zip(x.tolist(), y.tolist(), strict=True)])


def test_close_to_the_library():
    rng = np.random.default_rng(0)
    n = 20_000
    x = np.concatenate([rng.random(n), 1 - 10 ** rng.uniform(-16, -1, n), 10 ** -rng.random(n)])
    y = 10 ** rng.uniform(-3, 5, len(x))
    there = expected(x, y)
    normal = there > 1e-290  # an exponent of -1000 takes ten bits off the fraction
    assert normal.sum() > n
    np.testing.assert_allclose(power(x, y)[normal], there[normal], rtol=1e-12)
    assert (power(x, y)[~normal] <= 1e-289).all()


@pytest.mark.parametrize(
    ("x", "y", "there"),
    [
        (0.0, 0.0, 1.0),
        (0.5, 0.0, 1.0),
        (0.0, 3.0, 0.0),
        (-1e-17, 3.0, 0.0),  # a cosine that rounding took below zero
        (1.0, 1e6, 1.0),
        (0.5, 1.0, 0.5),
        (0.5, 10.0, 2.0**-10),
        (0.5, 1e6, 0.0),
        (1e-300, 1e6, 0.0),
        (0.25, 0.5, 0.5),
    ],
)
def test_exactly(x, y, there):
    assert power(np.array([x]), np.array([y]))[0] == there


def test_a_little_above_one():
    """A cosine of unit vectors may be."""
    x = 1 + np.arange(1.0, 9.0) * 2.0**-52
    y = np.full(8, 1e4)
    np.testing.assert_allclose(power(x, y), expected(x, y), rtol=1e-12)


def test_falls_with_the_exponent():
    y = np.linspace(0.0, 200.0, 5000)
    assert (np.diff(power(np.full(5000, 0.9), y)) < 0).all()
