"""A stream's files as they were given, read in blocks of objects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import ShortReadError
from bfrt.records import OFFSET_BYTES, Kind
from bfrt.refusals import calling, closing, refused
from bfrt.store.model import Vector
from bfrt.store.ordering.objects import (
    OBJECTS_AT_ONCE,
    Layout,
    Objects,
    bytes_for,
    few_at_once,
    id_bytes_of,
)
from bfrt.store.ordering.room import Amount, Room, room_of


class GivenFiles(NamedTuple):
    """Describes the files of a stream that is written.

    Attributes
    ----------
    folder : Path
    layout : Layout
    objects : int
        Number of them.
    records : int
        Objects again, or vertices of polygons.
    largest : int
        Records of an object at the most.
    """

    folder: Path
    layout: Layout
    objects: int
    records: int
    largest: int = 1

    def amount(self, local: bool) -> Amount:
        """Count what it has."""
        return Amount(self.objects, self.records, local, self.largest)

    def room(self, local: bool) -> Room:
        """Work out the room on disk of its ordering."""
        return room_of(self.layout, self.amount(local))

    @classmethod
    def of(cls, folder: Path, kind: Kind, facts: Mapping[str, Any], origin: Vector) -> GivenFiles:
        """Describe the files of a stream in a folder.

        Parameters
        ----------
        facts : mapping
            What the store's header says of the stream.
        origin : tuple of 3 float
            What its coordinates count from.
        """
        count = facts["count"]
        layout = Layout(
            kind, facts["wide"], origin, id_bytes_of(count), facts["material_bytes"],
            facts["material"],
        )  # fmt: skip
        records = facts["vertices"] if kind.counted else count
        return cls(folder, layout, count, records, max(1, facts["largest"]))

    def blocks(self) -> Iterator[Objects]:
        """Yield all objects, in the order given."""
        with ExitStack() as stack:
            geometry = _Column(stack, self.folder / "geometry")
            offsets = materials = None
            if self.layout.kind.counted:
                offsets = _Column(stack, self.folder / "offsets")
            if self.layout.material_bytes:
                materials = _Column(stack, self.folder / "materials")
            done = vertices = 0
            ahead = np.empty(0, np.uint32)  # the counts of polygons that come next
            while done < self.objects:
                records = n = min(OBJECTS_AT_ONCE, self.objects - done)
                if offsets is not None:
                    if not len(ahead):
                        ends = offsets.read(n, OFFSET_BYTES).view("<u4").astype(np.int64)
                        ahead = np.diff(ends, prepend=vertices).astype(np.uint32)
                    n = few_at_once(ahead)
                    counts, ahead = ahead[:n], ahead[n:]
                    records = int(counts.sum(dtype=np.int64))
                    vertices += records
                else:
                    counts = ahead
                raw = None
                if materials is not None:
                    raw = materials.read(n, self.layout.material_bytes)
                indices = self.layout.materials(n, raw)
                ids = np.arange(done, done + n, dtype=np.uint64)
                yield Objects(geometry.read(records, self.layout.stride), counts, indices, ids)
                done += n


class _Column:
    """Reads a file of records forwards."""

    def __init__(self, stack: ExitStack, path: Path) -> None:
        self._path = path
        with calling(path, "opening"):
            file = path.open("rb", buffering=0)
        self._file = stack.enter_context(closing(file, path))

    def read(self, records: int, size: int) -> NDArray[np.uint8]:
        """Return the next records of `size` bytes."""
        made = bytes_for(records * size)
        done = 0
        while done < len(made):
            try:
                got = self._file.readinto(made[done:].data)
            except OSError as error:
                raise refused(self._path, done, error, "reading") from error
            if not got:
                raise ShortReadError(self._path, done, len(made) - done, 0)
            done += got
        return made
