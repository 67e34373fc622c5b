"""Checkpoints whose bytes were changed anywhere: work goes on from them.

::

    input   how (1 byte), which work (1 byte), files of the state (fuzz.packing)

Where no checksum was made anew what goes on ends as it would have without.
"""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from checkpoints import AOVS, Killed, Stop, scene_of, tight
from fuzz.packing import files_in, packed, put, unpacked
from fuzz.trial import Finding, Harness, of_files
from signing import sign_state

import bfrt

VIEW = bfrt.Camera((0.3, -7.0, 1.5), (0.0, 0.0, 0.0), resolution=(7, 6))
RAYS = 60
GENERATION = "state.7"
SIGNED = 1

#: Bytes before the files.
HEAD = 2

#: Reports after which work is broken off.
BREAKS = (1, 5, 14, 30)


class Work(NamedTuple):
    """Something that has a checkpoint: `run` gets a folder, and what `render` and queries take."""

    name: str
    run: Callable[..., bytes]


Opening = Callable[[], bfrt.Scene]


def rendering(opened: Opening, refine: str) -> Work:
    def run(folder: Path, **settings: Any) -> bytes:
        with opened() as scene:
            image = scene.render(
                camera=VIEW, aovs=AOVS, refine=refine, threads=1, scratch=folder / "tmp", **settings
            )
        return b"".join(np.asarray(pixels).tobytes() for pixels in image.channels.values())

    return Work(f"render {refine}", run)


def asking(opened: Opening, query: str, refine: str) -> Work:
    origins = np.random.default_rng(3).uniform(-3, 3, (RAYS, 3))

    def run(folder: Path, **settings: Any) -> bytes:
        with opened() as scene:
            answer = getattr(scene, query)(
                origins, -origins, refine=refine, threads=1, scratch=folder / "tmp",
                out=folder / "out" / "answer", **settings,
            )  # fmt: skip
        return b"".join(np.asarray(answer[key]).tobytes() for key in sorted(answer))

    return Work(f"{query} {refine}", run)


def opening(path: Path, **changes: Any) -> Opening:
    divided = tight(rows=3, rays=40, candidates=60, hits=15, queue=13, **changes)
    return lambda: divided(bfrt.open(path))


def works_of(home: Path) -> list[Work]:
    scene_of(home / "given.bfrt", groups=2, count=80).close()
    scene_of(home / "ordered.bfrt", groups=1, order="spatial", count=80).close()
    given = opening(home / "given.bfrt")
    ordered = opening(home / "ordered.bfrt", resident=False)
    return [
        *(rendering(given, refine) for refine in ("base", "sgb")), rendering(ordered, "tree"),
        asking(given, "cast_rays", "sgb"), asking(ordered, "cast_rays", "tree"),
        asking(ordered, "occluded", "tree"), asking(ordered, "list_intersections", "tree"),
        asking(given, "count_intersections", "sgb"),
    ]  # fmt: skip


def states_of(work: Work, folder: Path) -> list[dict[str, bytes]]:
    """The states of a work that is broken off early and late."""
    states = []
    for at in BREAKS:
        for part in ("out", "tmp"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(Killed):
            work.run(folder, checkpoint=folder / "kept", every=0, progress=Stop(at))
        for generation in folder.glob("kept/state.*"):
            states.append(files_in(generation))
        shutil.rmtree(folder)
    return states


def resign(generation: Path) -> None:
    """Sign a state anew, if it has a header."""
    with contextlib.suppress(ValueError, LookupError, TypeError, AttributeError, OSError,
                             RecursionError):  # fmt: skip
        sign_state(generation, json.loads((generation / "state.json").read_bytes()))


def checkpoint(home: Path) -> Harness:
    works = works_of(home)
    states = [states_of(work, home / "made") for work in works]
    names = sorted({name for each in states for files in each for name in files})
    whole = home / "whole"
    expected = []
    for number, work in enumerate(works):
        put({"out/none": b"", "tmp/none": b""}, whole / str(number))
        expected.append(work.run(whole / str(number)))

    def run(data: bytes, folder: Path) -> None:
        how, chosen, *_ = (*data[:HEAD], 0, 0)
        number = chosen % len(works)
        kept = folder / "in" / "kept"
        put(unpacked(data[HEAD:], names), kept / GENERATION)
        if how & SIGNED:
            resign(kept / GENERATION)
        with np.errstate(all="ignore"):
            value = works[number].run(folder, checkpoint=kept)
        if kept.exists():
            raise Finding("the state is still there")
        if not how & SIGNED and value != expected[number]:
            raise Finding("found another result, expected that of work that was not broken off")

    seeds = [
        bytes([how, number]) + packed(files, names)
        for number, each in enumerate(states)
        for files in each
        for how in (SIGNED, SIGNED, 0)
    ]
    return of_files(
        seeds, (b"null", b"true", b"-1", b"[]", b"{}", b'"', b"1e999"), run, names, HEAD
    )
