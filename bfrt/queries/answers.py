"""Answers in the order of their rays: sorted, by parts if memory does not hold all."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.masks import is_masked
from bfrt.paths import check_folder
from bfrt.queries.answer_files import answer_paths
from bfrt.queries.given import Lead
from bfrt.records import plain
from bfrt.refusals import calling, closing
from bfrt.streams.atomic_write import put
from bfrt.streams.bucket_sort import Numbers, buckets_of, gathered
from bfrt.streams.spool import Spool
from bfrt.streams.writer import view_of

#: Rows of an answer that are put together at once.
ROWS = 65536

#: Where answers go: arrays by their keys, or the folder of .npy files that is made.
Out = Mapping[str, NDArray[Any]] | str | os.PathLike[str]

#: What hits of one ray are parted by where memory does not hold them.
HALVES = (("t", True), ("t", False), ("key", True), ("key", False))


class Order(NamedTuple):
    """Says by which numbers records are parted, which are in [first, last)."""

    numbers: Numbers
    first: int
    last: int


def ordered(records: Spool, rays: int, room: int) -> Iterator[NDArray[Any]]:
    """Yield the records of a spool by ascending ray numbers, which are in [0, rays).

    Records have a ``number``; those that have ``t`` and ``key`` are sorted by these then. No more
    than `room` of them are in memory at once, unless all these are the same.
    """
    orders = [Order(_numbers, 0, rays)]
    if "key" in (records.dtype.names or ()):
        orders += [Order(partial(halves, name, high), 0, 1 << 32) for name, high in HALVES]
    for part in _parts(records, orders, room):
        yield _sorted(gathered(part, len(part)))


def _parts(records: Spool, orders: Sequence[Order], room: int) -> Iterator[Spool]:
    """Yield the records of a spool in parts that ascend by the first order, then by the others."""
    (numbers, first, last), *finer = orders
    for part in buckets_of(records, numbers, first, last, room):
        if len(part) > room and finer:  # all of one number
            yield from _parts(part, finer, room)
        else:
            yield part


def halves(name: str, high: bool, records: NDArray[Any]) -> NDArray[np.int64]:
    """Return one half of a field's 64 bits, for integers that ascend as its values do.

    Parameters
    ----------
    name : str
        ``key``, uint64, or ``t``, float64 but NaN.
    high : bool
        Whether it is the high half.
    """
    if name == "t":
        values = (records["t"] + 0.0).view(np.int64)  # -0 and 0 are one number
        bits = np.where(values < 0, ~values, values ^ np.int64(-1 << 63)).view(np.uint64)
    else:
        bits = records[name]
    half = bits >> np.uint64(32) if high else bits & np.uint64((1 << 32) - 1)
    return half.astype(np.int64)


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


def sums(records: Iterator[NDArray[Any]], points: int) -> Iterator[NDArray[np.int64]]:
    """Yield the sums of the ``count`` of records with the same ``number``, for each of the points.

    Numbers ascend, and those of one number come together.
    """
    done = 0
    for some in records:
        numbers = some["number"].astype(np.int64)
        end = int(numbers[-1]) + 1
        for first in range(done, end, ROWS):
            last = min(end, first + ROWS)
            a, b = np.searchsorted(numbers, [first, last])
            own = np.bincount(numbers[a:b] - first, some["count"][a:b], last - first)
            yield own.astype(np.int64)
        done = end
    for first in range(done, points, ROWS):
        yield np.zeros(min(points - first, ROWS), np.int64)


def pieces(blocks: Iterator[NDArray[Any]]) -> Iterator[NDArray[Any]]:
    """Yield blocks again, in pieces of which columns are made at once."""
    for block in blocks:
        for first in range(0, len(block), ROWS):
            yield block[first : first + ROWS]


def split_ends(numbers: NDArray[np.int64], first: int, last: int) -> Iterator[NDArray[np.int64]]:
    """Yield where the hits of each ray in [first, last) end; ray numbers ascend."""
    for begin in range(first, last, ROWS):
        rays = np.arange(begin, min(last, begin + ROWS))
        yield np.searchsorted(numbers, rays, "right")


#: Of each key of an answer its dtype and the shape of a row.
Fields = Mapping[str, tuple[Any, tuple[int, ...]]]


def check_out(fields: Fields, lead: Lead | None, out: Out | None) -> None:
    """Refuse what an answer of a leading shape, where that is known, cannot be put into.

    Raises
    ------
    SettingError
        For arrays of another shape or dtype, arrays that are read-only, and for a folder that
        `check_folder` refuses.
    """
    if isinstance(out, (str, os.PathLike)):
        check_folder("out", out, map(file_of, fields))
    elif isinstance(out, Mapping):
        _check_arrays(fields, lead, out)
    elif out is not None:
        raise SettingError(f"out: found {type(out).__name__}, expected arrays by key or a folder")


def file_of(key: str) -> str:
    """Return the name of the file that an array goes to."""
    return f"{key}.npy"


def _check_arrays(fields: Fields, lead: Lead | None, out: Mapping[str, NDArray[Any]]) -> None:
    for key, array in out.items():
        if key not in fields:
            raise SettingError(f"out: found {key!r}, expected some of {', '.join(fields)}")
        dtype, shape = fields[key]
        if not isinstance(array, np.ndarray) or not array.flags.writeable or is_masked(array):
            kind = "read-only" if isinstance(array, np.ndarray) else type(array).__name__
            kind = "masked" if is_masked(array) else kind
            raise SettingError(f"out: found {key} that is {kind}, expected an array to fill")
        expected = (*(array.shape[:1] if lead is None else lead), *shape)
        if array.shape != expected or array.dtype != np.dtype(dtype):
            raise SettingError(
                f"out: found {key} of {array.dtype} and shape {array.shape}, "
                f"expected {np.dtype(dtype)} of shape {expected}"
            )


class Shape(NamedTuple):
    """Tells the shape of an array: its rows, in C's order, are those of its leading axes.

    Attributes
    ----------
    lead, row : tuple of int
        Of the rows, and of each.
    dtype
    """

    lead: Lead
    row: tuple[int, ...]
    dtype: Any

    @property
    def whole(self) -> tuple[int, ...]:
        """Return the shape of the array."""
        return (*self.lead, *self.row)


#: Of each key of an answer the shape of its array.
Shapes = dict[str, Shape]


def shapes_of(fields: Fields, lead: Lead) -> Shapes:
    """Return the shapes of the arrays of an answer of a leading shape."""
    return {key: Shape(lead, row, dtype) for key, (dtype, row) in fields.items()}


class Columns:
    """Fills the arrays of an answer row by row: new ones, the caller's, or files.

    Parameters
    ----------
    shapes : Shapes
        The arrays.
    out : mapping or path-like, optional
        Arrays to fill, some of the keys or all; or a folder, which gets a file ``KEY.npy`` each.
        All of them are whole, or none is there.
    """

    def __init__(self, shapes: Shapes, out: Out | None) -> None:
        self._shapes = shapes
        self._folder = Path(os.fsdecode(out)) if isinstance(out, (str, os.PathLike)) else None
        self._files: dict[str, FileIO] = {}
        self._stack = ExitStack()
        self._done = dict.fromkeys(shapes, 0)
        given = out if isinstance(out, Mapping) else {}
        self._arrays = dict(given)
        if self._folder is None:
            for key, shape in self._shapes.items():
                if key not in given:
                    self._arrays[key] = np.empty(shape.whole, shape.dtype)

    def __enter__(self) -> Columns:
        if self._folder is not None:
            with ExitStack() as stack:
                self._open(self._folder, stack)
                self._stack = stack.pop_all()
        return self

    def _open(self, folder: Path, stack: ExitStack) -> None:
        """Create the files, aside."""
        names = [file_of(key) for key in self._shapes]
        paths = stack.enter_context(answer_paths(folder, names))
        for path, (key, shape) in zip(paths, self._shapes.items(), strict=True):
            with calling(folder / path.name, "creating"):
                made = path.open("wb", buffering=0)
            file = stack.enter_context(closing(made, folder / file_of(key)))
            descr = npy.dtype_to_descr(np.dtype(shape.dtype))
            head = BytesIO()
            npy.write_array_header_1_0(
                head, {"descr": descr, "fortran_order": False, "shape": shape.whole}
            )
            put(file, head.getvalue(), folder / file_of(key))
            self._files[key] = file

    def __exit__(self, *error: Any) -> None:
        self._stack.__exit__(*error)

    def room(self, n: int) -> dict[str, NDArray[Any]]:
        """Return arrays to fill with the next n rows, and to put: mostly the answer's own."""
        made: dict[str, NDArray[Any]] = {}
        for key, shape in self._shapes.items():
            if key in self._arrays and self._arrays[key].flags.c_contiguous:
                first = self._done[key]
                made[key] = self._arrays[key].reshape(-1, *shape.row)[first : first + n]
            else:
                made[key] = np.empty((n, *shape.row), shape.dtype)
        return made

    def put(self, block: Mapping[str, NDArray[Any]]) -> None:
        """Take the next rows of some of the arrays."""
        for key, values in block.items():
            if key in self._files:
                assert self._folder is not None
                data = np.ascontiguousarray(values, self._shapes[key].dtype)
                put(self._files[key], view_of(data), self._folder / file_of(key))
            else:
                first = self._done[key]
                self._done[key] = first + len(values)
                if not np.may_share_memory(self._arrays[key], values):
                    self._fill(key, slice(first, self._done[key]), values)

    def _fill(self, key: str, rows: slice, values: NDArray[Any]) -> None:
        """Copy rows into an array, which may have gaps."""
        array, shape = self._arrays[key], self._shapes[key]
        if len(shape.lead) == 1:
            array[rows] = values
        else:
            each = math.prod(shape.row)
            array.flat[each * rows.start : each * rows.stop] = values.reshape(-1)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays filled; files are mapped."""
        if self._folder is None:
            return self._arrays
        found = {}
        for key in self._shapes:
            with calling(self._folder / file_of(key), "mapping"):
                found[key] = np.load(self._folder / file_of(key), mmap_mode="r")
        return found
