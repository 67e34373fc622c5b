"""Bounds and outliers are what their definition says, however the boxes come in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.store._bounds import LARGEST
from bfrt.store.extent import FLATTEST, NOTHING, Bounds, Extent, bounds_of, bounds_of_points

EMPTY = [np.inf] * 3 + [-np.inf] * 3


def random_boxes(rng, n, ties):
    """Boxes of very different sizes; with `ties` of few sizes, so that ids decide."""
    if ties:
        center = rng.integers(-3, 4, (n, 3)) * 4.0
        half = rng.choice([0.5, 1.0, 64.0], (n, 1), p=[0.7, 0.25, 0.05])
    else:
        center = rng.uniform(-10, 10, (n, 3))
        half = 10.0 ** rng.uniform(-3, 3, (n, 3))
    boxes = np.hstack([center - half, center + half]).astype(np.float32)
    boxes[rng.random(n) < 0.1] = EMPTY
    return boxes


def slow_outliers(boxes, ids):
    """The rule as DESIGN states it: largest first, out go those without which volume halves."""
    sizes = [sum(max(float(b[k + 3]) - float(b[k]), 0.0) ** 2 for k in range(3)) for b in boxes]
    order = sorted(range(len(boxes)), key=lambda i: (-sizes[i], ids[i]))

    def volume(kept):
        whole = [b for b in (boxes[i] for i in kept) if b[0] <= b[3]]
        if not whole:
            return None
        lo = [min(float(b[k]) for b in whole) for k in range(3)]
        hi = [max(float(b[k + 3]) for b in whole) for k in range(3)]
        sides = [b - a for a, b in zip(lo, hi, strict=True)]
        diagonal = sum(s * s for s in sides) ** 0.5
        return np.prod([max(s, FLATTEST * diagonal) for s in sides])

    out, best = 0, volume(order)
    for k in range(1, min(LARGEST, len(order)) + 1):
        now = volume(order[k:])
        if now is not None and best > 0 and now <= best / 2:
            out, best = k, now
    return sorted(int(ids[i]) for i in order[:out]), order[out:]


def gathered(boxes, ids, blocks):
    extent = Extent()
    for block in blocks:
        for box, id in zip(boxes[block], ids[block], strict=True):  # ids may have gaps
            extent.add(box[None], id)
    return extent


@pytest.mark.parametrize("ties", [False, True])
@given(seed=st.integers(0, 2**32), n=st.integers(0, 300))
def test_outliers_against_the_rule(ties, seed, n):
    rng = np.random.default_rng(seed)
    boxes, ids = random_boxes(rng, n, ties), np.sort(rng.permutation(1000)[:n]).astype(np.uint64)
    found, grid = gathered(boxes, ids, [slice(None)]).outliers()
    expected, kept = slow_outliers(boxes, ids)
    assert found == expected
    same(grid, bounds_of(boxes[kept]))


@pytest.mark.parametrize("ties", [False, True])
@given(data=st.data(), seed=st.integers(0, 2**32), n=st.integers(1, 300))
def test_blocks_and_their_order_do_not_matter(ties, data, seed, n):
    rng = np.random.default_rng(seed)
    boxes, ids = random_boxes(rng, n, ties), np.arange(n, dtype=np.uint64)
    cuts = sorted(data.draw(st.lists(st.integers(0, n), max_size=8)))
    blocks = [slice(a, b) for a, b in zip([0, *cuts], [*cuts, n], strict=True)]
    blocks = data.draw(st.permutations(blocks))
    one, other = gathered(boxes, ids, [slice(None)]), gathered(boxes, ids, blocks)
    same(one.bounds, other.bounds)
    assert one.outliers()[0] == other.outliers()[0]
    same(one.outliers()[1], other.outliers()[1])


@pytest.mark.parametrize("late_first", [False, True])
def test_ties_for_the_last_place_are_decided_by_id(late_first):
    """70 boxes of one size, of which only 64 are kept: those of the lowest ids, far out."""
    boxes = np.zeros((70, 6), np.float32)
    boxes[:64, :3] = np.random.default_rng(1).integers(-1000, 1000, (64, 3))
    boxes[:, 3:] = boxes[:, :3] + 1
    ids = np.arange(70, dtype=np.uint64)
    blocks = [slice(0, 6), slice(6, 64), slice(64, 70)]
    found, grid = gathered(boxes, ids, blocks[::-1] if late_first else blocks).outliers()
    assert found == list(range(64))
    same(grid, Bounds(np.zeros(3), np.ones(3)))


def same(one, other):
    np.testing.assert_array_equal(one.lo, other.lo)
    np.testing.assert_array_equal(one.hi, other.hi)


def test_a_ground_polygon_stays_out():
    rng = np.random.default_rng(1)
    center = rng.uniform(-1, 1, (500, 3))
    boxes = np.hstack([center - 0.1, center + 0.1]).astype(np.float32)
    boxes[200] = [-500, -500, -1, 500, 500, -1]
    found, grid = gathered(boxes, np.arange(500, dtype=np.uint64), [slice(None)]).outliers()
    assert found == [200]
    same(grid, bounds_of(np.delete(boxes, 200, axis=0)))


def test_two_that_cover_each_other_go_together():
    boxes = np.array([[-9] * 3 + [9] * 3, [-8] * 3 + [8] * 3] + [[0] * 3 + [1] * 3] * 5, "f4")
    found, grid = gathered(boxes, np.arange(7, dtype=np.uint64), [slice(None)]).outliers()
    assert found == [0, 1]
    same(grid, Bounds(np.zeros(3), np.ones(3)))


def test_no_object_is_left_without_a_grid():
    """Each of a geometric row halves the volume; the last stays all the same."""
    sides = 4.0 ** -np.arange(10)
    boxes = np.array([[0, 0, 0, s, s, s] for s in sides], np.float32)
    found, grid = gathered(boxes, np.arange(10, dtype=np.uint64), [slice(None)]).outliers()
    assert found == list(range(9))
    same(grid, bounds_of(boxes[9:]))


def test_points_in_one_place_are_no_outliers():
    boxes = np.zeros((5, 6), np.float32)
    found, grid = gathered(boxes, np.arange(5, dtype=np.uint64), [slice(None)]).outliers()
    assert found == []
    same(grid, Bounds(np.zeros(3), np.zeros(3)))


def test_the_largest_boxes_do_not_overflow():
    most = np.finfo(np.float32).max
    boxes = np.array([[-most] * 3 + [most] * 3, [0] * 3 + [1] * 3], np.float32)
    with np.errstate(all="raise"):
        found, _ = gathered(boxes, np.arange(2, dtype=np.uint64), [slice(None)]).outliers()
    assert found == [0]


def test_degenerate_objects_add_nothing():
    extent = gathered(np.array([EMPTY] * 3, np.float32), np.arange(3, dtype=np.uint64), [slice(3)])
    assert extent.bounds.empty
    assert extent.outliers()[0] == []
    assert extent.outliers()[1].empty


def test_nothing_at_all():
    assert Extent().bounds.empty
    assert Extent().outliers()[0] == []
    assert Extent().outliers()[1].empty
    assert NOTHING.diagonal == 0.0
    assert bounds_of(np.empty((0, 6), np.float32)).empty


@given(st.integers(1, 300), st.integers(0, 1000))
def test_bounds_are_the_least_and_the_greatest(n, seed):
    boxes = random_boxes(np.random.default_rng(seed), n, ties=seed % 2)
    same(bounds_of(boxes), Bounds(boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)))
    points = np.ascontiguousarray(boxes[:, :3])
    same(bounds_of_points(points), Bounds(points.min(axis=0), points.max(axis=0)))
    assert bounds_of_points(points[:0]).empty


def test_a_flat_scene_has_a_grid():
    flat = Bounds(np.array([0.0, 0.0, 5.0]), np.array([3.0, 4.0, 5.0]))
    assert flat.diagonal == 5.0
    np.testing.assert_array_equal(flat.grid_sides(), [3.0, 4.0, 5.0 * FLATTEST])
