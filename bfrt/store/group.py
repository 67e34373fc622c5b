"""A group as it is written: a stream for each kind, its bounds, its outliers, its hierarchies."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from bfrt.errors import SceneError, SettingError
from bfrt.ids import index_of, object_id, stream_of
from bfrt.progress import Passes
from bfrt.records import Kind
from bfrt.refusals import refused
from bfrt.store.columns import Prepared, StreamWriter
from bfrt.store.extent import Bounds, Extent
from bfrt.store.header import facts_of
from bfrt.store.hierarchy import Hierarchy, HierarchyWriter, Level
from bfrt.store.model import Vector
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.order import Ordering
from bfrt.store.store import bounds_to

#: The order in which a store keeps its objects.
Order = Literal["given", "spatial", "auto"]


def checked_order(order: str) -> Order:
    """Return an order that there is.

    Raises
    ------
    SettingError
        If it is none.
    """
    for name in get_args(Order):
        if order == name:
            return name  # type: ignore[no-any-return]
    raise SettingError(f"order: found {order!r:.80}, expected given, spatial or auto")


class Making(NamedTuple):
    """Says how the groups of a store are made.

    Attributes
    ----------
    hierarchy : Hierarchy
        Settings of the box hierarchy.
    order : {"given", "spatial", "auto"}
    durable : bool
        Whether files outlive a loss of power.
    """

    hierarchy: Hierarchy
    order: Order
    durable: bool


class GroupWriter:
    """Writes one group of a store.

    Parameters
    ----------
    folder : Path
        The group's folder, which is created.
    number : int
        The group's number.
    making : Making
        How it is made.
    """

    def __init__(self, folder: Path, number: int, making: Making) -> None:
        try:
            folder.mkdir()
        except OSError as error:
            raise refused(folder, 0, error, "creating") from error
        self.streams: dict[Kind, StreamWriter] = {}
        self.hierarchy_seconds = 0.0
        self._folder = folder
        self._number = number
        self._making = making
        self._extent = Extent()
        self._expected: Mapping[Kind, int] = {}
        self._surface = 0.0

    @property
    def bounds(self) -> Bounds:
        """Return the bounds of all objects."""
        return self._extent.bounds

    def expect(self, counts: Mapping[Kind, int], surface: float) -> None:
        """Announce objects, so that first levels are made as they come."""
        if self.streams:
            raise SettingError("expect: found objects already, expected a call before the first")
        self._expected, self._surface = dict(counts), float(surface)

    def add(self, block: Prepared) -> None:
        """Write a block: the next objects of its kind."""
        if block.kind not in self.streams:
            stream = StreamWriter(
                self._folder / block.kind.label, self._number, block.kind, block.wide,
                self._making.durable,
            )  # fmt: skip
            self.streams[block.kind] = stream
            count = self._expected.get(block.kind)
            if count and self._making.order == "given":
                stream.expect(count, self._surface, self._making.hierarchy)
        self.streams[block.kind].append(block, self._extent)

    @property
    def unordered(self) -> int:
        """Return the number of objects that will be brought into another order."""
        return sum(s.count for s in self.streams.values() if self._is_ordered(s))

    def close(self, origin: Vector, passes: Passes) -> dict[str, Any]:
        """Complete all files; return the group's part of the header."""
        headers = [self.streams[kind].close() for kind in sorted(self.streams)]
        outliers, grid_bounds = self._extent.outliers()
        surface = self._surface if self._expected else grid_bounds.surface
        hierarchies = [s.hierarchy for s in self.streams.values() if s.hierarchy is not None]
        begun = sum(level.seconds for hierarchy in hierarchies for level in hierarchy.levels)
        start = time.perf_counter() - begun
        for header in headers:
            stream = self.streams[Kind(header["kind"])]
            self._check_count(stream)
            if self._is_ordered(stream):
                own = [id for id in outliers if stream_of(id) == stream.number]
                given = stream.given(origin)
                places = self._order(given, grid_bounds, surface, header, own, passes)
                others = [id for id in outliers if stream_of(id) != stream.number]
                outliers = sorted([*others, *places])
                continue
            levels = stream.make_levels(self._making.hierarchy, surface, origin)
            _add_levels(header, levels)
        self.hierarchy_seconds = time.perf_counter() - start
        return {"streams": headers, "grid_bounds": bounds_to(grid_bounds), "outliers": outliers}

    def _check_count(self, stream: StreamWriter) -> None:
        expected = self._expected.get(stream.kind, stream.count)
        if stream.count != expected:
            raise SceneError(
                f"{stream.label}: found {stream.count} objects, expected {expected} as announced"
            )

    def _is_ordered(self, stream: StreamWriter) -> bool:
        return stream.count > 0 and self._making.order != "given"

    def _order(
        self, given: GivenFiles, around: Bounds, surface: float, header: dict[str, Any],
        outliers: list[int], passes: Passes,
    ) -> list[int]:  # fmt: skip
        """Bring a stream into spatial order; return the outliers' new ids."""
        stream = self.streams[given.layout.kind]
        asked = np.array([index_of(id) for id in outliers], np.int64)
        ordering = Ordering(
            given, around, asked, passes, local=stream.locality.local,
            durable=self._making.durable,
        )  # fmt: skip
        hierarchy = HierarchyWriter(
            ordering.folder, self._making.hierarchy, surface, durable=self._making.durable
        )
        try:
            with closing(ordering.boxes()) as boxes:
                hierarchy.complete(boxes, stream.count)
            header.update(ordering.close())
        except BaseException:
            hierarchy.abandon()
            ordering.abandon()
            raise
        _add_levels(header, hierarchy.levels)
        return [object_id(stream.number, int(place)) for place in ordering.places]

    def abandon(self) -> None:
        """Give the files up."""
        for stream in self.streams.values():
            stream.abandon()


def _add_levels(header: dict[str, Any], levels: list[Level]) -> None:
    header["levels"] = [level.count for level in levels]
    for level in levels:
        header["files"].update((name, facts_of(f)) for name, f in level.files.items())
    header["quantised"] = "quantised" in header["files"]
