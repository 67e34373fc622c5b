"""Boxes: rounding outwards, and the slab test."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import units

from bfrt.records import Kind
from bfrt.reference import _kernels
from bfrt.store._bounds import bound

CUBE = [-1.0, -1, -1, 1, 1, 1]
NOWHERE = [np.inf, -np.inf]


def span(box, origin, direction, padding=0.0):
    boxes = np.array([box], np.float32)
    origins, directions = np.array([origin], float), np.array([direction], float)
    return _kernels.spans(boxes, padding, origins, directions)[0]


def test_bounds_are_the_nearest_float32_outside():
    rng = np.random.default_rng(0)
    tops = np.concatenate([
        10 ** rng.uniform(-46, 38, 3000) * rng.choice([-1, 1], 3000),
        [0.0, -0.0, 1.0, 1e-45, 1e-46, -1e-46, 3.4e38, 1 + 2.0**-24, -1 - 2.0**-24],
    ])  # fmt: skip
    corners = np.zeros((len(tops), 3, 3))
    corners[:, 0] = tops[:, None]
    corners[:, 1] = tops[:, None] * [1, 0, 0]  # zero is a coordinate of every triangle
    boxes = np.empty((len(tops), 6), np.float32)
    records, none = corners.reshape(-1, 9), np.zeros(len(tops), np.uint32)
    bound(Kind.TRIANGLE, records, none, (0, 0, 0), boxes)
    full = boxes[:, 0] <= boxes[:, 3]  # the squares of the least vanish: degenerate
    assert full.sum() > 2000
    low, high = np.minimum(tops, 0)[full], np.maximum(tops, 0)[full]
    up, down = np.float32(np.inf), np.float32(-np.inf)
    for axis in range(3):
        assert (boxes[full, axis] <= low).all()
        assert (np.nextafter(boxes[full, axis], up) > low).all()
        assert (boxes[full, 3 + axis] >= high).all()
        assert (np.nextafter(boxes[full, 3 + axis], down) < high).all()


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        ((-3, 0, 0), (1, 0, 0), [2, 4]),
        ((-3, 0, 0), (-1, 0, 0), NOWHERE),
        ((0, 0, 0), (0, 0, 4), [0, 0.25]),
        ((-3, 1, 0), (1, 0, 0), [2, 4]),  # in a face
        ((-3, 1, 1), (1, -0.0, 0), [2, 4]),  # in an edge
        ((-3, 1.0000001, 0), (1, 0, 0), NOWHERE),
        ((-3, -3, -3), (1, 1, 1), [2, 4]),  # by its corners
        ((-3, -1, 0), (1, 1, 0), [2, 2]),  # touches an edge
        ((1, 0, 0), (1, 0, 0), [0, 0]),  # leaves at once
    ],
)
def test_by_hand(origin, direction, expected):
    np.testing.assert_array_equal(span(CUBE, origin, direction), expected)


def test_growing_is_a_larger_box():
    rng = np.random.default_rng(1)
    boxes = np.tile(np.array(CUBE, np.float32), (500, 1))
    larger = (boxes * 2).astype(np.float32)
    origins, directions = rng.normal(size=(500, 3)) * 3, units(rng, 500)
    np.testing.assert_array_equal(
        _kernels.spans(boxes, 1.0, origins, directions),
        _kernels.spans(larger, 0.0, origins, directions),
    )
