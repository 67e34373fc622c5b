"""A stream's files in spatial order, as they are written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import BOX_BYTES, NODE_BYTES, OFFSET_BYTES
from bfrt.refusals import calling, refused
from bfrt.store.header import facts_of
from bfrt.store.material_column import MaterialColumn
from bfrt.store.ordering.objects import Layout, id_bytes_of
from bfrt.store.ordering.windows import OrderedWindow
from bfrt.streams.removal import remove_folder
from bfrt.streams.writer import FileWriter


class OrderedFiles:
    """Writes the files of one stream, window by window.

    Parameters
    ----------
    folder : Path
        The folder, which is created.
    layout : Layout
    count : int
        Objects that will come.
    durable : bool

    Attributes
    ----------
    treelets, nodes : int
        Numbers of them.
    treelet_bytes : int
        Bytes of the largest treelet.
    """

    def __init__(self, folder: Path, layout: Layout, count: int, durable: bool) -> None:
        try:
            folder.mkdir()
        except OSError as error:
            raise refused(folder, 0, error, "creating") from error
        self.treelets = self.nodes = self.treelet_bytes = 0
        self._layout = layout
        self.folder = folder
        self.id_bytes = id_bytes_of(count)
        self._done = self._vertices = 0
        self._materials = MaterialColumn(folder, durable)
        self._files: dict[str, FileWriter] = {}
        names = ["geometry", "ids", "nodes", "treelets"]
        if layout.kind.counted:
            names += ["offsets", "boxes"]
        try:
            for name in names:
                self._files[name] = FileWriter(folder / name, durable)
        except BaseException:
            self.abandon()
            raise

    def append(self, window: OrderedWindow) -> None:
        """Write the next window."""
        files, objects = self._files, window.objects
        files["geometry"].write(objects.geometry, kept=True)
        files["ids"].write(objects.ids.astype(f"<u{self.id_bytes}"), kept=True)
        self._materials.append(objects.materials)
        if "offsets" in files:
            ends = self._vertices + np.cumsum(objects.counts, dtype=np.uint64)
            files["offsets"].write(ends.astype("<u4"))
            self._vertices = int(ends[-1])
            files["boxes"].write(window.boxes)
        treelets = window.treelets
        sizes = treelet_sizes(window, self._layout)
        self.treelet_bytes = max(self.treelet_bytes, int(sizes.max(initial=0)))
        treelets["first"] += self._done
        treelets["node"] += self.nodes
        files["treelets"].write(treelets)
        files["nodes"].write(window.nodes, kept=True)
        self._done += objects.number
        self.nodes += len(window.nodes)
        self.treelets += len(treelets)

    def close(self) -> dict[str, Any]:
        """Make the files durable; return what the header says of them."""
        facts = {}
        for name, file in self._files.items():
            file.close()
            facts[name] = facts_of(file)
        if column := self._materials.close():
            facts["materials"] = facts_of(column)
        return {
            "material": self._materials.first,
            "material_bytes": self._materials.bytes,
            "id_bytes": self.id_bytes,
            "treelets": self.treelets,
            "nodes": self.nodes,
            "treelet_bytes": self.treelet_bytes,
            "files": facts,
        }

    def abandon(self) -> None:
        """Give the files up."""
        for file in self._files.values():
            file.abandon()
        self._materials.abandon()


def treelet_sizes(window: OrderedWindow, layout: Layout) -> NDArray[np.int64]:
    """Return the bytes of each treelet of a window: its nodes and records; of objects that have
    several of these each, which are aligned to 8, also the boxes and where the records end.
    """
    treelets, objects = window.treelets, window.objects
    count: NDArray[np.int64] = treelets["count"].astype(np.int64)
    nodes: NDArray[np.int64] = treelets["nodes"].astype(np.int64) * NODE_BYTES
    if not layout.kind.counted:
        return nodes + count * layout.stride
    ends = np.concatenate([[0], np.cumsum(objects.counts, dtype=np.int64)])
    first = treelets["first"].astype(np.int64)
    records: NDArray[np.int64] = ends[first + count] - ends[first]
    return nodes + count * (BOX_BYTES + OFFSET_BYTES) + 8 + records * layout.stride


def ordered_folder(folder: Path) -> Path:
    """Return where the files of a stream's folder are brought into order."""
    return folder.with_name(f"{folder.name}.ordered")


def replace_folder(folder: Path, other: Path) -> None:
    """Put another folder in the place of one."""
    with calling(folder, "replacing"):
        if (refusal := remove_folder(folder)) is not None:
            raise refusal
        other.rename(folder)
