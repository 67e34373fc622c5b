"""All objects of one kind in one group of a store: what its header says, and their files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import DTypeLike, NDArray

from bfrt.errors import StoreError
from bfrt.ids import stream_number
from bfrt.records import (
    BOX_BYTES,
    CODE_BYTES,
    NODE_BYTES,
    OFFSET_BYTES,
    PARENT_BYTES,
    SCALARS,
    TREELET_BYTES,
    Kind,
)
from bfrt.store.file_facts import FileFacts
from bfrt.store.folder import StoreFolder
from bfrt.streams.reader import SharedFile


@dataclass(frozen=True)
class Stream:
    """Describes all objects of one kind in one group, and opens its files.

    Attributes
    ----------
    store : StoreFolder
        Where they are opened.
    folder : Path
        Where they are.
    local : bool
        Whether objects that followed each other were known to lie near each other as they came.
    first_material : int
        Place of the store's first material in the palette of a scene that has several stores.
    """

    store: StoreFolder
    folder: Path
    local: bool
    group: int
    kind: Kind
    count: int
    wide: bool
    degenerate: int
    material: int
    material_bytes: int
    vertices: int
    largest: int
    levels: tuple[int, ...]
    quantised: bool
    id_bytes: int
    treelets: int
    nodes: int
    treelet_bytes: int
    files: dict[str, FileFacts]
    first_material: int = 0

    @property
    def number(self) -> int:
        """Return the stream's part of an object id."""
        return stream_number(self.group, self.kind)

    @property
    def stride(self) -> int:
        """Return the bytes of a record; for polygons, of a vertex."""
        return SCALARS[self.kind] * (8 if self.wide else 4)

    @property
    def ordered(self) -> bool:
        """Tell whether objects are in spatial order, in treelets."""
        return self.id_bytes > 0

    @property
    def boxed(self) -> bool:
        """Tell whether boxes are stored; others are worked out of the records, of one size."""
        return self.kind.boxed and (self.kind.counted or not self.ordered)

    def path(self, name: str) -> Path:
        return self.folder / name

    def opened(self, name: str, prefetched: bool = False, direct: bool = False) -> SharedFile:
        """Open a file for readers, who may prefetch it if `prefetched`, past the cache if `direct`.

        Raises
        ------
        StoreError
            If it is not there, of another size than the header says, or another store's by now.
        StreamError
            As the system refuses.
        """
        return self.store.shared(self.path(name), self.files[name].bytes, prefetched, direct)

    def load(self, name: str, dtype: DTypeLike) -> NDArray[Any]:
        """Read a file as an array, (n,) of dtype; else as `opened`."""
        return self.store.load(self.path(name), self.files[name].bytes, dtype)

    def expected_bytes(self) -> dict[str, int]:
        """Return the size of each file, bytes, that the counts imply."""
        records = self.vertices if self.kind.counted else self.count
        sizes = {"geometry": records * self.stride}
        if self.boxed:
            sizes["boxes"] = self.count * BOX_BYTES
        if self.kind.counted:
            sizes["offsets"] = self.count * OFFSET_BYTES
        if self.material_bytes:
            sizes["materials"] = self.count * self.material_bytes
        for number, count in enumerate(self.levels, 1):
            sizes[f"level{number}"] = count * PARENT_BYTES
        if self.quantised:
            sizes["quantised"] = self.count * CODE_BYTES
        if self.ordered:
            sizes["ids"] = self.count * self.id_bytes
            sizes["nodes"] = self.nodes * NODE_BYTES
            sizes["treelets"] = self.treelets * TREELET_BYTES
        return sizes

    def check_header(self) -> None:
        """Refuse facts about files that contradict the counts.

        Raises
        ------
        StoreError
            If they do.
        """
        found = {name: facts.bytes for name, facts in self.files.items()}
        if found != self.expected_bytes():
            raise StoreError(f"{self.folder}: the header contradicts its own counts")
