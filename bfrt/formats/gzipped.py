"""Files that gzip has packed, unpacked forwards and again from the begin, in bounded memory."""

from __future__ import annotations

import contextlib
import io
import re
import zlib
from pathlib import Path
from typing import Any

from bfrt.errors import SceneError
from bfrt.paths import is_file

#: What the name of a packed file ends with.
SUFFIX = ".gz"

#: Bytes that are read at once, packed; and that are passed over at once, unpacked.
PACKED_AT_ONCE = 1 << 17
PASSED_AT_ONCE = 1 << 20

#: How an Esri grid begins, and the bytes in which it does.
GRID = re.compile(rb"\s*(?:ncols|nrows|[xy]ll|d[xy]|cellsize|nodata)", re.IGNORECASE)
LOOK = 256

#: What zlib is told of the header that gzip's files have.
GZIP_HEADER = 31


def is_packed(name: str) -> bool:
    """Tell whether a file is packed, by its name."""
    return name.lower().endswith(SUFFIX)


def suffix_of(name: str) -> str:
    """Return the suffix of a file's format, in lower case: of a packed file that of its content.

    ``.asc`` is the suffix of Esri's grids, and of points, of which a packed file is taken to be:
    these go as ``.xyz``.
    """
    path = Path(name)
    suffix = Path(path.stem if is_packed(name) else path.name).suffix.lower()
    return ".xyz" if suffix == ".asc" and (is_packed(name) or not is_grid(path)) else suffix


def is_grid(path: Path) -> bool:
    """Tell whether a file begins as an Esri grid does; what cannot be read does not."""
    if not is_file(path):  # a pipe is read once
        return False
    with contextlib.suppress(OSError), path.open("rb") as file:
        return GRID.match(file.read(LOOK)) is not None
    return False


class Unpacked:
    """Reads what a packed file contains, as `io.FileIO` reads a file.

    Parameters
    ----------
    file : io.FileIO
        The packed file, which stands at its begin.
    name : str
        Its name, for errors.

    Attributes
    ----------
    taken : int
        Packed bytes that were read.
    """

    def __init__(self, file: io.FileIO, name: str) -> None:
        self._file = file
        self._name = name
        self._restart()

    def _restart(self) -> None:
        self._file.seek(0)
        self.taken = 0
        self._at = 0
        self._ahead = b""
        self._member: Any = None
        self._ended = False

    def measure(self) -> int:
        """Return the bytes of the content, by a pass over it: no packed file's own word counts."""
        while self._passed(PASSED_AT_ONCE):
            pass
        size = self._at
        self._restart()
        return size

    def readinto(self, buffer: memoryview, /) -> int:
        """Fill a buffer, or a part of it; return the bytes, 0 at the end only.

        Raises
        ------
        SceneError
            If it is not what gzip writes, or is truncated.
        """
        piece = self._piece(len(buffer))
        buffer[: len(piece)] = piece
        return len(piece)

    def seek(self, at: int, /) -> int:
        """Go on at a byte of the content; back by beginning again."""
        if at < self._at:
            self._restart()
        while self._at < at and self._passed(min(at - self._at, PASSED_AT_ONCE)):
            pass
        return self._at

    def close(self) -> None:
        self._file.close()

    def _passed(self, most: int) -> int:
        return len(self._piece(most))

    def _piece(self, most: int) -> bytes:
        """Return the next bytes of the content, `most` at the most, none at its end."""
        piece = b""
        while not piece and most and not self._ended:
            piece = self._next(most)
        self._at += len(piece)
        return piece

    def _next(self, most: int) -> bytes:
        """Unpack some bytes, which may yield none."""
        if not self._ahead:
            self._ahead = self._file.read(PACKED_AT_ONCE) or b""
            self.taken += len(self._ahead)
        if self._member is None:
            return self._begin()
        if not self._ahead:
            raise SceneError(
                f"{self._name}: byte {self.taken}: found the file's end, expected more of what "
                "gzip has packed: the file is truncated"
            )
        try:
            piece: bytes = self._member.decompress(self._ahead, most)
        except zlib.error as error:
            raise self._refused(str(error)) from None
        self._ahead = self._member.unconsumed_tail or self._member.unused_data
        if self._member.eof:
            self._member = None
        return piece

    def _begin(self) -> bytes:
        """Begin a member, of which a file may have several; NULs behind the last are padding."""
        if self._at:
            self._ahead = self._ahead.lstrip(b"\0")
        if self._ahead:
            self._member = zlib.decompressobj(GZIP_HEADER)
        elif self.taken == 0:
            raise self._refused("no byte")
        else:
            self._ended = self._is_at_end()
        return b""

    def _is_at_end(self) -> bool:
        """Tell whether no packed byte follows; those that do are taken."""
        self._ahead = self._file.read(PACKED_AT_ONCE) or b""
        self.taken += len(self._ahead)
        return not self._ahead

    def _refused(self, found: str) -> SceneError:
        return SceneError(
            f"{self._name}: byte {max(self.taken - len(self._ahead), 0)}: found {found!r}, "
            "expected what gzip has packed"
        )
