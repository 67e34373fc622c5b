"""The materials of a stream as they are written, one small integer an object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.refusals import refused
from bfrt.streams.writer import FileWriter

#: Objects that are read back at once: their materials, to be written in wider integers, or boxes.
READ_BACK_AT_ONCE = 65536


class MaterialColumn:
    """Writes a stream's materials in the smallest integers that fit; nothing for a single one."""

    def __init__(self, folder: Path, durable: bool, saved: dict[str, Any] | None = None) -> None:
        self._path = folder / "materials"
        self._durable = durable
        self._file: FileWriter | None = None
        self._count = 0
        self.first = 0
        self.bytes = 0
        if saved is not None:
            self._count, self.first, self.bytes = saved["count"], saved["first"], saved["width"]
        if saved is not None and self.bytes:
            behind = saved["bytes"], saved["crc32"]
            self._file = FileWriter(self._path.with_suffix(f".{self.bytes}"), durable, behind)

    def saved(self) -> dict[str, Any]:
        """Have all on the disk; return what brings the column back to here, for JSON."""
        facts = {"count": self._count, "first": self.first, "width": self.bytes}
        if self._file is None:
            return {**facts, "bytes": 0, "crc32": 0}
        self._file.sync()
        return {**facts, "bytes": self._file.bytes, "crc32": self._file.checksum}

    def append(self, materials: NDArray[np.uint32]) -> None:
        if self._count == 0 and len(materials):
            self.first = int(materials[0])
        top = max(self.first, int(materials.max(initial=0)))
        width = 1 if top < 1 << 8 else 2 if top < 1 << 16 else 4
        if width > self.bytes and (self.bytes or not (materials == self.first).all()):
            self._widen(width)
        if self._file is not None:
            self._file.write(materials.astype(f"<u{self.bytes}"), kept=True)
        self._count += len(materials)

    def wait(self) -> None:
        """Wait until what was handed over is written, so that its memory is free."""
        if self._file is not None:
            self._file.wait()

    def _widen(self, width: int) -> None:
        """Write the indices so far again, in wider integers."""
        old, old_bytes = self._file, self.bytes
        wider = FileWriter(self._path.with_suffix(f".{width}"), self._durable)
        self._file, self.bytes = wider, width
        if old is None:
            for done in range(0, self._count, READ_BACK_AT_ONCE):
                n = min(READ_BACK_AT_ONCE, self._count - done)
                wider.write(np.full(n, self.first, f"<u{width}"))
            return
        old.close()
        try:
            with old.path.open("rb") as file:
                while block := file.read(READ_BACK_AT_ONCE):
                    wider.write(np.frombuffer(block, f"<u{old_bytes}").astype(f"<u{width}"))
            old.path.unlink()
        except OSError as error:
            raise refused(old.path, 0, error, "reading") from error

    def close(self) -> FileWriter | None:
        if self._file is not None:
            self._file.close()
            try:
                self._file.path.rename(self._path)
            except OSError as error:
                raise refused(self._path, 0, error, "renaming to it") from error
        return self._file

    def abandon(self) -> None:
        if self._file is not None:
            self._file.abandon()
