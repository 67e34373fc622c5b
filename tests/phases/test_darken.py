"""Marks tell where there is nothing: of every cube, by brute force."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bfrt.geometry.lattice import Lattice
from bfrt.phases.preprocess import darken_all
from bfrt.workers import Workers


@given(seed=st.integers(0, 2**32), threads=st.integers(1, 3))
def test_bits_are_those_of_cubes_without_a_mark(seed, threads):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 50, 3))
    marks = np.zeros(shape[::-1], np.uint8)
    filled = rng.random(shape[::-1]) < 10.0 ** rng.uniform(-5, -1)
    marks[filled] = rng.integers(1, 64, filled.sum())
    expected = marks.copy()
    for side, bit in ((4, 1 << 6), (16, 1 << 7)):
        for corner in np.ndindex(*(-(-n // side) for n in marks.shape)):
            cube = tuple(slice(side * c, side * (c + 1)) for c in corner)
            if not marks[cube].any():
                expected[cube] |= bit
    workers = Workers(threads)
    flat = marks.reshape(-1)
    darken_all(flat, Lattice((0.0,) * 3, (1.0,) * 3, shape, 0.0), workers)
    workers.close()
    np.testing.assert_array_equal(flat, expected.reshape(-1))
