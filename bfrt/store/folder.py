"""The folder of a store: opened once, so that a session reads the files its header described.

A store that is replaced takes the name of the old one (bfrt/store/atomic_folder.py); who has opened
the old one goes on with its files, by the folder's descriptor, for as long as they are there. What
is then another file, or none, is told of as that: no file of a new store is taken for an old one's.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.paths import ABSENT, HEADER, UNKNOWN, without_links
from bfrt.refusals import give_up, refused
from bfrt.store.file_facts import check_size
from bfrt.streams.litter import restore
from bfrt.streams.reader import SharedFile


class StoreFolder:
    """Opens the files of a store, relative to its folder.

    It is pickled by its path and its header: another process opens the folder for itself, and
    refuses one with another header.

    Parameters
    ----------
    path : Path
        The folder.
    header : bytes, optional
        The header that has to be there; by default the one that is.

    Attributes
    ----------
    header : bytes
        The header's text.

    Raises
    ------
    StoreError
        If it is no folder with a header, or one with another.
    StreamError
        As the system refuses.
    """

    _descriptor = -1

    def __init__(self, path: Path, header: bytes | None = None) -> None:
        self.path = path
        missing = StoreError(f"{path}: not a scene store: expected a directory with {HEADER}")
        try:
            self._descriptor = self._open()
        except (FileNotFoundError, NotADirectoryError):
            raise missing if header is None else self._removed() from None
        except OSError as error:
            raise refused(path, 0, error, "opening") from error
        with self.closed_on_error():
            found = self._found_header()
            if header is None and found is None:
                raise missing
            self.header = found or b"" if header is None else header
            self.check()

    def _open(self) -> int:
        """Open the folder, also where its replacement has ended half-way."""
        flags = getattr(os, "O_PATH", os.O_RDONLY) | os.O_DIRECTORY | os.O_CLOEXEC
        try:
            return os.open(self.path, flags)
        except FileNotFoundError:
            if not restore(without_links(self.path)):
                raise
        return os.open(self.path, flags)

    def move(self, path: Path) -> None:
        """Take the name that the folder has got."""
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return StoreFolder, (self.path, self.header)

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Open no more files."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            give_up(descriptor)

    @contextmanager
    def closed_on_error(self) -> Iterator[None]:
        """Close the folder where a block fails: else it is open for as long as the error is."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def opener(self, path: str | os.PathLike[str], flags: int) -> int:
        """Open a file of the store, as the ``opener`` of Python's own `open`.

        Raises
        ------
        StoreError
            If it is not there.
        OSError
            As the system refuses.
        """
        try:
            return self._opened(path, flags)
        except (FileNotFoundError, NotADirectoryError):
            raise self.fault() or StoreError(f"{path}: the file is missing") from None

    def examine(self, path: Path, size: int) -> None:
        """Refuse a file that is not there, or of another size than `size` bytes; else as `read`."""
        try:
            found = os.stat(self._name(path), dir_fd=self._descriptor).st_size
        except (FileNotFoundError, NotADirectoryError):
            missing = StoreError(f"{path}: the file is missing: expected {size} bytes")
            raise self.fault() or missing from None
        except OSError as error:
            raise refused(path, 0, error, "examining") from error
        check_size(path, size, found)

    def read(self, path: Path) -> bytes:
        """Read a file of the store.

        Raises
        ------
        StoreError
            If it is not there.
        StreamError
            As the system refuses.
        """
        try:
            with open(path, "rb", opener=self.opener) as file:
                return file.read()
        except OSError as error:
            raise refused(path, 0, error, "reading") from error

    def load(self, path: Path, size: int, dtype: DTypeLike) -> NDArray[Any]:
        """Read a file of `size` bytes as an array, (n,) of dtype; else as `shared`."""
        try:
            with open(path, "rb", opener=self.opener) as file:
                self.check_open(path, file.fileno(), size)
                array: NDArray[Any] = np.fromfile(file, dtype)
        except OSError as error:
            raise refused(path, 0, error, "reading") from error
        return array

    def shared(
        self, path: Path, size: int, prefetched: bool = False, direct: bool = False
    ) -> SharedFile:
        """Open a file of `size` bytes for readers, as `SharedFile`.

        Raises
        ------
        StoreError
            If it is not there, or of another size.
        StreamError
            As the system refuses.
        """
        file = SharedFile(path, prefetched, self.opener, direct)
        self.check_open(path, file.fileno(), size)
        return file

    def check_open(self, path: Path, descriptor: int, size: int) -> None:
        """Refuse an open file of another size than `size` bytes; else as `shared`."""
        try:
            check_size(path, size, os.fstat(descriptor).st_size)
        except StoreError as error:
            raise self.fault() or error from None
        except OSError as error:
            raise refused(path, 0, error, "examining") from error

    @property
    def in_place(self) -> bool:
        """Tell whether the path leads to this folder still."""
        try:
            return os.path.samestat(self.path.stat(), os.fstat(self._descriptor))
        except OSError as error:
            if error.errno in UNKNOWN:
                return False
            raise refused(self.path, 0, error, "examining") from error

    def fault(self) -> StoreError | None:
        """Return what has become of the store since it was opened; None if it is where it was."""
        found = self._found_header()
        if found == self.header and self.in_place:
            return None
        if (found or self.header) != self.header or os.path.lexists(self.path / HEADER):
            return self._replaced()
        return self._removed()

    def check(self) -> None:
        """Refuse a folder that has another header by now, or none; it may have another path.

        Raises
        ------
        StoreError
            If it has.
        """
        if self._found_header() != self.header:
            raise self.fault() or self._replaced()

    @contextmanager
    def session(self) -> Iterator[None]:
        """See to it that all that is read meanwhile is the store that was opened.

        Raises
        ------
        StoreError
            If it was replaced or removed, and what was read may be another's, or is missing.
        """
        self.check()
        try:
            yield
        except (StoreError, ShortReadError) as error:
            raise self.fault() or error from None
        except StreamError as error:
            raise (self.fault() if error.errno in ABSENT else None) or error from None
        if self._found_header() not in (self.header, None):  # what was open before it went is whole
            raise self._replaced()

    def _name(self, path: str | os.PathLike[str]) -> Path:
        """Return the path of a file from the folder on."""
        return Path(path).relative_to(self.path)

    def _opened(self, path: str | os.PathLike[str], flags: int) -> int:
        """Open a file of the store, as the system has it."""
        return os.open(self._name(path), flags | os.O_CLOEXEC, dir_fd=self._descriptor)

    def _found_header(self) -> bytes | None:
        """Read the header; None where there is none."""
        file = self.path / HEADER
        try:
            with open(file, "rb", opener=self._opened) as opened:
                return opened.read()
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            return None
        except OSError as error:
            raise refused(file, 0, error, "reading") from error

    def _replaced(self) -> StoreError:
        return StoreError(f"{self.path}: the store was replaced while it was open; open it again")

    def _removed(self) -> StoreError:
        return StoreError(f"{self.path}: the store was removed while it was open")
