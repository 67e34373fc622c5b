"""A group whose objects have all come: levels are made over them, or they are brought into order.

Each stream is complete on disk at both ends of that, as it was given and in its last form, and what
is in memory between are the facts that `WrittenGroup.facts` has, for JSON. So work that is broken
off goes on at the first stream that is not in its last form.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.ids import index_of, object_id, stream_number, stream_of
from bfrt.progress import DoneReport, Passes, staged
from bfrt.records import BOX_BYTES, SCALARS, Kind
from bfrt.refusals import refused
from bfrt.store.columns import prepare
from bfrt.store.extent import Bounds
from bfrt.store.header import facts_of
from bfrt.store.hierarchy import LEAST_CHILDREN, Boxes, HierarchyWriter, Level
from bfrt.store.making import Making
from bfrt.store.material_column import READ_BACK_AT_ONCE
from bfrt.store.model import Vector
from bfrt.store.ordering.files import ordered_folder, replace_folder
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.memory import SLOWEST, check_memory, memory_of, pace_for
from bfrt.store.ordering.order import Keeping, Ordering
from bfrt.store.ordering.room import room_beside
from bfrt.store.store import bounds_from
from bfrt.streams.atomic_write import sync_folders
from bfrt.streams.free import check_free
from bfrt.workers import ahead, usable_threads


class WrittenStream:
    """Describes a stream whose files are complete.

    Parameters
    ----------
    folder : Path
        Where they are, or will be.
    header : dict
        The stream's part of the store's header.
    local : bool
        Whether objects that follow each other are near each other as they are.
    made : bool
        Whether it is in its last form: with levels, and in order.
    ordering : dict, optional
        What `Ordering.saved` has returned, if it is on the way into order.
    begun : HierarchyWriter, optional
        What has made the first level as the objects came.
    """

    def __init__(
        self, folder: Path, header: dict[str, Any], *, local: bool, made: bool = False,
        begun: HierarchyWriter | None = None, ordering: dict[str, Any] | None = None,
    ) -> None:  # fmt: skip
        self.folder = folder
        self.header = header
        self.local = local
        self.made = made
        self.begun = begun
        self.ordering = ordering
        self.under_way: Ordering | None = None

    @property
    def facts(self) -> dict[str, Any]:
        """Return all that is known of the stream, for JSON; windows in order are on the disk."""
        ordering = self.ordering if self.under_way is None else self.under_way.saved()
        return {
            "header": self.header,
            "local": self.local,
            "made": self.made,
            "ordering": ordering,
        }

    @property
    def ordered_bytes(self) -> int:
        """Return the bytes of the windows in order that a run before has left."""
        if self.ordering is None:
            return 0
        return sum(facts["bytes"] for facts in self.ordering["files"]["files"].values())

    @property
    def kind(self) -> Kind:
        return Kind(self.header["kind"])

    @property
    def count(self) -> int:
        """Return the number of objects."""
        return int(self.header["count"])

    def given(self, origin: Vector) -> GivenFiles:
        """Describe the files as they were given."""
        return GivenFiles.of(self.folder, self.kind, self.header, origin)

    def least_memory(self, origin: Vector) -> int:
        """Return the least budget that its ordering stays inside of, bytes."""
        files = self.given(origin)
        return memory_of(files.layout, files.amount(self.local), SLOWEST)

    def boxes(self, origin: Vector) -> Boxes:
        """Yield the boxes of all objects, as they were given, block by block."""
        if self.kind.boxed:
            return file_boxes(self.folder / "boxes")
        return sphere_boxes(self.folder / "geometry", self.header["wide"], origin)

    def add_levels(self, levels: list[Level]) -> None:
        """Have the header tell of complete levels: the stream is in its last form."""
        header = self.header
        header["levels"] = [level.count for level in levels]
        for level in levels:
            header["files"].update((name, facts_of(f)) for name, f in level.files.items())
        header["quantised"] = "quantised" in header["files"]
        self.made = True


class WrittenGroup:
    """Brings the streams of a group into their last form, one after another.

    Parameters
    ----------
    folder : Path
        The group's folder.
    number : int
        The group's number.
    making : Making
        How it is made.
    streams : list of WrittenStream
        By ascending kind.
    facts : dict
        `bounds` and `grid_bounds`, two corners or None; `outliers`, ids; `surface`, of the grid;
        `seconds`, that levels and order have taken.
    """

    def __init__(
        self, folder: Path, number: int, making: Making, streams: list[WrittenStream],
        facts: dict[str, Any],
    ) -> None:  # fmt: skip
        self.streams = streams
        self._folder = folder
        self._number = number
        self._making = making
        self._facts = facts
        self._replacing: list[WrittenStream] = []
        self._synced = False

    @classmethod
    def restored(
        cls, folder: Path, number: int, making: Making, facts: dict[str, Any]
    ) -> WrittenGroup:
        """Return a group from its facts; its files are there."""
        facts = dict(facts)
        streams = [
            WrittenStream(
                folder / Kind(each["header"]["kind"]).label, each["header"], local=each["local"],
                made=each["made"], ordering=each["ordering"],
            )
            for each in facts.pop("streams")
        ]  # fmt: skip
        return cls(folder, number, making, streams, facts)

    @property
    def facts(self) -> dict[str, Any]:
        """Return all that is known of the group, for JSON."""
        return {**self._facts, "streams": [stream.facts for stream in self.streams]}

    @property
    def bounds(self) -> Bounds:
        """Return the bounds of all objects."""
        return bounds_from(self._facts["bounds"])

    @property
    def local(self) -> list[str]:
        """Return the streams whose objects came in local order, as GROUP/KIND."""
        return [f"{self._number}/{each.kind.label}" for each in self.streams if each.local]

    @property
    def hierarchy_seconds(self) -> float:
        """Return what levels and order have taken."""
        return float(self._facts["seconds"])

    @property
    def unmade(self) -> list[WrittenStream]:
        """Return the streams that are not in their last form."""
        return [stream for stream in self.streams if not stream.made]

    @property
    def unordered(self) -> int:
        """Return the number of objects that will be brought into another order."""
        return sum(stream.count for stream in self.unmade if self.is_ordered(stream))

    def is_ordered(self, stream: WrittenStream) -> bool:
        """Tell whether a stream's objects are brought into order."""
        return stream.count > 0 and self._making.order != "given"

    def check_memory(self, origin: Vector, name: str) -> None:
        """Refuse a budget that is less than the least for those that are brought into order.

        Raises
        ------
        BudgetError
            If it is; nothing is brought into order then.
        """
        ordered = [stream for stream in self.unmade if self.is_ordered(stream)]
        least = max((stream.least_memory(origin) for stream in ordered), default=0)
        check_memory(least, self._making.memory, name)

    def complete_begun(self, origin: Vector) -> None:
        """Complete the hierarchies whose first levels were made as the objects came."""
        for stream in self.streams:
            if stream.begun is not None:
                self._facts["seconds"] += sum(level.seconds for level in stream.begun.levels)
                self.make(stream, origin, Passes(), lambda: None)

    def make(
        self, stream: WrittenStream, origin: Vector, passes: Passes,
        between: Callable[[], object],
    ) -> None:  # fmt: skip
        """Bring a stream into its last form; `between` is called when a part of it is in order.

        Its files are whole and in place afterwards, but for those of a stream that was ordered,
        which lie beside the given ones until `settle`.
        """
        start = time.perf_counter()
        self._synced = False
        if self.is_ordered(stream):
            self._order(stream, origin, passes, between)
        else:
            hierarchy = stream.begun or hierarchy_over(
                stream.folder, stream.kind, self._making, self._facts["surface"]
            )
            hierarchy.complete(stream.boxes(origin), stream.count)
            stream.begun = None
            stream.add_levels(hierarchy.levels)
        self._facts["seconds"] += time.perf_counter() - start

    def _order(
        self, stream: WrittenStream, origin: Vector, passes: Passes,
        between: Callable[[], object],
    ) -> None:  # fmt: skip
        number = stream_number(self._number, stream.kind)
        outliers = self._facts["outliers"]
        own = [id for id in outliers if stream_of(id) == number]
        files, memory = stream.given(origin), self._making.memory
        pace = pace_for(files.layout, files.amount(stream.local), memory, usable_threads())
        assert pace is not None  # as `check_memory` has seen
        ordering = Ordering(
            files, bounds_from(self._facts["grid_bounds"]),
            np.array([index_of(id) for id in own], np.int64), passes, local=stream.local,
            keeping=Keeping(self._making.durable, stream.ordering, between, pace),
        )  # fmt: skip
        stream.under_way = ordering
        hierarchy = HierarchyWriter(
            ordering.folder, self._making.hierarchy, self._facts["surface"],
            durable=self._making.durable, least=LEAST_CHILDREN,
        )  # fmt: skip
        try:
            with closing(ordering.boxes()) as boxes:
                hierarchy.complete(boxes, stream.count)
            stream.header.update(ordering.close())
        except BaseException:
            hierarchy.abandon()
            ordering.abandon()
            raise
        stream.under_way = stream.ordering = None
        stream.add_levels(hierarchy.levels)
        places = [object_id(number, int(place)) for place in ordering.places]
        others = [id for id in outliers if stream_of(id) != number]
        self._facts["outliers"] = sorted([*others, *places])
        self._replacing.append(stream)

    def sync(self) -> None:
        """Make the entries of the group's folders durable, unless they are."""
        if self._making.durable and not self._synced:
            sync_folders(self._folder)
        self._synced = not any(stream.under_way for stream in self.streams)

    def settle(self) -> None:
        """Put the files that are in order into the place of the given ones."""
        for stream in self._replacing:
            replace_folder(stream.folder, ordered_folder(stream.folder))
        self._replacing.clear()

    def header(self) -> dict[str, Any]:
        """Return the group's part of the store's header."""
        return {
            "streams": [stream.header for stream in self.streams],
            "grid_bounds": self._facts["grid_bounds"],
            "outliers": self._facts["outliers"],
        }


def make_all(
    groups: list[WrittenGroup], origin: Vector, progress: DoneReport | None,
    may_settle: Callable[[bool], bool],
) -> None:  # fmt: skip
    """Bring the streams of all groups into their last form.

    Parameters
    ----------
    may_settle : callable
        Tells whether files as given may go, now that there are those in order; also called where
        a part of a stream is in order. It is given True the last time.
    """
    unordered = sum(group.unordered for group in groups)
    passes = Passes(staged(progress, "ordering", unordered) if unordered else None)
    waiting: list[WrittenGroup] = []
    left = [(group, stream) for group in groups for stream in group.unmade]
    for number, (group, stream) in enumerate(left):
        check_room([each for own, each in left[number:] if own.is_ordered(each)], origin)
        group.make(stream, origin, passes, lambda: may_settle(False))
        waiting.append(group)
        if may_settle(False):
            settle(waiting)
    if waiting and may_settle(True):
        settle(waiting)


def check_room(streams: list[WrittenStream], origin: Vector) -> None:
    """Refuse a disk that has less room than it takes to bring some streams into order, in turn.

    Raises
    ------
    DiskFullError
        If it has; nothing of the first stream is written then.
    """
    if streams:
        needed = room_beside(stream.given(origin).room(stream.local) for stream in streams)
        check_free(streams[0].folder, needed - streams[0].ordered_bytes, "ordering with")


def settle(groups: list[WrittenGroup]) -> None:
    """Put files that are in order into the place of the given ones, and forget the groups."""
    for group in groups:
        group.settle()
    groups.clear()


def hierarchy_over(folder: Path, kind: Kind, making: Making, surface: float) -> HierarchyWriter:
    """Return the writer of a stream's hierarchy, in the order given.

    Spheres' boxes are not quantised: their records are as small.
    """
    settings = making.hierarchy
    quantised = settings.bits > 0 and kind.boxed
    return HierarchyWriter(folder, settings, surface, durable=making.durable, quantised=quantised)


def file_boxes(path: Path) -> Iterator[NDArray[np.float32]]:
    """Yield the boxes of a complete file of boxes, block by block."""
    for block in _blocks(path, BOX_BYTES):
        yield np.frombuffer(block, "<f4").reshape(-1, 6)


def sphere_boxes(path: Path, wide: bool, origin: Vector) -> Iterator[NDArray[np.float32]]:
    """Yield the boxes of a complete file of spheres, computed again, on all cores."""
    scalar = "<f8" if wide else "<f4"

    def boxes(block: bytes) -> NDArray[np.float32]:
        records = np.frombuffer(block, scalar).reshape(-1, SCALARS[Kind.SPHERE])
        none = np.zeros(len(records), np.uint32)
        return prepare(Kind.SPHERE, records, none, none, origin).boxes

    blocks = _blocks(path, SCALARS[Kind.SPHERE] * int(scalar[2]))
    yield from ahead(boxes, blocks, usable_threads())


def _blocks(path: Path, size: int) -> Iterator[bytes]:
    """Yield a file's records of `size` bytes, up to READ_BACK_AT_ONCE of them at a time."""
    try:
        with path.open("rb") as file:
            while block := file.read(READ_BACK_AT_ONCE * size):
                if len(block) % size:
                    raise ShortReadError(path, file.tell() - len(block) % size, size, len(block))
                yield block
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
