"""A sketch of a treelet has all of its objects, once, in boxes that contain them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.records import NODE
from bfrt.reference._tree import drawn, node_sides
from bfrt.treelets.build import TreeletBuilder

INNER = 255
MOST_BELOW = 127


def treelet_of(n, seed, leaf=4):
    """The boxes of a treelet's objects, in its order, and its nodes: dense here, empty there."""
    rng = np.random.default_rng(seed)
    centers = rng.uniform(-1, 1, (n, 3)) ** 5
    corners = centers[:, None] + rng.uniform(-0.01, 0.01, (n, 2, 3))
    boxes = np.concatenate([corners.min(1), corners.max(1)], 1).astype(np.float32)
    nodes, treelets, order = TreeletBuilder(1024, leaf).build(boxes)
    assert len(treelets) == 1
    return boxes[order], nodes.copy()


def check_below(sketch, begins, number, boxes, times):
    """Count the objects below a node, and see that their boxes are in those of its children."""
    node = sketch[number].view(NODE)[0]
    sides, child, found = node_sides(sketch[number]), int(node["child"]), []
    for c, count in enumerate(node["count"]):
        if count == INNER:
            own = check_below(sketch, begins, child, boxes, times)
            child += 1
        else:
            own = list(range(int(begins[number, c]), int(begins[number, c]) + int(count)))
            times[own] += 1
        some = boxes[own].astype(float)
        assert (sides[c, :3] <= some[:, :3]).all()
        assert (sides[c, 3:] >= some[:, 3:] - 2.0**-50).all()
        found += own
    return found


@given(st.integers(1, 1024), st.integers(0, 1000), st.integers(4, 9))
def test_each_object_is_below_one_leaf(n, seed, most):
    boxes, nodes = treelet_of(n, seed)
    found = drawn(nodes.view(np.uint8), n, most)
    if found is None:
        assert n > MOST_BELOW
        return
    times = np.zeros(n, int)
    check_below(*found, 0, boxes, times)
    assert (times == 1).all()


def test_most_treelets_are_drawn():
    found = [drawn(treelet_of(900, seed)[1].view(np.uint8), 900, 9) for seed in range(50)]
    assert sum(one is not None for one in found) > 45


def test_what_does_not_lie_together_is_not_drawn():
    _, nodes = treelet_of(500, 1)
    inner = np.flatnonzero(nodes["count"][0] == INNER)
    assert len(inner) > 1
    first = int(nodes["child"][0])
    one, other = nodes["first"][first], nodes["first"][first + 1]
    nodes["first"][first], nodes["first"][first + 1] = other, one
    assert drawn(nodes.view(np.uint8), 500, 9) is None


@pytest.mark.parametrize(("nodes", "objects"), [(1025, 1025), (1, 0x10000)])
def test_what_is_too_large_is_not_drawn(nodes, objects):
    assert drawn(np.zeros(nodes, NODE).view(np.uint8), objects, 9) is None
