"""Files that are read forwards, by blocks or by chunks of text, and what errors say of them."""

from __future__ import annotations

import errno
import io
import os
import stat
from collections.abc import Callable, Iterator
from functools import cached_property
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.errors import BfrtError, SceneError, SettingError, ShortReadError, StreamError
from bfrt.formats.encoding import MARK_BYTES, MARKS, Decoder, mark_of
from bfrt.formats.gzipped import Unpacked, is_packed
from bfrt.refusals import calling, give_up, refused

#: Bytes of text that are parsed at once.
CHUNK_BYTES = 1 << 20

#: What may be behind the end of a text.
PADDING = b" \t\n\v\f\r\0"

#: Bytes of a token that are shown.
SHOWN_BYTES = 40

#: Called with the bytes of input that are done.
Report = Callable[[int], None]

Bytes = npt.NDArray[np.uint8]


class Source:
    """Reads a file forwards, knows its place, and names it in errors.

    Of a file that gzip has packed, as its name ends with .gz, it reads the content.

    Libraries that want a file to read are given this one: `failure` then tells what the system
    refused from what they cannot make sense of.

    Parameters
    ----------
    path : path-like
        A file that can be read again.
    report : callable, optional
        Called with the bytes that are read.

    Raises
    ------
    SettingError
        If it is a pipe, or whatever else is no file; it is not waited for.
    StreamError
        If the system refuses to open or read it.
    """

    def __init__(self, path: str | os.PathLike[str], report: Report | None = None) -> None:
        self.name = os.fspath(path)
        self.at = 0
        self.report = report
        self._refused: StreamError | None = None
        with calling(self.name, "opening"):
            self._file = io.FileIO(self.name, opener=opened_at_once)
            try:
                there = os.fstat(self._file.fileno())
            except OSError:
                give_up(self._file)
                raise
        if not stat.S_ISREG(there.st_mode):
            give_up(self._file)
            raise SettingError(
                f"{self.name}: found {a_kind(there.st_mode)}, expected a file, which can be read "
                "more than once: of what can be read but once NFF alone is read (.nff, or - for "
                "standard input)"
            )
        self.size = there.st_size
        self._packed: Unpacked | None = None
        if is_packed(self.name):
            self._unpack()

    def _unpack(self) -> None:
        """Read the content of a packed file from now on."""
        self._packed = Unpacked(self._file, self.name)
        try:
            with calling(self.name, "reading"):
                self.size = self._packed.measure()
        except BaseException:
            give_up(self._file)
            raise

    @property
    def done(self) -> int:
        """Return the bytes of the file that are read, packed as they are."""
        return self.at if self._packed is None else self._packed.taken

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Go on at a byte: from the begin, from here (1) or from the end (2)."""
        at = offset + (0, self.at, self.size)[whence]
        if not 0 <= at < 1 << 63:
            raise OSError(errno.EINVAL, f"byte {at}")
        try:
            (self._packed or self._file).seek(at)
        except OSError as error:
            self._refused = refused(self.name, at, error, "seeking")
            raise self._refused from error
        self.at = at
        return at

    def tell(self) -> int:
        return self.at

    def seekable(self) -> bool:
        return True

    def read_into(self, buffer: memoryview) -> int:
        """Fill a buffer as far as the file goes; return the bytes."""
        done = 0
        file = self._packed or self._file
        try:
            while done < len(buffer) and (got := file.readinto(buffer[done:])):
                done += got
        except OSError as error:
            self._refused = refused(self.name, self.at + done, error, "reading")
            raise self._refused from error
        self.at += done
        if self.report is not None:
            self.report(self.done)
        return done

    def readinto(self, buffer: Any, /) -> int:
        """Fill a buffer of any type as far as the file goes; return the bytes."""
        return self.read_into(memoryview(buffer).cast("B"))

    def read(self, most: int = -1, /) -> bytes:
        """Return the next bytes, fewer only at the file's end; all the rest for -1."""
        left = max(self.size - self.at, 0)
        buffer = bytearray(left if most < 0 else min(most, left))
        got = self.read_into(memoryview(buffer))
        return bytes(memoryview(buffer)[:got])

    def exactly(self, size: int) -> Bytes:
        """Return the next `size` bytes.

        Raises
        ------
        ShortReadError
            If the file ends before.
        """
        left = self.size - self.at
        if left < size:
            raise ShortReadError(self.name, self.at, size, max(left, 0))
        block = np.empty(size, np.uint8)
        start = self.at
        got = self.read_into(block.data)
        if got < size:
            raise ShortReadError(self.name, start, size, got)
        return block

    def blocks(self, dtype: np.dtype[Any], count: int, most: int) -> Iterator[npt.NDArray[Any]]:
        """Yield the next `count` records, `most` of them at a time at most."""
        while count:
            n = min(count, most)
            yield self.exactly(n * dtype.itemsize).view(dtype)
            count -= n

    @cached_property
    def mark(self) -> bytes:
        """Return the byte order mark that the text begins with, empty if none."""
        self.seek(0)
        return mark_of(self.read(MARK_BYTES))

    @property
    def is_utf8(self) -> bool:
        """Tell whether the text is UTF-8, so that its bytes are the file's, behind the mark."""
        return MARKS.get(self.mark, "utf-8") == "utf-8"

    @property
    def most_text(self) -> int:
        """Return an upper bound of the text's bytes: two of UTF-16 may take three of UTF-8."""
        return self.size - len(self.mark) if self.is_utf8 else self.size // 2 * 3

    def head(self, size: int) -> bytes:
        """Return the first bytes of the text, fewer only where it ends."""
        buffer = bytearray(min(size, self.most_text))
        got = self._text_from(0)(memoryview(buffer))
        return bytes(memoryview(buffer)[:got])

    def _text_from(self, at: int) -> Callable[[memoryview], int]:
        """Return a function that reads the text from byte `at` on, as `read_into` does."""
        if not self.is_utf8:
            return _Transcoded(self, at).read_into
        self.seek(len(self.mark) + at)
        return self.read_into

    def text_left(self, at: int) -> int:
        """Count the bytes of the text from byte `at` on, without padding by blanks and NULs."""
        read_into = self._text_from(at)
        buffer = memoryview(bytearray(CHUNK_BYTES))
        left = 0
        while got := read_into(buffer):
            left += len(bytes(buffer[:got]).strip(PADDING))
        return left

    def text(self, at: int = 0, *, lines: bool = False) -> Iterator[Bytes]:
        """Yield the text in chunks of whole tokens, or of whole lines, for `bfrt.formats.text`.

        It is UTF-8 without its mark, and all places in it are of that.

        Parameters
        ----------
        at : int
            The byte to begin at.
        lines : bool
            Whether chunks end where lines do.

        Yields
        ------
        ndarray of uint8
            The byte before, the chunk, and a NUL; used again for the next.

        Raises
        ------
        SceneError
            If there is a line of more than `CHUNK_BYTES`.
        """
        read_into = self._text_from(at)
        buffer = np.zeros(2 * CHUNK_BYTES + 2, np.uint8)
        before = ord(" ")
        left = b""
        while True:
            start = 1 + len(left)
            buffer[0] = before
            buffer[1:start] = np.frombuffer(left, np.uint8)
            got = read_into(buffer.data[start : start + CHUNK_BYTES])
            end = start + got
            whole = end if not got else self._cut(buffer.data[:end], lines)
            left = buffer[whole:end].tobytes()
            if len(left) >= CHUNK_BYTES:
                raise SceneError(
                    f"{self.name}: byte {self.at - len(left)}: found a line or a token of "
                    f"more than {CHUNK_BYTES} bytes, expected shorter ones"
                )
            before = int(buffer[whole - 1])  # whether a line's end goes on in the next chunk
            buffer[whole] = 0
            yield buffer[: whole + 1]
            if not got:
                return

    @staticmethod
    def _cut(text: memoryview, lines: bool) -> int:
        """Find where the last whole token or line ends."""
        if lines:
            held = bytes(text)
            end = max(held.rfind(b"\n"), held.rfind(b"\r"))
            while end > 0 and held[:end].endswith((b"\\", b"\\\r")):  # the line goes on
                end = max(held.rfind(b"\n", 0, end), held.rfind(b"\r", 0, end))
            return max(end, 0) + 1
        tail = bytes(text[-CHUNK_BYTES:])
        ends = max(tail.rfind(blank) for blank in (b" ", b"\n", b"\t", b"\r"))
        return len(text) - len(tail) + ends + 1

    def failure(
        self, error: BaseException, expected: str, place: str = ""
    ) -> BfrtError | MemoryError:
        """Return the exception for an error of reading: the system's refusal if that is why."""
        if isinstance(error, (BfrtError, MemoryError)):
            return error
        return self._refused or SceneError(
            f"{self.name}: {place}found {said(error)}, expected {expected}"
        )

    def close(self) -> None:
        with calling(self.name, "closing", self.at):
            self._file.close()

    def __enter__(self) -> Source:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class _Transcoded:
    """Reads UTF-16 as UTF-8, forwards from a byte of the UTF-8."""

    def __init__(self, source: Source, at: int) -> None:
        source.seek(0)
        self._source = source
        self._decoder = Decoder(source.name)
        self._ahead = b""
        buffer = memoryview(bytearray(min(at, CHUNK_BYTES)))
        while at and (passed := self.read_into(buffer[:at])):
            at -= passed

    def read_into(self, buffer: memoryview) -> int:
        """Fill a buffer as far as the text goes; return the bytes."""
        while len(self._ahead) < len(buffer):
            piece = self._source.read(CHUNK_BYTES)
            self._ahead += self._decoder.decode(piece, final=not piece)
            if not piece:
                break
        got = min(len(buffer), len(self._ahead))
        buffer[:got] = self._ahead[:got]
        self._ahead = self._ahead[got:]
        return got


def opened_at_once(path: str, flags: int) -> int:
    """Open a path, and wait for nobody who would write into a pipe; `io.FileIO`'s ``opener``."""
    return os.open(path, flags | os.O_NONBLOCK)


def a_kind(mode: int) -> str:
    """Return in words what a path leads to that is no file, by its mode."""
    return "a pipe" if stat.S_ISFIFO(mode) else "a device or a socket"


def said(error: BaseException) -> str:
    """Return the first line of a library's error, quoted for ours."""
    return repr(next(iter(str(error).splitlines()), type(error).__name__)[:200])


def printable(name: str) -> str:
    """Return a name for an error, on one line for any name."""
    return name if name.isprintable() else repr(name)


def quoted(token: bytes) -> str:
    """Return a token for an error, on one line for any bytes."""
    if not token:
        return "end of file"
    dots = "..." if len(token) > SHOWN_BYTES else ""
    return repr(token[:SHOWN_BYTES].decode("ascii", "backslashreplace")) + dots
