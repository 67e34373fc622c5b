"""Up to four workers, with a memory cgroup each, and killed too: the bits of one process.

A scene is asked for in all its forms: one store, which each worker has, and shards, of which each
has some.
"""

from __future__ import annotations

import dataclasses
import os
import signal
from contextlib import contextmanager
from functools import partial

import dask.array as da
import numpy as np
import pytest
from capped import peak_of
from capped_workers import capped_workers
from cluster_fixtures import NEEDED, wait_until
from sharded_scenes import assert_same_answer, assert_same_picture, standard

import bfrt

pytest.importorskip("distributed", reason=NEEDED)

#: A worker's budget, and what its cgroup has: beside the budget are Dask and its other process.
BUDGET = "128MiB"
CAP = 512 << 20
LEAST = 32 << 20

SETTINGS = {"memory": BUDGET, "threads": 1}
AOVS = ("position", "albedo")

#: A way, and the order of a store for it.
WAYS = {"base": "given", "sgb": "given", "tree": "spatial"}


@contextmanager
def capped_client(workers, folder, *, needed=True):
    """A client of workers whose cgroups were filled, but not more than that.

    Where none can be made it is skipped. Where they are not needed workers are not replaced either,
    so that there are half as many processes.
    """
    folder.mkdir()
    with capped_workers(workers, CAP, folder, replaced=needed) as (client, groups):
        if needed and None in groups:
            pytest.skip("no memory cgroup can be made: that takes root, and a writable /sys/fs")
        yield client
        for group in filter(None, groups):
            assert LEAST < peak_of(group) <= CAP


#: Sizes of the scenes, but 3: those of less than a thousand objects.
SIZES = {"gears": 1, "rings": 2}


def small(name, side):
    """A standard scene, its camera, and rays between points of its bounds."""
    recipe = bfrt.spd.scene(name, SIZES.get(name, 3))
    return recipe, dataclasses.replace(recipe.camera, resolution=(side, side))


def some_rays(scene, count=900):
    rng = np.random.default_rng(4)
    origins, targets = rng.uniform(*scene.bounds, (2, count, 3))
    return origins, targets - origins


def killer(client, killed):
    """A report that kills a worker once some rays are through: its address goes to `killed`."""
    address, process = next(iter(client.run(os.getpid).items()))

    def report(progress):
        if not killed and (progress.done or progress.depth > 1):
            killed.append(address)
            os.kill(process, signal.SIGKILL)

    return report


def assert_all_forms(client, both, way, camera):
    """Pictures and answers of a store, of its shards by workers with all, and with some of them."""
    settings = {**SETTINGS, "refine": way}
    expected = both.one.render(camera=camera, aovs=AOVS, **settings)
    far = bfrt.open(both.sharded.path, client=client)
    for found in (
        both.sharded.render(camera=camera, aovs=AOVS, **settings),
        both.one.render(camera=camera, aovs=AOVS, client=client, **settings),
        both.sharded.render(camera=camera, aovs=AOVS, client=client, **settings),
        far.render(camera=camera, aovs=AOVS, **settings),
    ):
        assert_same_picture(found, expected)
        assert found.stats.total.rays == expected.stats.total.rays
    rays = some_rays(both.one)
    answer = both.one.cast_rays(*rays, **settings)
    assert_same_answer(far.cast_rays(*rays, **settings), answer)
    lazy = (da.from_array(part, chunks=(300, 3)) for part in rays)
    hits = both.one.cast_rays(*lazy, **settings)
    assert_same_answer(client.compute(hits).result(), answer)
    return expected


def assert_a_kill_changes_nothing(client, render, expected):
    """A worker is killed while it renders, and is replaced."""
    workers, killed = len(client.nthreads()), []
    assert_same_picture(render(progress=killer(client, killed)), expected)
    assert killed
    wait_until(lambda: killed[0] not in client.nthreads())
    wait_until(lambda: len(client.nthreads()) == workers)


def renders(client, both, way, camera):
    """Renders that take a report: of a store, and of shards that each worker has some of."""
    settings = {**SETTINGS, "refine": way, "camera": camera, "aovs": AOVS}
    return (
        partial(both.one.render, client=client, **settings),
        partial(bfrt.open(both.sharded.path, client=client).render, **settings),
    )


def test_four_workers_of_eight_shards(tmp_path):
    """One of them is killed in the middle, and its shards are taken over."""
    _, camera = small("gears", 16)
    both = standard(tmp_path / "scene", bfrt.spd.scene("gears", 2), 8)
    expected = both.one.render(refine="sgb", camera=camera, aovs=AOVS, **SETTINGS)
    with capped_client(4, tmp_path / "workers", needed=False) as client:
        _, render = renders(client, both, "sgb", camera)
        killed = []
        assert_same_picture(render(progress=killer(client, killed)), expected)
        wait_until(lambda: len(client.nthreads()) == 3)
    assert killed
    rays = expected.stats.total.rays
    assert rays.reflection and rays.refraction and rays.shadow


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2, 4])
@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_all_standard_scenes(tmp_path, name, workers):
    """In 1 to 8 shards, and a worker is killed in each."""
    recipe, camera = small(name, 24)
    with capped_client(workers, tmp_path / "workers") as client:
        for shards, way in zip((8, 3, 2 * workers), WAYS, strict=True):
            both = standard(tmp_path / way, recipe, shards, WAYS[way])
            expected = assert_all_forms(client, both, way, camera)
            for render in renders(client, both, way, camera):
                assert_a_kill_changes_nothing(client, render, expected)


@pytest.mark.slow
@pytest.mark.parametrize("shards", range(1, 9))
def test_every_number_of_shards(tmp_path, shards):
    recipe, camera = small("teapot", 24)
    with capped_client(2, tmp_path / "workers") as client:
        for way, order in WAYS.items():
            both = standard(tmp_path / way, recipe, shards, order)
            assert_all_forms(client, both, way, camera)
