"""A ray comes to each treelet that it enters before its hit once, in the order of entry."""

from __future__ import annotations

from collections import defaultdict

import fast
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scenes import random_objects, random_rays
from treelets import pair

from bfrt.phases.preprocess import padding_of
from bfrt.records import HIT, NO_HIT, RayKind
from bfrt.reference._tree import TopTree, box_met
from bfrt.tree.forest import Forest, table_of
from bfrt.tree.rays import TreeRays
from bfrt.treelets.build import TreeletBuilder

#: Many on a lattice, so that boxes are flat, touch, and are entered together.
PLACES = st.integers(-3, 3).map(float) | st.floats(-4, 4, width=32)
PARTS = st.integers(-2, 2).map(float) | st.floats(-2, 2) | st.sampled_from([-0.0, 1e-300, 1e-20])


def entered(boxes, origin, direction, padding, reach):
    """Brute force: when and which boxes are entered by `reach`, ascending by (t, box)."""
    spans = ((box_met(box, origin, direction, padding), i) for i, box in enumerate(boxes))
    return sorted((span[0], i) for span, i in spans if span is not None and span[0] <= reach)


@given(
    st.booleans(),
    st.sampled_from([1, 2, 7, 63]),
    arrays(np.float32, st.tuples(st.integers(1, 30), st.just(2), st.just(3)), elements=PLACES),
    st.tuples(PLACES, PLACES, PLACES),
    st.tuples(PARTS, PARTS, PARTS),
    st.sampled_from([0.0, 2.0**-40, 0.25]),
    st.sampled_from([np.inf, 0.0, 1.0, 2.5]) | st.floats(0, 9),
)
def test_passes_of_any_number_of_candidates(plain, each, corners, origin, way, padding, reach):
    assume(any(way))
    boxes = np.concatenate([corners.min(1), corners.max(1)], 1)
    nodes, _, leaves = TreeletBuilder(len(boxes), 1).build(boxes)
    tree = TopTree(nodes.view(np.uint8), leaves, boxes, plain, padding)
    found, sentinel = [], (-1.0, 0)
    while sentinel is not None:
        some = tree.next((origin, way), sentinel, reach, each + 1)
        sentinel = some.pop() if len(some) == each + 1 else None
        found += some
    assert found == entered(boxes, origin, way, padding, reach)


@pytest.mark.parametrize("each", [1, 2, 7, 100])
def test_rays_in_flight(tmp_path, each):
    """Some have hits from the beginning; each goes when its hit is before its sentinel."""
    rng = np.random.default_rng(51)
    objects = random_objects(rng, 1500)
    store = pair(objects, tmp_path)[1]
    some = random_rays(rng, objects, 12).values()
    origins, ways = (np.concatenate(each) for each in zip(*some, strict=True))
    origins = fast.advanced(store, origins - np.array(store.origin), ways)[0]
    n = len(origins)
    ends = np.where(rng.random(n) < 0.5, np.inf, rng.uniform(0, 3, n))

    padding = padding_of(store)
    rays = TreeRays(Forest(store, padding, False), n, n)
    assert rays.admit(fast.queued(origins, ways, RayKind.REFLECTION), 0, n) == 0
    rays.come(n)
    records, paths = rays.all
    records["t"][:n] = ends
    seen, passes = defaultdict(list), 0
    while rays.active:
        before = rays.active
        rays.begin_pass()
        asked = min(each, rays.room // before)
        rays.collect(0, before, asked)
        who, some, starts = (np.asarray(part).astype(int) for part in rays.by_treelet())
        treelets = np.repeat(some, np.diff(starts))
        assert (np.diff(some) > 0).all()
        assert starts[0] == 0 and (np.diff(starts) > 0).all() and starts[-1] == len(who)
        now = defaultdict(list)
        for treelet, ray in zip(treelets.tolist(), who.tolist(), strict=True):
            now[int(paths["pixel"][ray])].append(treelet)
        for pixel, own in now.items():
            assert len(own) == len(set(own)) <= asked
            seen[pixel].append(own)
        done = np.empty(before, HIT)
        kept, gone, _ = rays.retire(0, before, None, np.zeros(3), done)
        assert kept + gone == before
        assert (done["id"][:gone] == NO_HIT).all()
        rays.compact(0, np.array([0]), np.array([kept]))
        passes += 1
    boxes = np.concatenate([table_of(stream).view(np.float32).reshape(-1, 12)[:, :6]
                            for stream in store.streams])  # fmt: skip
    most = 0
    for ray in range(n):
        expected = [i for _, i in entered(boxes, origins[ray], ways[ray], padding, ends[ray])]
        assert [treelet for one in seen[ray] for treelet in sorted(one)] == [
            treelet
            for first, last in spans_of(seen[ray])
            for treelet in sorted(expected[first:last])
        ]
        assert sum(map(len, seen[ray])) == len(expected)
        most = max(most, len(expected))
    assert most > 20
    assert passes >= most / max(each, 1) / 2 or each > 7


def spans_of(parts):
    """Where each of some lists begins and ends, one after another."""
    ends = np.cumsum([len(part) for part in parts], dtype=int).tolist()
    return zip([0, *ends], ends, strict=False)
