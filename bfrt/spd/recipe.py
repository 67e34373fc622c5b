"""The common part of the scenes of the Standard Procedural Databases.

A scene is a recipe: it knows its size and its counts at once, and makes its objects block by
block, in the order in which the package (E. Haines, SPD 3) writes them. Positions are float64, as
the package computes them before it prints six digits; a store keeps them as float32.
"""

from __future__ import annotations

import abc
import math
import operator
import os
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from bfrt.errors import Cancelled, SettingError
from bfrt.paths import is_there, without_links
from bfrt.progress import DoneReport, check_report, is_no, staged
from bfrt.records import BOX_BYTES, CODE_BYTES, MATERIAL_BYTES, OFFSET_BYTES, SCALARS, Kind
from bfrt.scene import Scene, open_scene
from bfrt.scene_writer import SceneWriter
from bfrt.spd.blocks import BLOCK_OBJECTS, Block, Scalar, Task
from bfrt.spd.nff import BlockText, block_text, fill_text, head_text
from bfrt.store.columns import prepare
from bfrt.store.extent import Extent
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order
from bfrt.store.model import Camera, Light, Material, Vector
from bfrt.store.ordering.objects import Layout, id_bytes_of
from bfrt.store.ordering.room import Amount, room_beside, room_of
from bfrt.store.writer import check_new_store
from bfrt.streams.free import check_free
from bfrt.workers import ahead, usable_threads

ORIGIN = (0.0, 0.0, 0.0)


#: Called with the objects that are done; returning False cancels.
Report = Callable[[int], object]


class Sink(Protocol):
    """Takes a scene: a scene writer, or a test."""

    def camera(self, camera: Camera) -> Any: ...

    def light(self, light: Light) -> Any: ...

    def background(self, color: Vector) -> Any: ...

    def material(self, material: Material) -> int: ...

    def prepare(
        self,
        kind: Kind,
        records: npt.NDArray[Any],
        counts: npt.NDArray[np.uint32],
        materials: npt.NDArray[np.uint32],
    ) -> Any: ...

    def add(self, block: Any) -> Any: ...


class TextFile(Protocol):
    """Takes text."""

    def write(self, text: str, /) -> Any: ...


class SpdScene(abc.ABC):
    """Makes a standard scene of a given size.

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
    #: The paper's settings for this scene.
    hierarchy = Hierarchy()
    #: A size at which its grid is about as large as at any greater one.
    settled = 1

    def __init__(self, size: int) -> None:
        self.size = operator.index(size)
        if self.size < 1:
            raise SettingError(f"{self.name}: found size {self.size}, expected 1 or more")

    @property
    @abc.abstractmethod
    def counts(self) -> dict[Kind, int]:
        """Return the number of objects of each kind."""

    @property
    def vertices(self) -> int:
        """Return the number of vertices of all polygons."""
        return 0

    @abc.abstractmethod
    def tasks(self, limit: int = BLOCK_OBJECTS) -> Iterator[Task]:
        """Yield tasks that make blocks of about `limit` objects, in the package's order."""

    @property
    def objects(self) -> int:
        """Return the number of objects of all kinds."""
        return sum(self.counts.values())

    @property
    def surface(self) -> float:
        """Return about the surface of the scene's grid, before the objects are made."""
        extent, first = Extent(), 0
        for block in self._small().blocks(dtype=np.float32):
            for part in block:
                records = np.ascontiguousarray(part.records)
                columns = prepare(part.kind, records, part.vertex_counts, part.materials, ORIGIN)
                extent.add(columns.boxes, first)
                first += len(part.materials)
        return extent.outliers()[1].surface

    def _small(self) -> SpdScene:
        """Return the scene at a smaller size, at which it extends as far."""
        return type(self)(min(self.size, self.settled))

    @property
    def store_bytes(self) -> int:
        """Return the most bytes of its store, without header and hierarchy, before it is made."""
        width = self._material_bytes
        total = len(self.materials) * MATERIAL_BYTES
        for kind, count in self.counts.items():
            records = self.vertices if kind.counted else count
            total += records * SCALARS[kind] * 4 + count * width
            total += count * BOX_BYTES if kind.boxed else 0
            total += count * OFFSET_BYTES if kind.counted else 0
        return total

    @property
    def hierarchy_bytes(self) -> int:
        """Return the most bytes of its hierarchy: a twentieth of the store, and quantised boxes."""
        boxed = sum(count for kind, count in self.counts.items() if kind.boxed)
        return self.store_bytes // 20 + boxed * CODE_BYTES

    def room(self, order: Order) -> int:
        """Return the most bytes on disk that it takes to write the store in an order."""
        stored = self.store_bytes + self.hierarchy_bytes
        if order == "given":
            return stored
        rooms = []
        for kind, count in sorted(self.counts.items()):
            records = self.vertices if kind.counted else count
            layout = Layout(kind, False, ORIGIN, id_bytes_of(count), self._material_bytes)
            rooms.append(room_of(layout, Amount(count, records, local=False)))
        return stored + room_beside(rooms)

    @property
    def _material_bytes(self) -> int:
        """Return the bytes of an object's material."""
        return 0 if len(self.materials) == 1 else 1 if len(self.materials) <= 256 else 2

    def blocks(self, limit: int = BLOCK_OBJECTS, dtype: Scalar = np.float64) -> Iterator[Block]:
        """Yield the objects, block by block, in the package's order."""
        return (task(dtype) for task in self.tasks(limit))

    def feed(self, sink: Sink, threads: int = 1, progress: Report | None = None) -> None:
        """Give the whole scene to a writer, block by block; blocks are made by all threads.

        Raises
        ------
        Cancelled
            If `progress` returned False.
        """
        sink.camera(self.camera)
        for light in self.lights:
            sink.light(light)
        sink.background(self.background)
        numbers = np.array([sink.material(m) for m in self.materials], dtype=np.uint32)

        def prepare(task: Task) -> tuple[int, list[Any]]:
            parts = [part for part in task(np.float32) if len(part.materials)]
            prepared = [
                sink.prepare(part.kind, part.records, part.vertex_counts, numbers[part.materials])
                for part in parts
            ]
            return sum(len(part.materials) for part in parts), prepared

        done = 0
        for objects, prepared in ahead(prepare, self.tasks(), threads):
            for block in prepared:
                sink.add(block)
            done += objects
            if progress is not None and is_no(progress(done)):
                raise Cancelled(f"cancelled with {done} of {self.objects} objects written")

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        hierarchy: Hierarchy | None = None,
        order: Order = "given",
        memory: str | int | None = None,
        threads: int | None = None,
        progress: DoneReport | None = None,
    ) -> Scene:
        """Write the scene as a scene store, with float32 geometry.

        Parameters
        ----------
        path : path-like
            The store to make.
        hierarchy : Hierarchy, optional
            Settings of the box hierarchy. By default the paper's for this scene.
        order : {"given", "spatial", "auto"}
            The order in which objects are stored; by default the package's, as in the paper. The
            other two are as for `bfrt.convert`.
        memory : str or int, optional
            Budget of the whole process, which spatial order asks for, as for `bfrt.convert`.
        threads : int, optional
            Threads that make blocks. By default all cores that this process may use.
        progress : callable, optional
            Called with the number of objects written so far, and after that, of a store in
            spatial order, with the number that are in order: a `bfrt.progress.Done`, which tells
            the stage, "writing" or "ordering", and the total. Returning False cancels.

        Returns
        -------
        Scene
            The new store, opened.

        Raises
        ------
        DiskFullError
            If the disk has less room than the store takes; this is found before anything is
            written.
        BudgetError
            If the budget is below the least that spatial order works with, which the message
            names.
        StreamError
            If the system refuses a write.
        Cancelled
            If `progress` returned False. Nothing is left behind.
        """
        check_report(progress)
        target = without_links(check_new_store(path))
        folder = next(each for each in target.parents if is_there(each))
        check_free(folder, self.room(order), "writing")
        with SceneWriter(
            path, dtype=np.float32, origin=ORIGIN, hierarchy=hierarchy or self.hierarchy,
            order=order, memory=memory,
        ) as writer:  # fmt: skip
            writer.expect(self.counts, self.surface)
            report = staged(progress, "writing", self.objects)
            self.feed(writer, usable_threads() if threads is None else threads, report)
            writer.complete(progress)
        return open_scene(path)

    def write_nff(
        self, file: TextFile, *, threads: int | None = None, progress: DoneReport | None = None
    ) -> None:
        """Write the scene as NFF text, as the package does.

        Parameters
        ----------
        file : text file
            A file open for writing. Numbers have six digits, as C's %g writes them.
        threads, progress
            As for `write`.

        Raises
        ------
        Cancelled
            If `progress` returned False; the file has the text written so far.
        """
        check_report(progress)
        file.write(head_text(self.background, self.camera, self.lights))
        fills = [self.fill(number).encode() for number in range(len(self.materials))]

        def text(task: Task) -> BlockText:
            return block_text(task(np.float64), fills)

        current, done = -1, 0
        count = usable_threads() if threads is None else threads
        report = staged(progress, "writing", self.objects)
        for block in ahead(text, self.tasks(), count):
            if not block.objects:
                continue
            same = block.first == current
            file.write(block.text[len(fills[current]) :] if same else block.text)
            current = block.last
            done += block.objects
            if report is not None:
                report(done)

    def fill(self, material: int) -> str:
        """Return the line of text that sets a material."""
        return fill_text(self.materials[material])

    def __repr__(self) -> str:
        return f"<bfrt.spd.{self.name}({self.size}), {self.objects} objects>"


def phong_power(degrees: float) -> float:
    """Return the Phong power at which a highlight has half its strength at an angle.

    Zero degrees is as good as invisible, and a right angle or more as good as flat.
    """
    if degrees <= 0.0:
        return 100000.0
    if degrees >= 90.0:
        return 1.0
    return math.log(0.5) / math.log(math.cos(math.radians(degrees)))
