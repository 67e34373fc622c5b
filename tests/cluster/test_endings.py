"""What a client says where workers, its tasks or it itself end while it waits."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time

import dask
import pytest
from cluster_fixtures import (
    MEMORY,
    NEEDED,
    assert_same_answer,
    assert_same_picture,
    cluster_of,
    end_worker,
    wait_until,
)
from sharded_scenes import assert_same_picture as assert_same_channels
from sharded_scenes import both, rays

import bfrt
from bfrt.cluster.watching import Watch
from bfrt.errors import Cancelled, ResourceError, StoreError

distributed = pytest.importorskip("distributed", reason=NEEDED)


def wait(_):
    time.sleep(0.5)


def wait_or_refuse(number):
    if number:
        raise StoreError("a: found b, expected c")
    time.sleep(2.0)


@pytest.mark.parametrize("how", ["close", "cancel"])
def test_a_client_that_ends(how):
    """Closed by another thread, say, or its tasks are cancelled under our hands."""
    cancelled = pytest.raises(
        Cancelled, match=r"^client: found it closed or restarted, or its task"
    )
    with cluster_of(1, processes=False) as client, cancelled, Watch(client, 0, None) as watch:
        (errand,) = watch.begin(wait, [0], "wait")
        client.cancel(errand.future) if how == "cancel" else client.close()
        watch.result(errand)


def test_a_task_that_workers_do_not_survive():
    """As where the system takes the memory from them."""
    ended = pytest.raises(ResourceError, match=r"found 1 workers to end .* 0 \(tcp://[\d.:]+\), e")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        cluster_of(1) as client,
        ended,
        Watch(client, 0, None) as watch,
    ):
        watch.result(*watch.begin(end_worker, [0], "end"))


def test_the_only_worker_is_killed(tmp_path):
    """Dask leaves a task waiting for a worker that has ended, if there was no other then."""
    one, sharded = both(tmp_path, 2)
    settings = {"memory": "160MiB", "threads": 1, "refine": "base"}
    with cluster_of(1) as client:
        far = bfrt.open(sharded.path, client=client)
        killed = []

        def kill(progress):
            if progress.depth == 2 and progress.done == 0 and not killed:
                (process,) = client.run(os.getpid).values()
                killed.append(process)
                os.kill(process, signal.SIGKILL)
                wait_until(lambda: not client.nthreads())

        found = far.render(progress=kill, **settings)
        assert killed and killed != list(client.run(os.getpid).values())
        assert_same_channels(found, one.render(**settings))
        process = client.run(os.getpid).popitem()[1]
        os.kill(process, signal.SIGKILL)
        wait_until(lambda: not client.nthreads())
        assert_same_answer(far.cast_rays(*rays(), **settings), one.cast_rays(*rays(), **settings))


def test_a_cluster_without_workers_is_waited_for(paths, caplog):
    scene = bfrt.open(paths["spatial"])
    settings = {"n_workers": 0, "processes": False, "dashboard_address": ":0", "memory_limit": 0}
    with distributed.LocalCluster(**settings) as cluster, distributed.Client(cluster) as client:
        scaling = threading.Timer(0.5, cluster.scale, [1])
        scaling.start()
        found = scene.render(client=client, memory=MEMORY)
        scaling.join()
    assert "the cluster has no worker: waiting until there is one" in caplog.messages
    assert_same_picture(found, scene.render(memory=MEMORY))


@pytest.fixture
def noise(caplog):
    """What workers log, as those of this process do."""
    logger = logging.getLogger("distributed.worker")
    level = logger.level
    yield caplog
    logger.removeHandler(caplog.handler)
    logger.setLevel(level)


def test_an_error_of_ours_is_no_noise_of_dasks(noise):
    """It is raised here, at once, though another task goes on; workers show no traceback."""
    with cluster_of(2, processes=False) as client:
        logger = logging.getLogger("distributed.worker")
        logger.addHandler(noise.handler)
        logger.setLevel(logging.INFO)
        with (
            pytest.raises(StoreError, match=r"^a: found b, expected c$"),
            Watch(client, 0, None) as watch,
        ):
            first, _ = watch.begin(wait_or_refuse, [0, 1], "refuse")
            start = time.monotonic()
            watch.result(first)
        assert time.monotonic() - start < 1.5
    assert not [text for text in noise.messages if "Compute Failed" in text]
