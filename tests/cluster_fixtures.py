"""A cluster of two processes for the tests that need one, and scenes for it.

What workers call is in here, where they can import it.
"""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import bfrt

#: Why tests are skipped without Dask.
NEEDED = "needs dask and distributed: pip install bfrt[dask]"

#: What a worker of the tests may take.
LIMIT = 1 << 30

MEMORY = "128MiB"


@contextmanager
def cluster_of(workers: int, *, processes: bool = True, threads: int = 1) -> Iterator[object]:
    """A client of a cluster on this machine."""
    distributed = pytest.importorskip("distributed", reason=NEEDED)
    settings = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    limit = LIMIT if processes else 0  # what the tests' own process holds would pause the worker
    with (
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=threads,
            processes=processes,
            memory_limit=limit,
            **settings,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def shared_client():
    """A client of two worker processes, which the tests of a file share.

    It ends with them: its threads open files, which other tests count.
    """
    with cluster_of(2) as client:
        yield client


def build(path: Path, order: str, size: int = 1) -> bfrt.Scene:
    """Two groups, of spheres and of triangles that mirror and refract, beside each other."""
    rng = np.random.default_rng(7)
    with bfrt.SceneWriter(path, order=order) as writer:
        mirror = writer.material(bfrt.Material((0.9, 0.6, 0.3), kd=0.4, ks=0.6, shine=20.0))
        glass = writer.material(
            bfrt.Material((0.7, 0.8, 1.0), kd=0.2, ks=0.2, transmittance=0.6, ior=1.4)
        )
        numbers = np.array([mirror, glass])
        centers = rng.uniform(-1, 1, (400 * size, 3))
        writer.spheres(centers, 0.07, numbers[rng.integers(2, size=len(centers))], group=0)
        corners = rng.uniform(-1, 1, (300 * size, 1, 3)) + rng.normal(0, 0.1, (300 * size, 3, 3))
        writer.triangles(corners, numbers[rng.integers(2, size=len(corners))], group=1)
        writer.light(bfrt.Light((3.0, -4.0, 5.0)))
        writer.background((0.1, 0.2, 0.3))
        writer.camera(bfrt.Camera((0.5, -3.5, 1.0), (0, 0, 0), (0, 0, 1), 45, 0, (48, 40)))
    return bfrt.open(path)


def some_rays(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Rays through the scene that `build` makes."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.5, 1.5, (count, 3)), rng.normal(size=(count, 3))


def assert_same_picture(found: bfrt.Image, expected: bfrt.Image) -> None:
    """The same bits in every channel, and the same facts."""
    assert list(found.channels) == list(expected.channels)
    for name, pixels in expected.channels.items():
        np.testing.assert_array_equal(found.channels[name], pixels, err_msg=name)
    assert found.metadata == expected.metadata
    assert found.stats.total.rays == expected.stats.total.rays
    assert found.stats.bad_rays == expected.stats.bad_rays


def assert_same_answer(found: bfrt.Answer, expected: bfrt.Answer) -> None:
    """The same keys, types and bits."""
    assert list(found) == list(expected)
    for key, array in expected.items():
        assert found[key].dtype == array.dtype
        np.testing.assert_array_equal(found[key], array, err_msg=key)


def wait_until(is_so, seconds: float = 90.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


# --- called by workers ---------------------------------------------------------------------------


def open_stores() -> list[str]:
    """The stores that a worker has open."""
    from bfrt.cluster import stores

    return [place.path for place in stores._STORES._sessions]


def executing(dask_worker) -> int:
    """The tasks that a worker is at, those too that nobody waits for any more."""
    return len(dask_worker.state.all_running_tasks)


def pid() -> int:
    return os.getpid()


def end_worker(_) -> None:
    """End as a process does that the system takes the memory from."""
    os.kill(os.getpid(), signal.SIGKILL)
