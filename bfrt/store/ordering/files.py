"""A stream's files in spatial order, as they are written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import BOX_BYTES, NODE_BYTES, OFFSET_BYTES, Kind
from bfrt.refusals import calling
from bfrt.store.header import facts_of
from bfrt.store.material_column import MaterialColumn
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.objects import Layout, id_bytes_of
from bfrt.store.ordering.windows import OrderedWindow
from bfrt.streams.removal import remove_folder
from bfrt.streams.writer import FileWriter

#: Bytes of a buffer of a file; most of what is written is not copied there.
ORDERED_BUFFER = 1 << 19

#: What is counted on the way, by its name in what is saved.
COUNTS = ("done", "vertices", "treelets", "nodes", "treelet_bytes")


def ordered_names(kind: Kind) -> list[str]:
    """Return the names of the files of a stream in order, but for that of materials."""
    names = ["geometry", "ids", "nodes", "treelets"]
    return [*names, "offsets", "boxes"] if kind.counted else names


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
    saved : dict, optional
        What `saved` has returned: the files are there, and go on behind that.

    Attributes
    ----------
    done : int
        Objects so far.
    treelets, nodes : int
        Numbers of them.
    treelet_bytes : int
        Bytes of the largest treelet.
    """

    def __init__(
        self, folder: Path, layout: Layout, count: int, durable: bool,
        saved: dict[str, Any] | None = None,
    ) -> None:  # fmt: skip
        if saved is None:
            with calling(folder, "creating"):
                folder.mkdir()
        before = dict.fromkeys(COUNTS, 0) if saved is None else saved
        self.done: int = before["done"]
        self.treelets: int = before["treelets"]
        self.nodes: int = before["nodes"]
        self.treelet_bytes: int = before["treelet_bytes"]
        self._vertices: int = before["vertices"]
        self._layout = layout
        self.folder = folder
        self.id_bytes = id_bytes_of(count)
        self._materials = MaterialColumn(folder, durable, saved and saved["materials"])
        self._files: dict[str, FileWriter] = {}
        try:
            for name in ordered_names(layout.kind):
                facts = saved and saved["files"][name]
                behind = facts and (facts["bytes"], facts["crc32"])
                self._files[name] = FileWriter(
                    folder / name, durable, behind or None, ORDERED_BUFFER
                )
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
            files["boxes"].write(window.boxes, kept=True)
        treelets = window.treelets
        sizes = treelet_sizes(window, self._layout)
        self.treelet_bytes = max(self.treelet_bytes, int(sizes.max(initial=0)))
        treelets["first"] += self.done
        treelets["node"] += self.nodes
        files["treelets"].write(treelets)
        files["nodes"].write(window.nodes, kept=True)
        self.done += objects.number
        self.nodes += len(window.nodes)
        self.treelets += len(treelets)

    def wait(self) -> None:
        """Wait until all windows are written, so that their memory is free."""
        for file in self._files.values():
            file.wait()
        self._materials.wait()

    def saved(self) -> dict[str, Any]:
        """Have all on the disk; return what brings the files back to here, for JSON."""
        for file in self._files.values():
            file.sync()
        counts = (self.done, self._vertices, self.treelets, self.nodes, self.treelet_bytes)
        return {
            **dict(zip(COUNTS, counts, strict=True)),
            "files": {name: facts_of(file) for name, file in self._files.items()},
            "materials": self._materials.saved(),
        }

    def boxes(self) -> Iterator[NDArray[np.float32]]:
        """Yield the boxes of all objects so far, in their order, from the disk."""
        layout, records = self._layout, self._vertices if self._layout.kind.counted else self.done
        plain = layout._replace(material_bytes=0)
        for some in GivenFiles(self.folder, plain, self.done, records).blocks():
            yield some.boxes(layout)

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
