"""Arrays with names, as files keep them, and other arrays made of what they have.

::

    records (n,) of x y z m        Column "x", "m"            a column of each
    x (n,), y (n,), z (n,)         Abreast                    (n, 3)
    (h, w, 3), (frames, n, 3)      Array.shallow              (h w, 3), (n, 3)
    (frames, n, 3)                 Array.frame                (n, 3)
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import BfrtError, SceneError, SettingError
from bfrt.formats.source import printable

#: Arrays that an error lists, and characters that it shows of a name and of a type.
LISTED = 8
NAME_SHOWN = 60
TYPE_SHOWN = 24

#: Characters of such a list.
LIST_SHOWN = 300


class Rows(Protocol):
    """Provides rows that can be read again and again."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time, the last fewer."""
        ...


class Array(Rows, Protocol):
    """Provides an array that a file contains."""

    def shallow(self) -> Array:
        """Return the array with one dimension less; each format decides what that means."""
        ...

    def frame(self, number: int) -> Array:
        """Return a frame of (frames, n, ...), from 0, or from -1 back, as (n, ...)."""
        ...


Arrays = Mapping[str, Array]


class Listed(Mapping[str, Array]):
    """Maps names to arrays, of which those of some names are listed.

    What opens an array is left to others, which may know more names than they list.

    Parameters
    ----------
    names : collection of str
    """

    def __init__(self, names: Collection[str]) -> None:
        self._names = names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names


class Lazy(Listed):
    """Maps names to arrays and opens each on demand: an array that nobody needs may be anything."""

    def __init__(self, openers: Mapping[str, Callable[[], Array]]) -> None:
        super().__init__(openers)
        self._openers = openers

    def __getitem__(self, name: str) -> Array:
        return self._openers[name]()


Path = tuple[str, ...]


class Column:
    """Presents a column of records as an array: one of their fields, or several side by side.

    Parameters
    ----------
    array : Array
        An array of records.
    paths : tuple of tuple of str
        The names that lead to each field, more than one where records are in records.
    """

    def __init__(self, array: Array, *paths: Path) -> None:
        self.name = f"{array.name}: {printable(' '.join('/'.join(path) for path in paths))}"
        self.array = array
        self.paths = paths
        types = [type_at(array.dtype, path) for path in paths]
        self.dtype = np.result_type(*(each.base for each in types)) if paths[1:] else types[0].base
        beside = (len(paths),) if paths[1:] else types[0].shape
        self.shape = (*array.shape, *beside)

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        for block in self.array.blocks(rows):
            if self.paths[1:]:
                yield np.stack([inside(block, path) for path in self.paths], axis=-1)
            else:
                yield np.ascontiguousarray(inside(block, self.paths[0]))

    def shallow(self) -> Array:
        """Return the column of the array with one dimension less."""
        return Column(self.array.shallow(), *self.paths)

    def frame(self, number: int) -> Array:
        """Return the column of one frame."""
        return Column(self.array.frame(number), *self.paths)


def type_at(dtype: np.dtype[Any], path: Path) -> np.dtype[Any]:
    """Return the type of a field."""
    for name in path:
        dtype = dtype[name]
    return dtype


def inside(block: NDArray[Any], path: Path) -> NDArray[Any]:
    """Return a field of records."""
    for name in path:
        block = block[name]
    return block


def paths_of(dtype: np.dtype[Any]) -> list[Path]:
    """List the paths of names that lead to fields without fields of their own, in order."""
    found: list[Path] = []
    left: list[Path] = [(name,) for name in reversed(dtype.names or ())]
    while left:
        path = left.pop()
        within = type_at(dtype, path).names
        if within is None:
            found.append(path)
        else:
            left.extend((*path, name) for name in reversed(within))
    return found


def openers_of(dtype: np.dtype[Any], opened: Callable[[], Array]) -> dict[Path, Any]:
    """Return an opener for each field of an array of records, which itself is opened once."""
    whole = cache(opened)
    return {path: partial(_column, whole, path) for path in paths_of(dtype)}


def _column(whole: Callable[[], Array], path: Path) -> Array:
    return Column(whole(), path)


class Abreast:
    """Presents columns (n,) side by side as one array.

    Raises
    ------
    SceneError
        If they are not as long as the first, or no columns of numbers.
    """

    def __init__(self, columns: list[Array]) -> None:
        for column in columns:
            if column.shape != columns[0].shape[:1] or column.dtype.kind not in "fiub":
                raise wrong(column, f"numbers of shape ({columns[0].shape[0]},)")
        self.name = columns[0].name
        self.dtype = np.result_type(*(column.dtype for column in columns))
        self.shape: tuple[int, ...] = (columns[0].shape[0], len(columns))
        self._columns = columns

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        for parts in zip(*(column.blocks(rows) for column in self._columns), strict=True):
            yield np.stack(parts, axis=-1)


def frame_of(number: int, frames: int, name: str) -> int:
    """Return the place, from 0, of a frame that may be counted from the end.

    Raises
    ------
    SceneError
        If there are no frames.
    SettingError
        If there are fewer.
    """
    if not frames:
        raise SceneError(f"{name}: found no frames, expected one or more")
    if not -frames <= number < frames:
        raise SettingError(
            f"{name}: found frame={number}, expected one of {frames}, 0 to {frames - 1} or "
            f"{-frames} to -1"
        )
    return number % frames


def abreast(columns: list[Array]) -> Rows:
    """Join columns (n,) to one array; fields of one array's records are read together."""
    whole = columns[0].array if isinstance(columns[0], Column) else None
    paths: list[Path] = []
    for column in columns:
        if isinstance(column, Column) and column.array is whole and column.shape == whole.shape:
            paths += column.paths
    numbers = all(column.dtype.kind in "fiub" for column in columns)
    if whole is not None and len(paths) == len(columns) and numbers:
        return Column(whole, *paths)
    return Abreast(columns)


def level(array: Array, dimensions: int) -> Array:
    """Return the array with `dimensions` dimensions, where it has one more."""
    return array.shallow() if len(array.shape) == dimensions + 1 else array


def floats(array: Rows) -> np.dtype[Any]:
    """Return float32 if it holds the numbers exactly, else float64."""
    if array.dtype.kind not in "fiub" or array.dtype.itemsize > 8:
        raise wrong(array, "numbers of 64 bits or fewer")
    return np.dtype("f4") if np.can_cast(array.dtype, np.float32) else np.dtype("f8")


def wrong(array: Rows, expected: str, kind: type[BfrtError] = SceneError) -> BfrtError:
    """Return an error about an array of a wrong shape or type."""
    dtype = printable(str(array.dtype))
    return kind(f"{array.name}: found {dtype} of shape {array.shape}, expected {expected}")


def listed(arrays: Arrays, keys: Iterable[str] | None = None) -> str:
    """List some arrays, or all, for an error: the first few names, shapes and types."""
    keys = list(arrays if keys is None else keys)
    shown: list[str] = []
    for key in keys[:LISTED]:
        shown.append(described(arrays, key))
        if sum(map(len, shown)) > LIST_SHOWN:
            break
    return ", ".join([*shown, "..."] if len(shown) < len(keys) else shown) or "no arrays"


def described(arrays: Arrays, key: str) -> str:
    """Describe an array by name, shape and type, or by name alone if it cannot be opened."""
    name = clipped(key, NAME_SHOWN)
    try:
        array = arrays[key]
    except BfrtError:
        return name
    return f"{name} {array.shape} {clipped(str(array.dtype), TYPE_SHOWN)}"


def clipped(text: str, most: int) -> str:
    """Return a text for an error, cut to `most` characters."""
    shown = printable(text)
    return shown if len(shown) <= most else f"{shown[:most]}..."
