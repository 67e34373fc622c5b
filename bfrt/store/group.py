"""A group as its objects come: a stream for each kind, its bounds, its outliers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bfrt.errors import SceneError, SettingError
from bfrt.records import Kind
from bfrt.refusals import refused
from bfrt.store.columns import Prepared, StreamWriter
from bfrt.store.extent import Extent
from bfrt.store.making import Making
from bfrt.store.model import Vector
from bfrt.store.store import bounds_to
from bfrt.store.written import WrittenGroup, WrittenStream, hierarchy_over


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
        self._folder = folder
        self._number = number
        self._making = making
        self._extent = Extent()
        self._expected: Mapping[Kind, int] = {}
        self._surface = 0.0

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
                stream.hierarchy = hierarchy_over(
                    stream.folder, stream.kind, self._making, self._surface
                )
                stream.hierarchy.begin(count)
        self.streams[block.kind].append(block, self._extent)

    def close(self, origin: Vector) -> WrittenGroup:
        """Complete the files of all streams, which get no more objects."""
        written = [self._closed(self.streams[kind]) for kind in sorted(self.streams)]
        outliers, grid_bounds = self._extent.outliers()
        group = WrittenGroup(
            self._folder, self._number, self._making, written,
            {
                "bounds": bounds_to(self._extent.bounds),
                "grid_bounds": bounds_to(grid_bounds),
                "outliers": outliers,
                "surface": self._surface if self._expected else grid_bounds.surface,
                "seconds": 0.0,
            },
        )  # fmt: skip
        group.complete_begun(origin)
        return group

    def _closed(self, stream: StreamWriter) -> WrittenStream:
        header = stream.close()
        expected = self._expected.get(stream.kind, stream.count)
        if stream.count != expected:
            raise SceneError(
                f"{stream.label}: found {stream.count} objects, expected {expected} as announced"
            )
        return WrittenStream(
            stream.folder, header, local=stream.locality.local, begun=stream.hierarchy
        )

    def abandon(self) -> None:
        """Give the files up."""
        for stream in self.streams.values():
            stream.abandon()
