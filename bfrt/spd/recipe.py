"""What the scenes of the Standard Procedural Databases have in common.

A scene is a recipe: it knows its size and its counts at once, and makes its objects block by
block, in the order in which the package (E. Haines, SPD 3) writes them. Positions are computed in
float64 and handed out as float32.
"""

from __future__ import annotations

import abc
import itertools
import math
import operator
import os
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from bfrt.errors import SettingError
from bfrt.records import Kind
from bfrt.scene.model import Camera, Light, Material, Vector
from bfrt.scene.store import Store, open_store
from bfrt.scene.writer import SceneWriter

BLOCK_OBJECTS = 1 << 16

#: A line of NFF per kind; a polygon's depends on its number of vertices.
NFF_LINES = {
    Kind.SPHERE: "s %g %g %g %g\n",
    Kind.CONE: "c %g %g %g %g %g %g %g %g\n",
}


class Part(NamedTuple):
    """The objects of one kind in a block.

    Attributes
    ----------
    kind : Kind
        Which primitive.
    records : ndarray of float32, shape (n, SCALARS[kind])
        One object a row; for polygons one vertex a row.
    materials : ndarray of uint32, shape (n,)
        Indices into the scene's `materials`.
    places : ndarray of int64, shape (n,)
        Each object's place in the block, in the package's order over all kinds.
    counts : ndarray of int64, shape (n,), or None
        For polygons: the number of vertices of each.
    """

    kind: Kind
    records: npt.NDArray[np.float32]
    materials: npt.NDArray[np.uint32]
    places: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64] | None = None


Block = tuple[Part, ...]


class Sink(Protocol):
    """What a scene feeds itself to: a scene writer, or a test."""

    def camera(self, camera: Camera) -> Any: ...

    def light(self, light: Light) -> Any: ...

    def background(self, color: Vector) -> Any: ...

    def material(self, material: Material) -> int: ...

    def append(
        self, kind: Kind, records: npt.NDArray[np.float32], materials: npt.NDArray[np.uint32]
    ) -> Any: ...

    def append_polygons(
        self,
        vertices: npt.NDArray[np.float32],
        counts: npt.NDArray[np.int64],
        materials: npt.NDArray[np.uint32],
    ) -> Any: ...


class TextFile(Protocol):
    """A file that takes text."""

    def write(self, text: str, /) -> Any: ...


class SpdScene(abc.ABC):
    """A standard scene of a given size.

    Parameters
    ----------
    size : int
        The package's size factor, 1 or more.

    Raises
    ------
    SettingError
        If the size is less than 1.
    """

    name: str
    camera: Camera
    lights: tuple[Light, ...]
    background: Vector
    materials: tuple[Material, ...]

    def __init__(self, size: int) -> None:
        self.size = operator.index(size)
        if self.size < 1:
            raise SettingError(f"{self.name}: found size {self.size}, expected 1 or more")

    @property
    @abc.abstractmethod
    def objects(self) -> int:
        """How many objects the scene has, all kinds together."""

    @abc.abstractmethod
    def blocks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Block]:
        """The objects, in blocks of about `limit` at most, in the package's order."""

    def feed(self, writer: Sink) -> None:
        """Give the whole scene to a writer, block by block."""
        writer.camera(self.camera)
        for light in self.lights:
            writer.light(light)
        writer.background(self.background)
        numbers = np.array([writer.material(m) for m in self.materials], dtype=np.uint32)
        for part in itertools.chain.from_iterable(self.blocks()):
            if part.counts is None:
                writer.append(part.kind, part.records, numbers[part.materials])
            else:
                writer.append_polygons(part.records, part.counts, numbers[part.materials])

    def write(self, path: str | os.PathLike[str]) -> Store:
        """Write the scene as a scene store, float32; returns it, opened."""
        with SceneWriter(path, dtype=np.float32, origin=(0.0, 0.0, 0.0)) as writer:
            self.feed(writer)
        return open_store(path)

    def write_nff(self, file: TextFile) -> None:
        """Write the scene as NFF text, as the package does.

        Parameters
        ----------
        file : text file
            Open for writing. Numbers have six digits, as C's %g gives them.
        """
        file.write(_head(self.background, self.camera, self.lights))
        fills = [_fill(material) for material in self.materials]
        current = -1
        for block in self.blocks():
            lines, materials = _lines(block)
            changed = np.flatnonzero(np.diff(materials, prepend=current))
            for place in changed.tolist():
                lines[place] = fills[materials[place]] + lines[place]
            current = int(materials[-1])
            file.write("".join(lines))

    def __repr__(self) -> str:
        return f"<bfrt.spd.{self.name}({self.size}), {self.objects} objects>"


def phong_power(degrees: float) -> float:
    """The Phong power at which a highlight has half its strength at this angle.

    Zero degrees is as good as invisible, and a right angle or more as good as flat.
    """
    if degrees <= 0.0:
        return 100000.0
    if degrees >= 90.0:
        return 1.0
    return math.log(0.5) / math.log(math.cos(math.radians(degrees)))


def _head(background: Vector, camera: Camera, lights: tuple[Light, ...]) -> str:
    lines = [
        f"b {_numbers(*background)}",
        "v",
        f"from {_numbers(*camera.eye)}",
        f"at {_numbers(*camera.at)}",
        f"up {_numbers(*camera.up)}",
        f"angle {_numbers(camera.angle)}",
        f"hither {_numbers(camera.hither)}",
        "resolution {} {}".format(*camera.resolution),
        *(f"l {_numbers(*light.position)}" for light in lights),
    ]
    return "\n".join(lines) + "\n"


def _fill(material: Material) -> str:
    return f"f {_numbers(*material.color, *material[1:])}\n"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:g}" for value in values)


def _lines(block: Block) -> tuple[list[str], npt.NDArray[np.int64]]:
    """Each object's text, and its material, in the package's order."""
    total = sum(len(part.materials) for part in block)
    lines = [""] * total
    materials = np.empty(total, dtype=np.int64)
    for part in block:
        materials[part.places] = part.materials
        for place, text in zip(part.places.tolist(), _texts(part), strict=True):
            lines[place] = text
    return lines, materials


def _texts(part: Part) -> list[str]:
    """The text of each object: one call formats the part, which no loop in Python could match."""
    if part.counts is None:
        layouts = [NFF_LINES[part.kind]] * len(part.records)
    else:
        layouts = [f"p {n}\n" + "%g %g %g\n" * n for n in part.counts.tolist()]
    # NUL ends an object, as lines may end within one.
    text = "\0".join(layouts) % tuple(part.records.ravel().tolist())
    return text.split("\0")
