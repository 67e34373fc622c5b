"""HDF5: datasets of particles, or of a mesh, by h5py, a block of rows at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.formats.arrays import Lazy, write_arrays
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source, printable


class Dataset:
    """A dataset as `bfrt.formats.arrays.Array`."""

    def __init__(self, source: Source, name: str, dataset: Any) -> None:
        self.name = f"{source.name}: {printable(name)}"
        self._place = f"{printable(name)}: "
        self._source = source
        self._dataset = dataset
        try:
            self.shape: tuple[int, ...] = dataset.shape
            self.dtype: np.dtype[Any] = dataset.dtype
        except Exception as error:
            raise source.failure(error, "numbers of a type that NumPy has", self._place) from error

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """All rows, `rows` at a time."""
        for first in range(0, self.shape[0], rows):
            try:
                block: NDArray[Any] = self._dataset[first : first + rows]
            except Exception as error:
                place = f"{self._place}row {first}: "
                raise self._source.failure(error, "rows that can be read", place) from error
            yield block


def _opened(source: Source, h5py: Any) -> Any:
    """h5py's file that reads a source.

    The list of properties that says how to read has to be closed here. One that an error's frames
    keep alive is closed by HDF5 at the end of the process, when there is no Python any more for
    it to tell: a segmentation fault.
    """
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    try:
        access.set_fileobj_driver(h5py.h5fd.fileobj_driver, source)
        name = os.fsencode(source.name)
        return h5py.File(h5py.h5f.open(name, h5py.h5f.ACC_RDONLY, fapl=access))
    except Exception as error:  # h5py has them of every kind for files that are broken
        raise source.failure(error, "an HDF5 file") from error
    finally:
        access.close()


def read_hdf5(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an HDF5 file, whose datasets' names tell what they are: `bfrt.formats.arrays`.

    Raises
    ------
    SceneError
        If it is no HDF5, or its datasets make no scene.
    SettingError
        If a setting does not fit them, or h5py is missing.
    StreamError
        If the system refuses to read it.
    """
    try:
        import h5py
    except ImportError:
        raise SettingError(f"{path}: HDF5 needs h5py: install bfrt[hdf5]") from None
    with Source(path) as source:
        with _opened(source, h5py) as file:
            openers: dict[str, Any] = {}

            def keep(given: str | bytes, thing: Any) -> None:
                name = os.fsdecode(given)  # bytes where it is no UTF-8
                if isinstance(thing, h5py.Dataset) and thing.shape:
                    openers[name] = partial(Dataset, source, name, thing)

            try:
                file.visititems(keep)
            except Exception as error:
                raise source.failure(error, "datasets") from error
            outlet = Outlet(sink, path, reading)
            write_arrays(path, Lazy(openers), outlet)
            outlet.report()
        if report is not None:
            report(source.size)
