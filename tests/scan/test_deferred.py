"""Rays that wait for geometry: more than there is room for, of objects that are met by many."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest

import bfrt
from bfrt.records import DELAYED_BYTES
from bfrt.reference import exhaustive
from bfrt.scan.deferred import DELAYS_BYTES
from bfrt.store.store import open_store

#: So many rays wait before the first are settled.
ROOM = DELAYS_BYTES // DELAYED_BYTES


def squares(writer, z, polygons):
    """Squares above each other, as triangles or as polygons of five vertices."""
    for height in z:
        a, b, c, d = (np.array([x, y, height]) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
        if polygons:
            writer.polygons(np.array([a, (a + b) / 2, b, c, d]), [5])
        else:
            writer.triangles(np.array([[a, b, c], [a, c, d]]))


@pytest.mark.parametrize("polygons", [False, True])
@pytest.mark.parametrize("refine", ["sg", "sgb"])
@pytest.mark.parametrize("threads", [1, 2])
def test_many_rays_wait_for_few_objects(tmp_path, polygons, refine, threads):
    """An object is then the last of one half, and the first of the other."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        squares(writer, [0.0, 0.25, 0.5], polygons)
    store = fast.gridded(open_store(tmp_path / "a.bfrt"))
    random = np.random.default_rng(3)
    origins = np.c_[random.random((3 * ROOM, 2)), np.full(3 * ROOM, 2.0)]
    origins -= np.array(store.origin)
    directions = np.c_[random.normal(0, 0.01, (3 * ROOM, 2)), np.full(3 * ROOM, -1.0)]
    t, ids = exhaustive.nearest(store, origins, directions)
    assert (ids != np.uint64(2**64 - 1)).sum() > 2.9 * ROOM
    capacities = replace(fast.ROOMY, rays=1 << 15, threads=threads)
    found = fast.nearest(store, origins, directions, tmp_path, capacities, refine)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.ids, ids)
    assert found.counters.object_tests > 2 * ROOM
