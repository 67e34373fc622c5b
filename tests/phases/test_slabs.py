"""Bricks of marks: packed, kept, found again; and slabs of them, by brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.phases._slabs import pack
from bfrt.phases.partition import subspaces
from bfrt.phases.slabs import cuts_of, table_of
from bfrt.scene.marks import BRICK, BRICK_BYTES, bricks_of

DARK = 1 << 6


@given(seed=st.integers(0, 2**32))
def test_a_layer_is_packed_voxel_by_voxel(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in (rng.integers(1, 9), *rng.integers(1, 40, 2)))
    marks = np.zeros(shape, np.uint8)
    filled = rng.random(shape) < 10.0 ** rng.uniform(-4, -0.5)
    marks[filled] = rng.integers(1, 64, filled.sum())
    _, rows, row = bricks_of(shape)
    bricks, occupied = (
        np.empty((rows * row, BRICK_BYTES), np.uint8),
        np.empty((rows, row), np.uint8),
    )
    n = pack(marks, bricks, occupied)
    whole = np.zeros((BRICK, rows * BRICK, row * BRICK), np.uint8)
    whole[: shape[0], : shape[1], : shape[2]] = marks
    at = 0
    for y, x in np.ndindex(rows, row):
        part = whole[:, y * BRICK : (y + 1) * BRICK, x * BRICK : (x + 1) * BRICK]
        assert occupied[y, x] == part.any()
        if not part.any():
            continue
        brick = bricks[at].reshape(BRICK, BRICK, BRICK)
        np.testing.assert_array_equal(brick & (DARK - 1), part)
        for cube in np.ndindex(2, 2, 2):
            i, j, k = (slice(4 * c, 4 * c + 4) for c in cube)
            assert (brick[i, j, k] & DARK != 0).all() == (not part[i, j, k].any())
            assert (brick[i, j, k] & DARK == 0).all() == part[i, j, k].any()
        at += 1
    assert n == at


@given(seed=st.integers(0, 2**32))
def test_the_table_has_each_brick_or_says_how_much_is_empty(seed):
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 8, 3))
    occupied = (rng.random(shape) < 10.0 ** rng.uniform(-2, 0)).astype(np.uint8)
    table = table_of(occupied)
    assert table[occupied == 1].tolist() == list(range(occupied.sum()))
    for at in np.ndindex(shape):
        if not occupied[at]:
            cube = tuple(slice(c & ~1, (c & ~1) + 2) for c in at)
            assert table[at] == (-1 if occupied[cube].any() else -2)


@given(bricks=st.lists(st.integers(0, 50), min_size=1, max_size=40), room=st.integers(0, 100))
def test_slabs_hold_what_fits_and_a_layer_at_least(bricks, room):
    cuts = cuts_of(np.array(bricks), room)
    assert cuts[0] == 0 and cuts[-1] == len(bricks)
    for first, last in itertools.pairwise(cuts):
        assert first < last and (sum(bricks[first:last]) <= room or last == first + 1)
        if last < len(bricks):  # one more would not fit
            assert sum(bricks[first : last + 1]) > room


@given(
    layered=st.tuples(*[st.integers(1, 70)] * 3), most=st.integers(1, 40_000)
)  # fmt: skip
def test_subspaces_are_all_of_the_grid_once(layered, most):
    seen = np.zeros(layered, np.uint8)
    begins = []
    for begin, end in subspaces(layered, most):
        size = np.subtract(end, begin)
        assert (size > 0).all() and not np.mod(begin, BRICK).any()
        assert np.prod(size) <= max(most, BRICK**3)
        seen[tuple(slice(a, b) for a, b in zip(begin, end, strict=True))] += 1
        begins.append(begin)
    assert (seen == 1).all()
    assert begins == sorted(begins)


@pytest.mark.parametrize("most", [10**6, 125_000, 20_000, 512])
def test_subspaces_are_near_cubes(most):
    sides = [np.subtract(end, begin) for begin, end in subspaces((100, 100, 100), most)]
    assert max(side.max() for side in sides) <= 2 * BRICK * (most ** (1 / 3) // BRICK + 1)
