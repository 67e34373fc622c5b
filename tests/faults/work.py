"""What is done while calls fail: each writes into ``out`` or returns bytes, from what is in ``in``.

Works that keep a checkpoint are done once more where they failed: that goes on from it.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
from checkpoints import Killed, Stop
from faults.conversions import npy, obj, raster
from injected import dividing

import bfrt
from bfrt.budget import GridCapacities
from bfrt.checkpoint.state import StateWriter

#: Rays of a query.
RAYS = 300

FRAME = (24, 18)


class Work(NamedTuple):
    """Something to do: `prepare` makes what it needs in a folder, without faults.

    Where it `resumes`, what failed is done again, without faults, and has to succeed.
    """

    prepare: Callable[[Path], object]
    run: Callable[[Path], bytes]
    resumes: bool = False


# --- conversions ---------------------------------------------------------------------------------


def looking() -> Work:
    """What is seen of a terrain, in the place of a file that is there."""

    def run(folder: Path) -> bytes:
        bfrt.viewshed(
            folder / "in" / "a.tif", folder / "out" / "a.tif", (500_042.0, 5_399_968.0),
            scratch=folder / "tmp",
        )  # fmt: skip
        return b""

    def prepare(folder: Path) -> None:
        raster(folder)
        (folder / "out" / "a.tif").write_bytes(b"what was there")

    return Work(prepare, run)


def converting(prepare: Callable[[Path], object], name: str, *, again: bool = False, **how) -> Work:
    """A conversion of a file; `again` puts it in the place of a store."""

    def run(folder: Path) -> bytes:
        bfrt.convert(
            folder / "in" / name, folder / "out" / "a.bfrt", scratch=folder / "tmp", **how
        ).close()
        return b""

    def both(folder: Path) -> None:
        prepare(folder)
        if again:
            bfrt.spd.rings(1).write(folder / "out" / "a.bfrt")

    return Work(both, run)


# --- renders and queries -------------------------------------------------------------------------


def scene(folder: Path, *, order: str = "auto") -> None:
    """All five kinds, mirrors and glass."""
    write_scene(folder / "in" / "s.bfrt", order)


def write_scene(path: Path, order: str = "auto") -> None:
    rng = np.random.default_rng(5)
    with bfrt.SceneWriter(path, dtype="float32", order=order) as writer:
        writer.camera(bfrt.Camera((0, -6, 1), (0, 0, 0), resolution=FRAME))
        writer.light(bfrt.Light((4, -5, 6)))
        matt = writer.material(bfrt.Material((0.9, 0.7, 0.5), 0.8))
        clear = writer.material(bfrt.Material((0.8, 1, 1), 0.1, 0.1, 50.0, 0.8, 1.5))
        writer.polygons([[-9, -9, -2], [9, -9, -2], [9, 9, -2], [-9, 9, -2]], [4], matt)
        centers = rng.uniform(-2, 2, (40, 3))
        writer.spheres(centers, rng.uniform(0.1, 0.4, 40), rng.choice([matt, clear], 40))
        writer.cones(centers, 0.1, centers + rng.uniform(-1, 1, (40, 3)), 0.02, clear)
        corners = rng.uniform(-2, 2, (40, 1, 3)) + rng.uniform(-0.5, 0.5, (40, 3, 3))
        writer.triangles(corners, matt)
        writer.patches(corners + 0.7, rng.normal(size=(40, 3, 3)), clear)


as_given = partial(scene, order="given")


def many(folder: Path) -> None:
    """So many small objects that of several treelets parts are read, in several runs."""
    rng = np.random.default_rng(6)
    with bfrt.SceneWriter(folder / "in" / "s.bfrt", dtype="float32", order="spatial") as writer:
        writer.camera(bfrt.Camera((0, -6, 1), (0, 0, 0), resolution=FRAME))
        writer.light(bfrt.Light((4, -5, 6)))
        writer.spheres(rng.uniform(-2, 2, (60_000, 3)), 0.01)
        corners = rng.uniform(-2, 2, (20_000, 1, 3)) + rng.uniform(-0.02, 0.02, (20_000, 5, 3))
        writer.polygons(corners.reshape(-1, 3), np.full(20_000, 5))


def tight(given):
    """Capacities so small that rays, hits and queues go to disk, and marks are in slabs."""
    held = replace(given, rays=97, candidates=97, hits=50, queue=13)
    if isinstance(held, GridCapacities):
        return replace(held, limits=held.limits._replace(voxels=30))
    return replace(held, resident=False)


def on_disk(given):
    """Capacities with a frame in bands."""
    return replace(tight(given), rows=5, frame_on_disk=True)


def past_the_cache(given):
    """Capacities with which treelets stream past the system's cache, and few nodes are kept."""
    return replace(tight(given), kept=5000, cached=False)


def opened(folder: Path, divide, name: str = "s.bfrt") -> bfrt.Scene:
    made = bfrt.open(folder / "in" / name)
    return made if divide is None else dividing(made, divide)


def rendering(
    refine: str, divide=None, suffix: str = ".exr", make=scene, name: str = "s.bfrt"
) -> Work:
    def run(folder: Path) -> bytes:
        with opened(folder, divide, name) as held:
            image = held.render(
                refine=refine,
                threads=2,
                memory="512MiB",
                scratch=folder / "tmp",
                aovs=("position",),
            )
            image.save(folder / "out" / f"a{suffix}")
            return b"".join(np.asarray(pixels).tobytes() for pixels in image.channels.values())

    return Work(make, run)


def asking(query: str, refine: str, divide=None, make=scene) -> Work:
    """A query by rays whose answer goes to a folder, in which another stood before."""

    def ask(folder: Path, n: int) -> dict[str, np.ndarray]:
        rng = np.random.default_rng(3)
        origins = rng.uniform(-3, 3, (n, 3))
        with opened(folder, divide) as held:
            return getattr(held, query)(
                origins, -origins, refine=refine, threads=2, memory="512MiB",
                scratch=folder / "tmp", out=folder / "out" / "answer",
            )  # fmt: skip

    return answering(ask, make)


def asking_points(query: str, refine: str, divide=None, make=scene, **how) -> Work:
    """A query by points."""

    def ask(folder: Path, n: int) -> dict[str, np.ndarray]:
        points = np.random.default_rng(3).uniform(-3, 3, (n // 4, 3))
        with opened(folder, divide) as held:
            return getattr(held, query)(
                points, refine=refine, threads=2, memory="512MiB",
                scratch=folder / "tmp", out=folder / "out" / "answer", **how,
            )  # fmt: skip

    return answering(ask, make)


def answering(ask: Callable[[Path, int], dict[str, np.ndarray]], make) -> Work:
    """A work that asks a scene, and before that less."""

    def prepare(folder: Path) -> None:
        make(folder)
        ask(folder, 5)

    def run(folder: Path) -> bytes:
        answer = ask(folder, RAYS)
        return b"".join(np.asarray(answer[key]).tobytes() for key in sorted(answer))

    return Work(prepare, run)


# --- checkpoints ---------------------------------------------------------------------------------

#: A state after every pass, of little work: it takes many calls.
KEPT = {"every": 0, "threads": 2, "memory": "512MiB"}
SMALL = bfrt.Camera((0, -6, 1), (0, 0, 0), resolution=(6, 5))
FEW_RAYS = 60

#: Reports after which work that is resumed had been broken off.
BROKEN_OFF = 3


def few(given):
    """Capacities with which little work takes several passes."""
    return replace(tight(given), rays=31, candidates=31)


def rendered(refine: str, folder: Path, **more) -> bytes:
    """Render with a checkpoint."""
    with opened(folder, few) as held:
        image = held.render(
            camera=SMALL, refine=refine, scratch=folder / "tmp", checkpoint=folder / "out" / "kept",
            **KEPT, **more,
        )  # fmt: skip
        return b"".join(np.asarray(pixels).tobytes() for pixels in image.channels.values())


def asked(query: str, refine: str, folder: Path, **more) -> bytes:
    """Ask with a checkpoint."""
    origins = np.random.default_rng(3).uniform(-3, 3, (FEW_RAYS, 3))
    with opened(folder, few) as held:
        answer = getattr(held, query)(
            origins, -origins, refine=refine, scratch=folder / "tmp",
            checkpoint=folder / "out" / "kept", out=folder / "out" / "answer", **KEPT, **more,
        )  # fmt: skip
        return b"".join(np.asarray(answer[key]).tobytes() for key in sorted(answer))


#: Objects of a window, so that those of a file take several.
WINDOW = 8

#: The save of the second window: two sources and one window were saved before.
SAVED_WINDOW = 4


def two_files(folder: Path) -> None:
    npy(folder)
    obj(folder)


def converted(folder: Path, **more) -> bytes:
    """Convert with a checkpoint, into spatial order by several windows."""
    os.chdir(folder)  # a conversion goes on with sources of the same paths
    with mock.patch("bfrt.store.ordering.order.WINDOW", WINDOW):
        bfrt.convert(
            ["in/a.npy", "in/a.obj"], folder / "out" / "a.bfrt", radius=0.1,
            order="spatial", scratch=folder / "tmp",
            checkpoint=folder / "out" / "kept", every=0, **more,
        ).close()  # fmt: skip
    return b""


def broken_off_conversion(folder: Path) -> None:
    """Break a conversion off in a save, when a window that no state has is on the disk."""
    two_files(folder)
    complete, calls = StateWriter.complete, []

    def stop(writer: StateWriter, *facts) -> None:
        calls.append(writer)
        if len(calls) == SAVED_WINDOW:
            raise Killed
        complete(writer, *facts)

    with mock.patch.object(StateWriter, "complete", stop), contextlib.suppress(Killed):
        converted(folder)
    assert len(list((folder / "out" / "kept").rglob("*.ordered"))) == 1


def keeping(run: Callable[..., bytes], order: str) -> Work:
    """A work that keeps a checkpoint."""
    return Work(partial(scene, order=order), run, resumes=True)


def resuming(run: Callable[..., bytes], order: str) -> Work:
    """A work that goes on from one."""

    def prepare(folder: Path) -> None:
        scene(folder, order=order)
        with contextlib.suppress(Killed):
            run(folder, progress=Stop(BROKEN_OFF))
        assert list((folder / "out" / "kept").iterdir())

    return Work(prepare, run, resumes=True)


# --- pictures ------------------------------------------------------------------------------------


def saving(suffix: str) -> Work:
    """A picture saved over another."""

    def run(folder: Path) -> bytes:
        rng = np.random.default_rng(8)
        channels = {name: rng.random((90, 70), np.float32) for name in "RGBAZ"}
        bfrt.Image(channels, {"scene": "made up"}).save(folder / "out" / f"a{suffix}")
        return b""

    def prepare(folder: Path) -> None:
        (folder / "out" / f"a{suffix}").write_bytes(b"a picture that was there")

    return Work(prepare, run)
