"""Whether an order is local: along a curve it is, at random it is not, however many windows."""

from __future__ import annotations

import numpy as np
import pytest

from bfrt.store import locality
from bfrt.store.locality import Locality, threshold
from bfrt.store.ordering._loops import codes_of

#: Objects of a window.
TOGETHER = 64


@pytest.fixture(autouse=True)
def small_windows(monkeypatch):
    monkeypatch.setattr(locality, "TOGETHER", TOGETHER)


def measured(boxes, block=1000):
    made = Locality()
    for first in range(0, len(boxes), block):
        made.add(boxes[first : first + block])
    return made


def random_boxes(windows, seed, sides=(1.0, 1.0, 1.0)):
    centers = np.random.default_rng(seed).random((windows * TOGETHER - 3, 3)) * sides
    return np.hstack([centers, centers]).astype(np.float32)


def along_curve(boxes, bits=10):
    codes = np.empty(len(boxes), np.uint64)
    codes_of(boxes, [0.0] * 3, [float(1 << bits)] * 3, bits, codes)
    return np.ascontiguousarray(boxes[np.argsort(codes, kind="stable")])


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("windows", [1, 2, 3, 5, 8, 12, 27, 50, 64, 200, 700, 1500])
def test_a_morton_order_is_local(windows, seed):
    assert measured(along_curve(random_boxes(windows, seed))).local


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("windows", [4, 5, 8, 12, 27, 50, 64, 200, 700])
def test_a_random_order_is_not(windows, seed):
    assert not measured(random_boxes(windows, seed)).local


@pytest.mark.parametrize("windows", [8, 64, 500])
def test_rows_of_a_sweep(windows):
    """Slices of a cube have far more surface than cubes would; those of a rod have little."""
    for sides, expected in (((1.0, 1.0, 1.0), windows < 27), ((100.0, 1.0, 1.0), True)):
        boxes = random_boxes(windows, 3, sides)
        assert measured(boxes[np.argsort(boxes[:, 0])]).local == expected


@pytest.mark.parametrize(
    ("windows", "expected"),
    [(1, 2.0), (2, 2.0), (8, 2.0), (12, 2.6), (14, 2.9), (15, 3.0), (10**6, 3.0)],
)
def test_the_threshold_is_of_the_number_of_windows(windows, expected):
    assert round(threshold(windows), 1) == expected
