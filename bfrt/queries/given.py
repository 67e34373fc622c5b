"""Rays and points as people have them: arrays of any leading shape, .npy files, lists, blocks.

::

    (n, 3)  (h, w, 3)  (3,)     origins and directions, one shape but for what is repeated
    (n, 6)  (h, w, 6)  (6,)     both in one, as Open3D has them
    blocks of either            one after another
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError, SettingError, StreamError
from bfrt.formats.npy_array import NpyArray
from bfrt.formats.source import Source
from bfrt.masks import is_masked
from bfrt.paths import path_of

#: Rays that are taken from an array at once.
RAYS_AT_ONCE = 65536

#: What the system says of a path where there is no file for us.
ABSENT = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES)

#: The numbers of a ray in one row.
SIX = 6

Block = tuple[NDArray[Any], NDArray[Any], NDArray[np.float64], NDArray[np.float64]]

#: What rays may be given as.
Given = ArrayLike | str | os.PathLike[str] | Iterable[tuple[ArrayLike, ArrayLike] | ArrayLike]

#: What points may be given as.
Points = ArrayLike | str | os.PathLike[str]

#: The shape of what there is one of for each ray: () for one ray, (n,), (h, w).
Lead = tuple[int, ...]


class Rays(NamedTuple):
    """Holds the rays of a query, as they are given.

    Attributes
    ----------
    blocks : iterator of Block
    lead : tuple of int, optional
        Their leading shape, where it is known.
    """

    blocks: Iterator[Block]
    lead: Lead | None

    @property
    def known(self) -> int | None:
        """Return the number of rays, where it is known."""
        return None if self.lead is None else math.prod(self.lead)


def rays_of(origins: Given, directions: Given | None, t_min: ArrayLike, t_max: ArrayLike) -> Rays:
    """Return the rays that are given, as `bfrt.cast_rays` takes them.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes.
    """
    if directions is None:
        rows = _rows_of_six(origins)
        if rows is None:
            return Rays(_given_blocks(origins, t_min, t_max), None)
        halves = ((six[:, :3], six[:, 3:]) for six in rows.blocks(RAYS_AT_ONCE))
        return _with_ends(halves, rows.lead, t_min, t_max)
    o, d = rows_of("origins", origins), rows_of("directions", directions)
    try:
        lead = np.broadcast_shapes(o.lead, d.lead)
        o, d = o.spread(lead), d.spread(lead)
    except ValueError:
        raise SettingError(
            f"rays: found origins {(*o.lead, 3)} and directions {(*d.lead, 3)}, expected one shape "
            "(n, 3) or (h, w, 3), or one of them for all"
        ) from None
    pairs = zip(o.blocks(RAYS_AT_ONCE), d.blocks(RAYS_AT_ONCE), strict=True)
    return _with_ends(pairs, lead, t_min, t_max)


def _with_ends(
    pairs: Iterator[tuple[NDArray[Any], NDArray[Any]]],
    lead: Lead,
    t_min: ArrayLike,
    t_max: ArrayLike,
) -> Rays:
    """Return rays of origins and directions, with the ends that are given."""
    near, far = (_column(name, t, lead) for name, t in (("t_min", t_min), ("t_max", t_max)))

    def blocks() -> Iterator[Block]:
        first = 0
        for o, d in pairs:
            last = first + len(o)
            yield o, d, near.part(first, last)[:, 0], far.part(first, last)[:, 0]
            first = last

    return Rays(blocks(), lead)


class Held:
    """Presents a caller's array, in memory or mapped, as rows of the numbers of its last axis.

    Parameters
    ----------
    name : str
    array : ndarray, shape (..., k)
    """

    def __init__(self, name: str, array: NDArray[Any]) -> None:
        self.name = name
        self.shape, self.dtype = array.shape, array.dtype
        self._array = array

    @property
    def lead(self) -> Lead:
        """Return the shape but for the last axis."""
        return self.shape[:-1]

    def spread(self, lead: Lead) -> Held:
        """Return the rows repeated to a leading shape, as NumPy broadcasts them."""
        return Held(self.name, np.broadcast_to(self._array, (*lead, self.shape[-1])))

    def part(self, first: int, last: int) -> NDArray[Any]:
        """Return rows [first, last), in C's order: no more than these are copied."""
        if len(self.lead) == 1:
            return self._array[first:last]
        if self._array.flags.c_contiguous:
            return self._array.reshape(math.prod(self.lead), self.shape[-1])[first:last]
        if not self.lead:
            return self._array[None][first:last]
        return self._array[np.unravel_index(np.arange(first, last), self.lead)]

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time, the last fewer."""
        count = math.prod(self.lead)
        for first in range(0, count, rows):
            yield self.part(first, min(count, first + rows))


class Stored:
    """Presents the array of an .npy file as rows, which are read forwards on demand."""

    def __init__(self, array: NpyArray) -> None:
        self.name, self.shape, self.dtype = array.name, array.shape, array.dtype
        while len(array.shape) > 2:
            array = array.shallow()
        self._array = array

    @property
    def lead(self) -> Lead:
        """Return the shape but for the last axis."""
        return self.shape[:-1]

    def spread(self, lead: Lead) -> Stored:
        """Return the rows, which have that leading shape.

        Raises
        ------
        ValueError
            If they have another: a file is not read again for it.
        """
        if lead != self.lead:
            raise ValueError(lead)
        return self

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time, the last fewer."""
        return self._array.blocks(rows)


def rows_of(name: str, given: Any, width: int = 3) -> Held | Stored:
    """Return rows of float32, float64 or whole numbers, `width` of them; a file's are read later.

    Raises
    ------
    SettingError
        If they are none.
    """
    rows = _opened(name, given, f"(n, {width})")
    if rows.shape[-1:] != (width,) or not has_numbers(rows.dtype):
        raise SettingError(
            f"{rows.name}: found {rows.dtype} of shape {rows.shape}, expected float32 or float64 "
            f"of shape (n, {width}) or (h, w, {width})"
        )
    return rows


def _opened(name: str, given: Any, expected: str) -> Held | Stored:
    if isinstance(given, (str, os.PathLike)):
        return _stored(name, str(path_of(name, given)))
    return Held(name, array_of(name, given, expected))


def has_numbers(dtype: np.dtype[Any]) -> bool:
    """Tell whether rays may have a dtype: float32, float64 or whole numbers, of any byte order."""
    return dtype.newbyteorder("=") in (np.float32, np.float64) or dtype.kind in "iu"


def _rows_of_six(given: Any) -> Held | Stored | None:
    """Return rays of six numbers; None for what can only be blocks.

    Raises
    ------
    SettingError
        For an array or a file whose rows are no rays.
    """
    check_frame("origins", given)
    whole = isinstance(given, (np.ndarray, str, os.PathLike)) or hasattr(given, "__array__")
    if not whole and (not isinstance(given, (list, tuple)) or holds_arrays(given)):
        return None
    try:
        rows = _opened("origins", given, "(n, 3)")
    except SettingError:
        if whole or is_masked(given):
            raise
        return None  # a list of pairs of lists
    if rows.shape[-1:] == (SIX,) and has_numbers(rows.dtype):
        return rows
    if whole:
        raise SettingError(
            f"directions: found none with origins of {rows.dtype} and shape {rows.shape}, expected "
            "them, or rays of shape (n, 6), or blocks in place of origins"
        )
    return None


def holds_arrays(given: list[Any] | tuple[Any, ...]) -> bool:
    """Tell whether a list has arrays of rows, or names of files: then it is a list of blocks."""
    parts = [part for each in given[:1] for part in ([each, *each] if _is_list(each) else [each])]
    return any(
        isinstance(part, (str, os.PathLike)) or getattr(part, "ndim", 0) > 1 for part in parts
    )


def _is_list(given: object) -> bool:
    return isinstance(given, (list, tuple))


def _given_blocks(given: Any, t_min: ArrayLike, t_max: ArrayLike) -> Iterator[Block]:
    """Yield the blocks of blocks, each a pair, or an array or a file of six numbers a ray."""
    if not isinstance(given, Iterable):
        raise SettingError(
            f"origins: found {type(given).__name__}, expected an array, a file or blocks"
        )
    if array_of("t_min", t_min, "a number").ndim or array_of("t_max", t_max, "a number").ndim:
        raise SettingError("rays: found blocks with an array of t, expected one t_min and t_max")
    for block in given:
        check_frame("rays", block)
        try:
            o, d = block if _is_pair(block) else (block, None)
        except (TypeError, ValueError):
            raise SettingError("rays: found a block, expected origins and directions") from None
        yield from rays_of(o, d, t_min, t_max).blocks


def _is_pair(block: Any) -> bool:
    """Tell whether a block is origins and directions, rather than both in one array."""
    if isinstance(block, (str, os.PathLike)):
        return False
    return not (isinstance(block, np.ndarray) and block.shape[-1:] == (SIX,))


def array_of(name: str, given: ArrayLike, expected: str) -> NDArray[Any]:
    """Return anything that NumPy takes for an array as one.

    Raises
    ------
    SettingError
        If NumPy does not, if elements are masked, or for a frame of columns.
    """
    check_frame(name, given)
    if is_masked(given):
        raise SettingError(f"{name}: found masked elements, expected numbers")
    try:
        return np.asarray(given)
    except (TypeError, ValueError) as error:
        if _is_list(given):
            found = "rows of several lengths"
        else:
            found = f"{type(given).__name__}, of which NumPy says {str(error)!r:.200}"
        raise SettingError(f"{name}: found {found}, expected {expected}") from None


def check_frame(name: str, given: object) -> None:
    """Refuse a table of named columns, whose order says nothing: pandas', Polars' or Dask's.

    Raises
    ------
    SettingError
        It says how to convert it.
    """
    if not hasattr(given, "columns") or isinstance(given, np.ndarray):
        return
    module, kind = type(given).__module__.split(".")[0], type(given).__name__
    convert = "to_dask_array(lengths=True)" if hasattr(given, "to_dask_array") else "to_numpy()"
    raise SettingError(
        f"{name}: found a {kind} of {module}, expected an array of its columns, as "
        f"frame[['x', 'y', 'z']].{convert} makes it"
    )


def _stored(name: str, path: str) -> Stored:
    """Open an .npy file's array, whose blocks are read forwards."""
    try:
        array = NpyArray(path, partial(Source, path))
        if len(array.shape) < 2:
            raise SettingError(
                f"{path}: found {array.dtype} of shape {array.shape}, expected float32 or float64 "
                f"of shape (n, 3) or (h, w, 3), for {name}"
            )
        return Stored(array)
    except SceneError as error:
        raise SettingError(f"{error}, for {name}") from None
    except StreamError as error:
        if error.errno not in ABSENT:
            raise
        said = os.strerror(error.errno)
        raise SettingError(f"{path}: expected an .npy file of {name}: {said}") from None


def _column(name: str, given: ArrayLike, lead: Lead) -> Held:
    """Return a number for each ray, in rows of one."""
    expected = f"a number or {lead}"
    array = array_of(name, given, expected)
    if array.dtype.kind not in "fiu" or array.shape not in ((), lead):
        raise SettingError(
            f"{name}: found {array.dtype} of shape {array.shape}, expected {expected}"
        )
    return Held(name, np.broadcast_to(array, lead)[..., None])
