"""Nodes cull conservatively: whatever they round, no box that a ray meets is left out."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bfrt.reference._tree import box_met, node_met, node_of, node_sides

FINITE = st.floats(-(2.0**100), 2.0**100, width=32)
COORDINATES = FINITE | st.integers(-4, 4).map(float) | st.floats(-1, 1, width=32)


@st.composite
def boxes(draw, most=8):
    n = draw(st.integers(1, most))
    corners = draw(arrays(np.float32, (n, 2, 3), elements=COORDINATES))
    return np.concatenate([corners.min(1), corners.max(1)], 1)


def around(made):
    return np.concatenate([made[:, :3].min(0), made[:, 3:].max(0)])


@given(boxes())
def test_quantised_boxes_contain_the_boxes(made):
    sides = node_sides(node_of(made))[: len(made)]
    lo, hi = made[:, :3].astype(float), made[:, 3:].astype(float)
    assert (sides[:, :3] <= lo).all()
    # What the difference of the ends rounds away, a walk has room for.
    assert (sides[:, 3:] >= hi - 2.0**-50 * (abs(hi) + abs(lo))).all()


@given(boxes())
def test_quantised_boxes_are_not_much_larger(made):
    sides = node_sides(node_of(made))[: len(made)]
    extent = (made[:, 3:].max(0).astype(float) - made[:, :3].min(0)) + 2.0**-110
    slack = extent / 255 * 2.001
    assert (sides[:, :3] >= made[:, :3] - slack).all()
    assert (sides[:, 3:] <= made[:, 3:] + slack).all()


NUMBERS = st.floats(-(2.0**60), 2.0**60) | st.integers(-4, 4).map(float) | st.floats(-1, 1)
PARTS = NUMBERS | st.sampled_from([0.0, 1e-300, -1e-300, 2.0**-64, 2.0**64, 5e-324])


@pytest.mark.parametrize("plain", [True, False], ids=["plain", "wide"])
@given(
    boxes(),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(PARTS, PARTS, PARTS),
    st.sampled_from([0.0, 2.0**-30, 1.0]),
    st.sampled_from([np.inf, 1.0, 100.0, 2.0**70]),
)
def test_what_a_ray_meets_is_never_left_out(plain, made, origin, direction, grow, reach):
    assume(any(direction))
    met, near = node_met(node_of(made), around(made), (origin, direction), grow, reach, plain)
    assert met < 1 << len(made)
    for i, box in enumerate(made):
        span = box_met(box, origin, direction, grow)
        if span is not None and span[0] <= reach:
            assert met >> i & 1
            assert near[i] <= span[0]


@pytest.mark.parametrize("plain", [True, False], ids=["plain", "wide"])
def test_what_is_far_beside_is_left_out(plain):
    rng = np.random.default_rng(0)
    corners = rng.uniform(-3, 3, (1000, 8, 1, 3)) + rng.uniform(-1, 1, (1000, 8, 2, 3))
    made = np.concatenate([corners.min(2), corners.max(2)], 2).astype(np.float32)
    met = there = 0
    for some in made:
        origin, direction = rng.uniform(-4, 4, 3), rng.normal(size=3)
        bits, _ = node_met(node_of(some), around(some), (origin, direction), 0.0, np.inf, plain)
        met += bits.bit_count()
        there += sum(box_met(box, origin, direction, 0.0) is not None for box in some)
    assert there <= met <= 1.1 * there
