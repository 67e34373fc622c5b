"""HDF5: datasets of particles, or of a mesh, by h5py, a block of rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.arrays import Array, write_arrays
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source

#: What h5py makes of a broken file.
BROKEN = (OSError, RuntimeError, ValueError, KeyError, TypeError)


class Dataset:
    """A dataset as `bfrt.formats.arrays.Array`."""

    def __init__(self, name: str, dataset: Any, path: str) -> None:
        self.name = name
        self.shape: tuple[int, ...] = dataset.shape
        self.dtype: np.dtype[Any] = dataset.dtype
        self._dataset = dataset
        self._path = path

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """All rows, `rows` at a time."""
        for first in range(0, self.shape[0], rows):
            try:
                block: NDArray[Any] = self._dataset[first : first + rows]
            except BROKEN as error:
                raise SceneError(
                    f"{self._path}: {self.name}: row {first}: found {told(error)}, "
                    "expected rows that can be read"
                ) from None
            yield block


def read_hdf5(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an HDF5 file, whose datasets' names tell what they are: `bfrt.formats.arrays`.

    Raises
    ------
    SceneError
        If it is no HDF5, or its datasets make no scene.
    SettingError
        If a setting does not fit them, or h5py is missing.
    StreamError
        If the system refuses to open it.
    """
    try:
        import h5py
    except ImportError:
        raise SettingError(f"{path}: HDF5 needs h5py: install bfrt[hdf5]") from None
    with Source(path):  # what the system says of the file is not h5py's to word
        pass
    try:
        file = h5py.File(path, "r")
    except BROKEN as error:
        raise SceneError(f"{path}: found {told(error)}, expected an HDF5 file") from None
    with file:
        arrays: dict[str, Array] = {}

        def keep(name: str, thing: Any) -> None:
            if isinstance(thing, h5py.Dataset) and thing.shape:
                arrays[name] = Dataset(name, thing, path)

        try:
            file.visititems(keep)
        except BROKEN as error:
            raise SceneError(f"{path}: found {told(error)}, expected datasets") from None
        outlet = Outlet(sink, path, reading)
        write_arrays(path, arrays, outlet)
        outlet.report()
    if report is not None:
        report(Path(path).stat().st_size)


def told(error: BaseException) -> str:
    """An error's first line."""
    return repr(next(iter(str(error).splitlines()), type(error).__name__)[:200])
