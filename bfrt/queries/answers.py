"""Answers in the order of their rays: sorted, by parts if memory does not hold all."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.records import plain
from bfrt.store.store import HEADER
from bfrt.streams.atomic_write import atomic_path, refused
from bfrt.streams.bucket_sort import buckets_of, gathered
from bfrt.streams.spool import Spool

#: Rows of an answer that are put together at once.
ROWS = 65536

#: Where answers go: arrays by their keys, or the folder of .npy files that is made.
Out = Mapping[str, NDArray[Any]] | str | os.PathLike[str]


def ordered(records: Spool, rays: int, room: int) -> Iterator[NDArray[Any]]:
    """Yield the records of a spool by ascending ray numbers, which are in [0, rays).

    Records have a ``number``; those that have ``t`` and ``key`` are sorted by these then. No more
    than `room` of them are in memory at once, unless they are one ray's.
    """
    for part in buckets_of(records, _numbers, 0, rays, room):
        yield _sorted(gathered(part, len(part)))


def _numbers(records: NDArray[Any]) -> NDArray[np.int64]:
    return records["number"].astype(np.int64)


def _sorted(records: NDArray[Any]) -> NDArray[Any]:
    keys = [records["number"]]
    if "key" in (records.dtype.names or ()):
        keys = [records["key"], records["t"], *keys]
    order = np.lexsort(keys)
    if len(keys) > 1 and _tied(keys, order):
        # From far away both hits of a ray on an object may have one t: their order is made up.
        order = np.lexsort([*records["normal"].T, *keys])
    return plain(records)[order].view(records.dtype)


def _tied(keys: list[NDArray[Any]], order: NDArray[np.int64]) -> bool:
    """Tell whether any records have the same keys, of which `order` sorts them."""
    same = np.ones(max(0, len(order) - 1), np.bool_)
    for key in reversed(keys):
        if not same.any():
            return False
        ascending = key[order]
        same &= ascending[1:] == ascending[:-1]
    return bool(same.any())


def rows(
    records: Iterator[NDArray[Any]], rays: int, missed: NDArray[Any]
) -> Iterator[NDArray[Any]]:
    """Yield one record for each ray, in order: its own, or `missed`, (1,), where it has none."""
    done = 0
    for some in records:
        numbers = some["number"].astype(np.int64)
        end = int(numbers[-1]) + 1
        for first in range(done, end, ROWS):
            last = min(end, first + ROWS)
            block = np.repeat(missed, last - first)
            a, b = np.searchsorted(numbers, [first, last])
            plain(block)[numbers[a:b] - first] = plain(some[a:b])
            yield block
        done = end
    for first in range(done, rays, ROWS):
        yield np.repeat(missed, min(rays - first, ROWS))


def split_ends(numbers: NDArray[np.int64], first: int, last: int) -> Iterator[NDArray[np.int64]]:
    """Yield where the hits of each ray in [first, last) end; ray numbers ascend."""
    for begin in range(first, last, ROWS):
        rays = np.arange(begin, min(last, begin + ROWS))
        yield np.searchsorted(numbers, rays, "right")


#: Of each key of an answer its dtype and the shape of a row.
Fields = Mapping[str, tuple[Any, tuple[int, ...]]]


def check_out(fields: Fields, count: int | None, out: Out | None) -> None:
    """Refuse what an answer of `count` rows, where that is known, cannot be put into.

    Raises
    ------
    SettingError
        For arrays of another shape or dtype, arrays that are read-only, and for a folder that is a
        file, or a store or a part of one.
    """
    if isinstance(out, (str, os.PathLike)):
        check_folder(Path(os.fsdecode(out)))
    elif isinstance(out, Mapping):
        _check_arrays(fields, count, out)
    elif out is not None:
        raise SettingError(f"out: found {type(out).__name__}, expected arrays by key or a folder")


def check_folder(folder: Path) -> None:
    """Refuse a folder for answers that is a file, or a store or in one.

    Raises
    ------
    SettingError
        If it is.
    """
    if folder.exists() and not folder.is_dir():
        raise SettingError(f"out: found the file {folder}, expected a folder")
    for each in (folder, *folder.absolute().parents):
        if (each / HEADER).exists():
            raise SettingError(f"out: found {folder}, which is in a store, expected another folder")


def _check_arrays(fields: Fields, count: int | None, out: Mapping[str, NDArray[Any]]) -> None:
    for key, array in out.items():
        if key not in fields:
            raise SettingError(f"out: found {key!r}, expected some of {', '.join(fields)}")
        dtype, shape = fields[key]
        if not isinstance(array, np.ndarray) or not array.flags.writeable:
            kind = "read-only" if isinstance(array, np.ndarray) else type(array).__name__
            raise SettingError(f"out: found {key} that is {kind}, expected an array to fill")
        expected = (len(array) if count is None else count, *shape)
        if array.shape != expected or array.dtype != np.dtype(dtype):
            raise SettingError(
                f"out: found {key} of {array.dtype} and shape {array.shape}, "
                f"expected {np.dtype(dtype)} of shape {expected}"
            )


class Columns:
    """Fills the arrays of an answer row by row: new ones, the caller's, or files.

    Parameters
    ----------
    fields : mapping
        The dtype and the shape of a row, for each key.
    out : mapping or path-like, optional
        Arrays to fill, some of the keys or all; or a folder, which gets a file ``KEY.npy`` each,
        that is whole or not there.
    """

    def __init__(self, fields: Fields, count: int, out: Out | None) -> None:
        check_out(fields, count, out)
        self._shapes = {key: ((count, *shape), dtype) for key, (dtype, shape) in fields.items()}
        self._folder = Path(os.fsdecode(out)) if isinstance(out, (str, os.PathLike)) else None
        self._files: dict[str, BinaryIO] = {}
        self._stack = ExitStack()
        self._done = 0
        given = out if isinstance(out, Mapping) else {}
        self._arrays = dict(given)
        if self._folder is None:
            for key, (shape, dtype) in self._shapes.items():
                if key not in given:
                    self._arrays[key] = np.empty(shape, dtype)

    def __enter__(self) -> Columns:
        if self._folder is not None:
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise refused(self._folder, 0, error, "creating") from error
            for key, (shape, dtype) in self._shapes.items():
                path = self._stack.enter_context(atomic_path(self._folder / f"{key}.npy"))
                file = self._stack.enter_context(path.open("wb"))
                descr = npy.dtype_to_descr(np.dtype(dtype))
                header = {"descr": descr, "fortran_order": False, "shape": shape}
                npy.write_array_header_1_0(file, header)
                self._files[key] = file
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def room(self, n: int) -> dict[str, NDArray[Any]]:
        """Return arrays to fill with the next n rows, and to put: mostly the answer's own."""
        made: dict[str, NDArray[Any]] = {}
        for key, (shape, dtype) in self._shapes.items():
            if key in self._arrays and self._arrays[key].flags.c_contiguous:
                made[key] = self._arrays[key][self._done : self._done + n]
            else:
                made[key] = np.empty((n, *shape[1:]), dtype)
        return made

    def put(self, block: Mapping[str, NDArray[Any]]) -> None:
        """Take the next rows."""
        n = len(next(iter(block.values())))
        for key, values in block.items():
            if key in self._files:
                dtype = self._shapes[key][1]
                try:
                    self._files[key].write(np.ascontiguousarray(values, dtype).tobytes())
                except OSError as error:
                    assert self._folder is not None
                    raise refused(self._folder / f"{key}.npy", 0, error, "writing") from error
            elif not np.may_share_memory(self._arrays[key], values):
                self._arrays[key][self._done : self._done + n] = values
        self._done += n

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays filled; files are mapped."""
        if self._folder is None:
            return self._arrays
        return {key: np.load(self._folder / f"{key}.npy", mmap_mode="r") for key in self._shapes}
