"""Bricks of marks: packed, kept, found again; and slabs of them, by brute force."""

from __future__ import annotations

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bfrt.grid.bricks import BRICK, BRICK_BYTES, pack
from bfrt.grid.marks_layout import bricks_of
from bfrt.grid.partition import subspaces
from bfrt.grid.slabs import cuts_of, table_of

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


@given(layered=st.tuples(*[st.integers(1, 400)] * 3), most=st.integers(1, 1 << 26))
def test_subspaces_are_all_layers_once(layered, most):
    layer = layered[1] * layered[2]
    reached = 0
    for first, end in subspaces(layered, most):
        assert first == reached < end
        assert end % BRICK == 0 or end == layered[0]
        assert (end - first) * layer <= max(most, BRICK * layer)
        reached = end
    assert reached == layered[0]
    fit = max(1, most // (BRICK * layer)) * BRICK
    assert len(list(subspaces(layered, most))) == -(-layered[0] // fit)
