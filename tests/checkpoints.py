"""Work that is broken off after a save, and goes on: what tests of checkpoints share."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import fast
import numpy as np
import pytest
from injected import dividing
from scenes import random_objects
from treelets import small_treelets

from bfrt.budget import Capacities, GridCapacities, TreeCapacities
from bfrt.checkpoint.state import Facts, SavedState
from bfrt.image.picture import Image
from bfrt.records import Kind
from bfrt.scene import Scene, open_scene
from bfrt.scene_writer import SceneWriter
from bfrt.store.making import Order
from bfrt.store.model import Camera, Light, Material
from bfrt.tracer import Tracer

VIEW = Camera((0.3, -7.0, 1.5), (0.0, 0.0, 0.0), resolution=(24, 19))
AOVS = ("position", "albedo")


def mostly_slow(forms: Iterable[Any], quick: Collection[Any]) -> list[Any]:
    """Return parameters, of which all but the quick ones are slow."""
    return [form if form in quick else pytest.param(form, marks=pytest.mark.slow) for form in forms]


class Killed(Exception):
    """Breaks work off, as a kill would, after what `every=0` has saved."""


class Stop:
    """Reports of progress, of which that of a number raises; none does without."""

    def __init__(self, at: int | None = None) -> None:
        self.at = at
        self.calls = 0

    def __call__(self, progress: object) -> None:
        self.calls += 1
        if self.calls - 1 == self.at:
            raise Killed


def scene_of(path: Path, groups: int = 3, order: Order = "given", count: int = 400) -> Scene:
    """Mirrors, glass and plain objects of every kind, in several groups."""
    rng = np.random.default_rng(5)
    objects = fast.stored(random_objects(rng, count, spread=4.0, size=1.4))
    tables = (
        (Kind.SPHERE, objects.spheres), (Kind.CONE, objects.cones),
        (Kind.TRIANGLE, objects.triangles), (Kind.PATCH, objects.patches),
    )  # fmt: skip
    with (
        small_treelets(),
        SceneWriter(path, origin=(0, 0, 0), hierarchy=fast.DEEP, order=order) as writer,
    ):
        writer.background((0.1, 0.2, 0.3))
        writer.light(Light((5.0, -8.0, 9.0)))
        writer.light(Light((-6.0, -5.0, 4.0), (0.5, 0.7, 0.2)))
        for group in range(groups):
            for kind, table in tables:
                writer.material(Material((0.7, 0.3 + 0.1 * group, 0.5), kd=0.6, ks=0.3, shine=9.0))
                writer.append(kind, table[2 * group :: 2 * groups], group=group)
                writer.material(Material((0.3, 0.9, 0.5), kd=0.5, transmittance=0.4, ior=1.3))
                writer.append(kind, table[2 * group + 1 :: 2 * groups], group=group)
    return open_scene(path)


def tight(rows: int = 19, **changes: Any) -> Callable[[Scene], Scene]:
    """Open a scene with memory for few rays, and for some rows of the frame."""
    numbers = {"rays": 211, "candidates": 600, "hits": 60, "queue": 50, **changes}

    def divided(held: Capacities) -> Capacities:
        own = {k: v for k, v in numbers.items() if k in vars(held)}
        if isinstance(held, GridCapacities):
            limits = held.limits._replace(voxels=numbers.get("voxels", 16**3), slab=2048)
            own |= {"limits": limits, "blocks": 20}
        elif isinstance(held, TreeCapacities):
            own = {"kept": 0, **own}
        return replace(held, rows=rows, frame_on_disk=rows < 19, **own)

    return lambda scene: dividing(scene, divided)


def spied(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Count the rays that have to begin again, of each run that goes on."""
    counts: list[int] = []
    begun_again = Tracer.begun_again

    def counting(tracer: Tracer, saved: SavedState, facts: Facts) -> Any:
        again = begun_again(tracer, saved, facts)
        counts.append(0 if again is None else len(again))
        return again

    monkeypatch.setattr(Tracer, "begun_again", counting)
    return counts


def same_picture(image: Image, expected: Image) -> None:
    """Hold a picture and its ray counters to another's."""
    assert expected.stats is not None and image.stats is not None
    assert expected.stats.total.rays.eye_hits > 50
    assert image.channels.keys() == expected.channels.keys()
    for name, channel in expected.channels.items():
        assert np.asarray(image.channels[name]).tobytes() == np.asarray(channel).tobytes(), name
    assert image.stats.total.rays == expected.stats.total.rays
    assert [d.rays for d in image.stats.depths] == [d.rays for d in expected.stats.depths]
    assert image.stats.bad_rays == expected.stats.bad_rays
    assert image.metadata == expected.metadata
