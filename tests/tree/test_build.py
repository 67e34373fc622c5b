"""Treelets have every object once, and their nodes contain what is below them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bfrt.records import NODE
from bfrt.reference._tree import TopTree, node_sides
from bfrt.treelets.build import TreeletBuilder

INNER = 255
COORDINATES = st.floats(-1, 1, width=32) | st.sampled_from([0.0, 2.0**120, -(2.0**120), 2.0**-140])


def boxes_of(corners):
    return np.concatenate([corners.min(1), corners.max(1)], 1)


def check(boxes, treelet, leaf):
    """Build, and look at everything."""
    builder = TreeletBuilder(treelet, leaf)
    nodes, treelets, order = builder.build(boxes)
    assert nodes.dtype == NODE
    assert sorted(order) == list(range(len(boxes)))
    empty = (boxes[:, :3] > boxes[:, 3:]).any(1)
    assert treelets["nodes"].sum() == len(nodes)
    if empty.all():
        assert len(treelets) == 0
        return
    ends = treelets["first"] + treelets["count"]
    assert treelets["first"][0] == 0
    assert (treelets["first"][1:] == ends[:-1]).all()
    assert ends[-1] == len(boxes) - empty.sum()
    assert empty[order[ends[-1] :]].all()
    for one in treelets:
        objects = order[int(one["first"]) : int(one["first"] + one["count"])]
        valid = objects[~empty[objects]]
        assert len(valid) <= treelet
        lo, hi = boxes[valid, :3].min(0), boxes[valid, 3:].max(0)
        assert [one[k] for k in ("lox", "loy", "loz", "hix", "hiy", "hiz")] == [*lo, *hi]
        own = nodes[int(one["node"]) : int(one["node"] + one["nodes"])]
        seen = below(own, 0, boxes[objects], leaf)
        assert sorted(seen) == list(range(len(valid)))
        assert len(valid) == len(objects)


def below(nodes, number, boxes, leaf):
    """The objects below a node, each of which has its box in those of all nodes above it."""
    node = nodes[number]
    sides = node_sides(nodes[number : number + 1].view(np.uint8))
    found, child, first = [], int(node["child"]), int(node["first"])
    for i, count in enumerate(node["count"]):
        if count == INNER:
            assert node["inner"] >> i & 1
            own = below(nodes, child, boxes, leaf)
            child += 1
        else:
            assert not node["inner"] >> i & 1
            assert count <= leaf
            own = list(range(first, first + int(count)))
            first += int(count)
        some = boxes[own].astype(float)
        assert (sides[i, :3] <= some[:, :3]).all()
        assert (sides[i, 3:] >= some[:, 3:] - 2.0**-50 * abs(some).max(initial=0)).all()
        found += own
    assert sorted(found) == list(range(int(node["first"]), int(node["first"]) + len(found)))
    return found


@given(
    arrays(np.float32, st.tuples(st.integers(1, 60), st.just(2), st.just(3)), elements=COORDINATES),
    st.integers(1, 20),
    st.integers(1, 4),
)
def test_small_scenes(corners, treelet, leaf):
    check(boxes_of(corners), max(treelet, leaf), leaf)


@pytest.mark.parametrize("shape", ["spread", "one place", "a line", "growing", "empty ones"])
def test_scenes(shape):
    rng = np.random.default_rng(1)
    n = 5000
    place = {
        "spread": rng.uniform(-1, 1, (n, 1, 3)),
        "one place": np.zeros((n, 1, 3)),
        "a line": rng.uniform(-1, 1, (n, 1, 1)) * [1.0, 0.0, 0.0],
        "growing": 2.0 ** rng.uniform(-100, 100, (n, 1, 1)) * [1.0, 1.0, 1.0],
        "empty ones": rng.uniform(-1, 1, (n, 1, 3)),
    }[shape]
    boxes = boxes_of((place + rng.uniform(-0.01, 0.01, (n, 2, 3))).astype(np.float32))
    if shape == "empty ones":
        gone = rng.random(n) < 0.1
        boxes[gone, :3], boxes[gone, 3:] = np.inf, -np.inf
    check(boxes, 256, 4)


def test_nothing_but_empty_boxes():
    boxes = np.full((7, 6), np.inf, np.float32)
    boxes[:, 3:] = -np.inf
    check(boxes, 16, 4)


def entries(boxes, origin, direction, reach):
    """Brute force: when a ray enters each box that it meets, ascending by (t, box)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inv = 1.0 / direction
        a, b = (boxes[:, :3] - origin) * inv, (boxes[:, 3:] - origin) * inv
    near, far = np.minimum(a, b).max(1).clip(0), np.maximum(a, b).min(1)
    met = np.flatnonzero((near <= far) & (near <= reach))
    return sorted((near[i], i) for i in met)


@pytest.mark.parametrize("most", [1, 2, 7, 64])
@pytest.mark.parametrize("plain", [True, False], ids=["plain", "wide"])
def test_treelets_come_in_the_order_of_entry_once_each(plain, most):
    rng = np.random.default_rng(2)
    corners = rng.uniform(-5, 5, (700, 1, 3)) + rng.uniform(-1, 1, (700, 2, 3))
    corners[100:110] = corners[100]  # that are entered together
    boxes = boxes_of(corners.astype(np.float32))
    nodes, _, leaves = TreeletBuilder(len(boxes), 1).build(boxes)
    tree = TopTree(nodes.view(np.uint8), leaves, boxes, plain)
    for _ in range(60):
        origin, direction = rng.uniform(-6, 6, 3), rng.normal(size=3)
        reach = rng.choice([np.inf, 3.0])
        expected, first, found = entries(boxes, origin, direction, reach), (-1.0, 0), []
        ray = origin, direction
        while True:
            some = tree.next(ray, first, reach, most)
            found += some
            if len(some) < most:
                break
            first = some[-1][0], some[-1][1] + 1
        assert found == expected


def test_boxes_as_far_apart_as_float32_goes():
    """Their differences are infinite; each is in one treelet all the same."""
    rng = np.random.default_rng(6)
    for axes in ([0], [1, 2], [0, 1, 2]):
        places = rng.uniform(-1, 1, (5000, 3)).astype(np.float32)
        places[:, axes] = rng.choice(np.float32([-3.4e38, -1.0, 0.0, 3.4e38]), (5000, len(axes)))
        _, treelets, order = TreeletBuilder().build(np.hstack([places, places]))
        assert sorted(order) == list(range(5000))
        assert treelets["count"].sum() == 5000
