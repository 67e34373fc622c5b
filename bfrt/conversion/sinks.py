"""Sinks that stand between the reader of a file and the writer of a store: a group, and threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.color_scale import ColorScale
from bfrt.records import Kind
from bfrt.scene_writer import SceneWriter
from bfrt.store.model import Camera, Light, Vector
from bfrt.threads import Pool
from bfrt.workers import usable_threads

#: Blocks that wait to be written while the next is read; those of more bytes do not wait.
PENDING = 4
PENDING_BYTES = 16 << 20


class GroupSink:
    """Gives the reader of one of several files a scene writer: its objects become a group.

    The first file's view, lights and background are the scene's.
    """

    def __init__(self, writer: SceneWriter, group: int) -> None:
        self._writer = writer
        self._group = group
        self.material = writer.material
        self.prepare = partial(writer.prepare, group=group)
        self.add = writer.add
        self.append = partial(writer.append, group=group)
        self.append_polygons = partial(writer.append_polygons, group=group)

    def camera(self, camera: Camera) -> None:
        if self._group == 0:
            self._writer.camera(camera)

    def place(self, origin: Vector, crs: str) -> None:
        self._writer.place(origin, crs)

    def color_scale(self, scale: ColorScale) -> None:
        self._writer.color_scale(scale)

    def light(self, light: Light) -> None:
        if self._group == 0:
            self._writer.light(light)

    def background(self, color: Vector) -> None:
        if self._group == 0:
            self._writer.background(color)


class Behind:
    """Keeps a sink one step behind the reader: threads prepare blocks while the next are read.

    Blocks are added in the order they came in, at most `PENDING` later.
    """

    def __init__(self, sink: GroupSink) -> None:
        self._sink = sink
        self._threads = Pool(usable_threads(), "bfrt-prepare")
        self._pending: deque[Callable[[], object]] = deque()
        self._bytes: deque[int] = deque()
        self._begun: set[Kind] = set()
        self.camera = sink.camera
        self.light = sink.light
        self.place = sink.place
        self.color_scale = sink.color_scale
        self.background = sink.background
        self.material = sink.material

    def append(self, kind: Kind, records: NDArray[Any], materials: NDArray[np.uint32]) -> None:
        if kind not in self._begun:
            self._begin(kind, lambda: self._sink.append(kind, records, materials))
        else:
            self._prepare(kind, records, np.zeros_like(materials), materials)

    def append_polygons(
        self, vertices: NDArray[Any], counts: NDArray[np.int64], materials: NDArray[np.uint32]
    ) -> None:
        if Kind.POLYGON not in self._begun:
            self._begin(
                Kind.POLYGON, lambda: self._sink.append_polygons(vertices, counts, materials)
            )
        else:
            self._prepare(Kind.POLYGON, vertices, counts.astype(np.uint32), materials)

    def _prepare(self, kind: Kind, *block: NDArray[Any]) -> None:
        """Have a thread prepare a block: its records, counts and materials."""
        size = sum(array.nbytes for array in block)
        self._wait_for(size)
        made = self._threads.submit(self._sink.prepare, kind, *block)
        del block
        self._hand_over(lambda: self._sink.add(made.result()), size)

    def _begin(self, kind: Kind, add: Callable[[], object]) -> None:
        """Add a kind's first block at once: it decides the store's origin and the dtype."""
        self._begun.add(kind)
        self._wait(0)
        add()

    def _hand_over(self, add: Callable[[], object], size: int) -> None:
        self._pending.append(add)
        self._bytes.append(size)
        self._wait(PENDING if size <= PENDING_BYTES else 0)

    def _wait_for(self, size: int) -> None:
        """See to it that blocks that wait, and another of `size` bytes, are no more than may be."""
        while self._pending and sum(self._bytes) + size > PENDING_BYTES:
            self._wait(len(self._pending) - 1)

    def _wait(self, most: int) -> None:
        while len(self._pending) > most:
            self._bytes.popleft()
            self._pending.popleft()()

    def __enter__(self) -> Behind:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if kind is None:
                self._wait(0)
        finally:
            self._threads.cancel()
            self._threads.close()
