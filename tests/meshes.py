"""Files of meshes and points for tests: written simply, and read back from the store."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import bfrt
from bfrt.errors import BfrtError, SceneError, StreamError
from bfrt.records import Kind
from bfrt.store.store import Store

#: Triangles and flat faces of more corners, with a vertex that nothing needs.
VERTICES = np.array(
    [[0, 0, 0], [1, 0, 0.25], [1, 1, 0.75], [0, 1, 0.5], [9, 9, 9], [0.5, 2, 1.125]], np.float32
)
FACES = [[0, 1, 5], [3, 2, 1, 0], [5, 3, 0], [0, 1, 2, 5, 3]]


class Object(NamedTuple):
    """An object as a store has it: its numbers, row by row, and its material's."""

    shape: tuple[tuple[float, ...], ...]
    material: tuple[float, ...]

    @property
    def color(self) -> tuple[float, ...]:
        return self.material[:3]


def convert(path: Path, **settings: Any) -> Store:
    """The store that a file becomes, beside it."""
    quick = {"durable": False, "memory": 1 << 30}
    return bfrt.convert(path, path.with_suffix(".bfrt"), **{**quick, **settings}).store


def objects_of(store: Store) -> list[Object]:
    """All objects of a store, kind by kind, in the order given."""
    palette = store.materials().view("<f4").reshape(-1, 8)
    found = []
    for stream in store.streams:
        width = 4 if stream.kind == Kind.SPHERE else 3
        numbers = np.fromfile(stream.path("geometry"), "<f8" if stream.wide else "<f4")
        rows = numbers.astype(np.float64).reshape(-1, width)
        if not stream.wide:
            places = np.arange(len(rows)) % 6 < (3 if stream.kind == Kind.PATCH else 6)
            rows[places, :3] += store.origin  # what is no normal
        if stream.kind == Kind.POLYGON:
            ends = np.fromfile(stream.path("offsets"), "<u4").tolist()
        else:
            each = {Kind.TRIANGLE: 3, Kind.PATCH: 6}.get(stream.kind, 1)
            ends = range(each, each * stream.count + 1, each)
        if stream.material_bytes:
            materials = np.fromfile(stream.path("materials"), f"<u{stream.material_bytes}")
        else:
            materials = np.full(stream.count, stream.material)
        ids = range(stream.count)
        if stream.ordered:
            ids = np.fromfile(stream.path("ids"), f"<u{stream.id_bytes}").tolist()
        own = {}
        for start, end, material, id in zip([0, *ends], ends, materials, ids, strict=False):
            shape = tuple(map(tuple, rows[start:end].tolist()))
            own[id] = Object(shape, tuple(palette[material].tolist()))
        found += [own[id] for id in range(stream.count)]
    return found


def shapes_of(store: Store) -> list[tuple[tuple[float, ...], ...]]:
    """The numbers of all objects."""
    return [each.shape for each in objects_of(store)]


def expected(vertices: Any, faces: list[list[int]]) -> list[tuple[tuple[float, ...], ...]]:
    """What `shapes_of` gives for a mesh: triangles first, then the rest."""
    rows = np.asarray(vertices).astype(np.float64).tolist()
    shapes = [tuple(tuple(rows[i]) for i in face) for face in faces]
    return sorted(shapes, key=lambda shape: len(shape) > 3)


def spheres(centers: Any, radii: Any) -> list[tuple[tuple[float, ...], ...]]:
    """What `shapes_of` gives for these."""
    rows = np.column_stack([centers, np.broadcast_to(radii, len(centers))])
    return [(tuple(row),) for row in rows.astype(np.float64).tolist()]


def shades(store: Store) -> list[float]:
    """The gray, or the red, of each object."""
    return [each.color[0] for each in objects_of(store)]


def small_room(patch: pytest.MonkeyPatch, room: int) -> None:
    """A mesh's vertices have so many bytes, whatever the budget."""
    patch.setattr("bfrt.conversion.writing.rooms_for", lambda needs, _: [room] * len(needs))


def open_files() -> Counter[str]:
    """Files that this process has open, by name: a spool without a name would be one.

    Pipes, sockets and what is in /proc, /sys and /dev are none: threads of a cluster that ended
    a moment ago close theirs whenever they come to it.
    """
    folder = "/proc/self/fd"
    found: Counter[str] = Counter()
    for each in os.listdir(folder) if os.path.isdir(folder) else ():  # noqa: PTH112, PTH208
        with contextlib.suppress(FileNotFoundError):  # the one that lists them
            name = os.readlink(f"{folder}/{each}")  # noqa: PTH115 - by paths it takes five times as long
            if name.startswith("/") and not name.startswith(("/proc/", "/sys/", "/dev/")):
                found[name] += 1
    return found


def failure(path: Path, kind: type[BfrtError] = SceneError, **settings: Any) -> str:
    """What is said of a file that is refused, without its name; nothing may be left of the try."""
    before, there = open_files(), set(path.parent.iterdir())
    with pytest.raises(BfrtError) as caught:
        convert(path, **settings)
    message = str(caught.value)
    assert isinstance(caught.value, kind), f"{caught.type.__name__}: {message}"
    del caught
    assert not open_files() - before  # what earlier work has left to be collected may go
    assert set(path.parent.iterdir()) == there
    assert message.isprintable() and len(message) < 600
    assert "found" in message or kind is StreamError
    return message.removeprefix(f"{path}: ")


def outcome(path: Path, **settings: Any) -> str:
    """A valid store, or one of our errors: nothing else may come of a file."""
    made = path.with_suffix(".bfrt")
    shutil.rmtree(made, ignore_errors=True)
    before, there = open_files(), set(path.parent.iterdir())
    try:
        store = convert(path, **settings)
        store.verify()
        said = f"{store.objects} objects"
        del store
    except BfrtError as error:
        said = str(error)
        assert said.isprintable()
        assert str(path) in said
        assert not made.exists()
    assert not open_files() - before  # what earlier work has left to be collected may go
    assert set(path.parent.iterdir()) - {made} == there
    return said
