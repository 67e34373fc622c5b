"""Arrays of an HDF5 file that another process reads: `bfrt.formats.table.Arrays`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from bfrt.formats.remote.messages import type_of_words
from bfrt.formats.remote.process import Library, RemoteFile
from bfrt.formats.table import Array, Listed

HDF5 = Library("HDF5", "bfrt.formats.hdf5.child", "datasets that are whole")


class RemoteArray:
    """Reads an array of the file: a `bfrt.formats.table.Array`."""

    def __init__(
        self, file: RemoteFile, number: int, name: str, shape: list[int], dtype: Any
    ) -> None:
        self.name = name
        self.shape: tuple[int, ...] = tuple(shape)
        self.dtype = type_of_words(dtype)
        self._file, self._number = file, number

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        (begun,) = self._file.ask("begin", self._number, rows)
        most = rows * math.prod(self.shape[1:])
        while (block := self._file.numbers(["next", begun], self.dtype, most)) is not None:
            yield block
        self._file.ask("end", begun)

    def shallow(self) -> RemoteArray:
        """Return the last frame of (frames, n, 3), as (n, 3)."""
        return self.frame(-1)

    def frame(self, number: int) -> RemoteArray:
        """Return a frame of (frames, n, 3), as (n, 3)."""
        return RemoteArray(self._file, *self._file.ask("frame", self._number, number))


class RemoteArrays(Listed):
    """Maps paths to the arrays of a file, as `bfrt.formats.hdf5.datasets.Datasets` does there.

    Parameters
    ----------
    path : str
        The file.
    limits : tuple
        What `bfrt.formats.hdf5.origins.Limits` has.

    Raises
    ------
    SceneError, StreamError
        As for `RemoteFile`.
    """

    def __init__(self, path: str, limits: tuple[Any, ...]) -> None:
        self._file = RemoteFile(path, limits, HDF5)
        super().__init__(dict.fromkeys(self._file.facts))

    def close(self) -> None:
        """End the process that reads."""
        self._file.close()

    def attributes(self, path: str, *names: str) -> dict[str, Any] | None:
        """Return those attributes of some names that an object has; None if there is no object."""
        found: dict[str, Any] | None = self._file.ask("attributes", path, *names)[0]
        return found

    def __contains__(self, name: object) -> bool:
        if super().__contains__(name):
            return True
        return isinstance(name, str) and bool(self._file.ask("has", name)[0])

    def __getitem__(self, name: str) -> Array:
        return RemoteArray(self._file, *self._file.ask("open", name))
