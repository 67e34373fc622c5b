"""A group as it is written: a stream for each kind, its bounds, its outliers, its hierarchies."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bfrt.errors import SettingError
from bfrt.records import Kind
from bfrt.store.columns import Prepared, StreamWriter
from bfrt.store.extent import Bounds, Extent
from bfrt.store.header import facts_of
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.model import Vector
from bfrt.store.store import bounds_to
from bfrt.streams.atomic_write import refused


class GroupWriter:
    """Writes one group of a store.

    Parameters
    ----------
    folder : Path
        The group's folder, which is created.
    number : int
        The group's number.
    """

    def __init__(self, folder: Path, number: int, hierarchy: Hierarchy, durable: bool) -> None:
        try:
            folder.mkdir()
        except OSError as error:
            raise refused(folder, 0, error, "creating") from error
        self.streams: dict[Kind, StreamWriter] = {}
        self.hierarchy_seconds = 0.0
        self._folder = folder
        self._number = number
        self._hierarchy = hierarchy
        self._durable = durable
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
                self._folder / block.kind.label, self._number, block.kind, block.wide, self._durable
            )
            self.streams[block.kind] = stream
            if count := self._expected.get(block.kind):
                stream.expect(count, self._surface, self._hierarchy)
        self.streams[block.kind].append(block, self._extent)

    def close(self, origin: Vector) -> dict[str, Any]:
        """Complete all files; return the group's part of the header."""
        headers = [self.streams[kind].close() for kind in sorted(self.streams)]
        outliers, grid_bounds = self._extent.outliers()
        surface = self._surface if self._expected else grid_bounds.surface
        hierarchies = [s.hierarchy for s in self.streams.values() if s.hierarchy is not None]
        begun = sum(level.seconds for hierarchy in hierarchies for level in hierarchy.levels)
        start = time.perf_counter() - begun
        for header in headers:
            stream = self.streams[Kind(header["kind"])]
            levels = stream.make_levels(self._hierarchy, surface, origin)
            header["levels"] = [level.count for level in levels]
            for level in levels:
                header["files"].update((name, facts_of(f)) for name, f in level.files.items())
            header["quantised"] = "quantised" in header["files"]
        self.hierarchy_seconds = time.perf_counter() - start
        return {"streams": headers, "grid_bounds": bounds_to(grid_bounds), "outliers": outliers}

    def abandon(self) -> None:
        """Give the files up."""
        for stream in self.streams.values():
            stream.abandon()
