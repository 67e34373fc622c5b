"""Text of the encodings that a byte order mark tells, as UTF-8 without the mark.

Text without a mark is taken as it is: all that readers look for is ASCII, and names are bytes.
"""

from __future__ import annotations

import codecs

from bfrt.errors import SceneError

#: Marks, and the encodings that they tell.
MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}

#: Bytes of the longest mark.
MARK_BYTES = max(map(len, MARKS))

#: The mark of UTF-32, which is not read, and which begins as that of UTF-16 does.
NOT_READ = codecs.BOM_UTF32_LE


def mark_of(head: bytes) -> bytes:
    """Return the byte order mark that a text begins with, empty if none."""
    return next((mark for mark in MARKS if head.startswith(mark)), b"")


class Decoder:
    """Turn a text that comes piece by piece into UTF-8 without its mark.

    Parameters
    ----------
    name : str
        Name of the file, for errors.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._at = 0
        self._held: bytes | None = b""  # the first bytes, as long as they may yet be a mark
        self._units: codecs.IncrementalDecoder | None = None

    def decode(self, piece: bytes, *, final: bool) -> bytes:
        """Decode a piece of text as far as it is complete.

        Parameters
        ----------
        piece : bytes
        final : bool
            Whether it is the last.

        Raises
        ------
        SceneError
            If it is not of the encoding that its mark tells.
        """
        if self._held is not None:
            piece = self._held + piece
            self._held = piece
            longer = (mark for mark in (*MARKS, NOT_READ) if mark != piece)
            if not final and any(mark.startswith(piece) for mark in longer):
                return b""
            piece = self._begin(piece)
        return piece if self._units is None else self._transcoded(piece, final=final)

    def _begin(self, head: bytes) -> bytes:
        """Choose the encoding by the mark; return the bytes behind it."""
        self._held = None
        if head.startswith(NOT_READ):
            raise SceneError(
                f"{self._name}: byte 0: found the byte order mark of UTF-32, expected that "
                "of UTF-8 or UTF-16, or none"
            )
        mark = mark_of(head)
        if MARKS.get(mark, "utf-8") != "utf-8":
            self._units = codecs.getincrementaldecoder(MARKS[mark])()
        self._at = len(mark)
        return head[len(mark) :]

    def _transcoded(self, piece: bytes, *, final: bool) -> bytes:
        assert self._units is not None
        begun, _ = self._units.getstate()
        try:
            text = self._units.decode(piece, final)
        except UnicodeDecodeError as error:
            at = self._at - len(begun) + error.start
            found = error.object[error.start : error.end]
            raise SceneError(
                f"{self._name}: byte {at}: found {found!r}, expected UTF-16, as the byte order "
                "mark at its begin says"
            ) from None
        self._at += len(piece)
        return text.encode()
