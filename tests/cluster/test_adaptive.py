"""A cluster that Dask scales by what there is to do: the bits of one process."""

from __future__ import annotations

import dask.array as da
import pytest
from cluster_fixtures import (
    MEMORY,
    NEEDED,
    assert_same_answer,
    assert_same_picture,
    some_rays,
    wait_until,
)

import bfrt

distributed = pytest.importorskip("distributed", reason=NEEDED)


def test_workers_come_and_go(paths):
    """None is there at first, nor between two pieces of work."""
    scene = bfrt.open(paths["spatial"])
    settings = {"n_workers": 0, "processes": False, "dashboard_address": ":0", "memory_limit": 0}
    with distributed.LocalCluster(**settings) as cluster, distributed.Client(cluster) as client:
        cluster.adapt(minimum=0, maximum=2, interval="50ms", wait_count=2)
        found = scene.render(client=client, memory=MEMORY)
        assert_same_picture(found, scene.render(memory=MEMORY))
        wait_until(lambda: not client.nthreads())
        rays = [da.from_array(part, chunks=(500, 3)) for part in some_rays(2000)]
        answer = client.compute(scene.cast_rays(*rays, memory=MEMORY)).result()
        assert_same_answer(answer, scene.cast_rays(*some_rays(2000), memory=MEMORY))
        wait_until(lambda: not client.nthreads())
        assert_same_picture(scene.render(client=client, memory=MEMORY), found)
