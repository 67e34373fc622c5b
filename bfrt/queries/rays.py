"""Rays as they are given: arrays, memory maps, .npy files or blocks; as a queue of records."""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.checkpoint.state import Facts
from bfrt.errors import SceneError, SettingError, StreamError
from bfrt.formats.npy import NpyArray
from bfrt.formats.source import Source
from bfrt.formats.table import Rows
from bfrt.masks import is_masked
from bfrt.paths import path_of
from bfrt.queries._rays import RayRecords
from bfrt.records import HIT, QUERY_RAY, RayKind
from bfrt.store.store import Store

#: Rays that are taken from an array at once.
RAYS_AT_ONCE = 65536

#: What the system says of a path where there is no file for us.
ABSENT = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EACCES)

Block = tuple[NDArray[Any], NDArray[Any], NDArray[np.float64], NDArray[np.float64]]

#: What rays may be given as.
Given = ArrayLike | str | os.PathLike[str] | Iterable[tuple[ArrayLike, ArrayLike]]


class Rays(NamedTuple):
    """Holds the rays of a query, as they are given.

    Attributes
    ----------
    blocks : iterator of Block
    known : int, optional
        Number of rays, where it is known.
    """

    blocks: Iterator[Block]
    known: int | None


class RayQueue:
    """Queues the rays of a query, and makes them into records as they are taken.

    Parameters
    ----------
    checked : bool
        Whether their checksums are taken too: of origins, directions, and each end.

    Attributes
    ----------
    taken : int
        Rays taken so far.
    """

    def __init__(
        self, store: Store, blocks: Iterator[Block], kind: RayKind, *, checked: bool = False
    ) -> None:
        empty = store.bounds.empty
        bounds = np.zeros((2, 3)) if empty else np.stack([store.bounds.lo, store.bounds.hi])
        self._records = RayRecords(store.origin, bounds, kind)
        self._blocks = blocks
        self._at = 0
        self._block: Block | None = None
        self._bad: list[int] = []
        self._checked = checked
        self._checks = [0] * 4
        self.taken = 0
        self._next()

    @property
    def bad(self) -> int:
        """Return the number of rays so far that are NaN, infinite or of no length."""
        return sum(self._bad)

    def _next(self) -> None:
        """Come to the next block that has rays."""
        self._at = 0
        self._block = next((block for block in self._blocks if len(block[0])), None)

    def __len__(self) -> int:
        """Return the waiting rays of the current block: 0 when there are no more at all."""
        return 0 if self._block is None else len(self._block[0]) - self._at

    def read(self, most: int) -> NDArray[Any]:
        """Return the next rays, (n,) of records.HIT with n <= most, with paths of QUERY_RAY."""
        first = self.taken
        block = self.take(most)
        return self.records(block, 0, len(block[0]), first).view(HIT)

    def go_on(self, folder: Path, saved: Facts) -> None:
        """Go on behind the rays that were taken before, which must be the same.

        Parameters
        ----------
        folder : Path
            The checkpoint's, for an error.
        saved : dict
            What `facts` returned.

        Raises
        ------
        SettingError
            If they are not.
        """
        taken = saved["taken"]
        while self.taken < taken and len(self):
            self.take(min(RAYS_AT_ONCE, taken - self.taken))
        if self.taken < taken:
            raise SettingError(
                f"checkpoint: {folder}: found {self.taken} rays, expected the {taken} or more that "
                "the work was begun with"
            )
        if self._checks != saved["checksums"]:
            raise SettingError(
                f"checkpoint: {folder}: found other rays among the first {taken} than the work was "
                "begun with, expected the same: go on as it was begun, or name another folder"
            )
        self._bad.append(saved["bad"])

    def facts(self) -> Facts:
        """Return how many rays were taken, of which so many were bad, and their checksums."""
        return {"taken": self.taken, "bad": self.bad, "checksums": [*self._checks]}

    def take(self, most: int) -> Block:
        """Return the next rays as they are given, `most` at the most."""
        n = min(most, len(self))
        if self._block is None:
            none = np.empty(0)
            return none.reshape(0, 3), none.reshape(0, 3), none, none
        o, d, near, far = self._block
        part = slice(self._at, self._at + n)
        self._at += n
        self.taken += n
        if self._at == len(o):
            self._next()
        taken = o[part], d[part], near[part], far[part]
        if self._checked:
            for k, given in enumerate(taken):
                self._checks[k] = zlib.crc32(np.ascontiguousarray(given).data, self._checks[k])
        return taken

    def records(self, block: Block, first: int, last: int, number: int) -> NDArray[Any]:
        """Make rays [first, last) of a block into records.QUERY_RAY; any thread may.

        Parameters
        ----------
        number : int
            Of the first.
        """
        out = np.empty(last - first, QUERY_RAY)
        o, d, near, far = [np.ascontiguousarray(c[first:last], np.float64) for c in block]
        bad = self._records.fill(o, d, near, far, number, out)
        if bad:
            self._bad.append(bad)
        return out


def rays_of(origins: Given, directions: Given | None, t_min: ArrayLike, t_max: ArrayLike) -> Rays:
    """Return the rays that are given, as `bfrt.cast_rays` takes them.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes.
    """
    if directions is None:
        return Rays(_given_blocks(origins, t_min, t_max), None)
    o, d = _rows("origins", origins), _rows("directions", directions)
    if o.shape != d.shape:
        raise SettingError(
            f"rays: found origins {o.shape} and directions {d.shape}, expected one shape (n, 3)"
        )
    count = o.shape[0]
    near, far = _column("t_min", t_min, count), _column("t_max", t_max, count)

    def blocks() -> Iterator[Block]:
        for number, rays in enumerate(
            zip(o.blocks(RAYS_AT_ONCE), d.blocks(RAYS_AT_ONCE), strict=True)
        ):
            part = slice(number * RAYS_AT_ONCE, (number + 1) * RAYS_AT_ONCE)
            yield *rays, near[part], far[part]

    return Rays(blocks(), count)


class Held:
    """Presents a caller's array, in memory or mapped, as rows to be read."""

    def __init__(self, name: str, given: ArrayLike) -> None:
        self.name = name
        self._array = _array(name, given, "(n, 3)")
        self.shape, self.dtype = self._array.shape, self._array.dtype

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        for first in range(0, len(self._array), rows):
            yield self._array[first : first + rows]


def _given_blocks(given: Any, t_min: ArrayLike, t_max: ArrayLike) -> Iterator[Block]:
    if isinstance(given, (np.ndarray, str, os.PathLike)) or not isinstance(given, Iterable):
        raise SettingError("directions: found none, expected them, or blocks in place of origins")
    if _array("t_min", t_min, "a number").ndim or _array("t_max", t_max, "a number").ndim:
        raise SettingError("rays: found blocks with an array of t, expected one t_min and t_max")
    for block in given:
        try:
            o, d = block
        except (TypeError, ValueError):
            raise SettingError("rays: found a block, expected origins and directions") from None
        yield from rays_of(o, d, t_min, t_max).blocks


def _rows(name: str, given: Any) -> Rows:
    """Return rows (n, 3) of float32, float64 or whole numbers; a file's are read on demand."""
    file = isinstance(given, (str, os.PathLike))
    array: Rows = _stored(name, str(path_of(name, given))) if file else Held(name, given)
    floats = array.dtype.newbyteorder("=") in (np.float32, np.float64)
    numbers = floats or array.dtype.kind in "iu"
    if len(array.shape) != 2 or array.shape[1] != 3 or not numbers:
        raise SettingError(
            f"{array.name}: found {array.dtype} of shape {array.shape}, "
            "expected float32 or float64 of shape (n, 3)"
        )
    return array


def _array(name: str, given: ArrayLike, expected: str) -> NDArray[Any]:
    """Return anything that NumPy takes for an array as one, unless elements of it are masked."""
    if is_masked(given):
        raise SettingError(f"{name}: found masked elements, expected numbers")
    try:
        return np.asarray(given)
    except (TypeError, ValueError):
        raise SettingError(f"{name}: found rows of several lengths, expected {expected}") from None


def _stored(name: str, path: str) -> NpyArray:
    """Open an .npy file's array, whose blocks are read forwards."""
    try:
        return NpyArray(path, partial(Source, path))
    except SceneError as error:
        raise SettingError(f"{error}, for {name}") from None
    except StreamError as error:
        if error.errno not in ABSENT:
            raise
        said = os.strerror(error.errno)
        raise SettingError(f"{path}: expected an .npy file of {name}: {said}") from None


def _column(name: str, given: ArrayLike, n: int) -> NDArray[np.float64]:
    array = _array(name, given, f"a number or ({n},)")
    if array.dtype.kind not in "fiu" or array.shape not in ((), (n,)):
        raise SettingError(
            f"{name}: found {array.dtype} of shape {array.shape}, expected a number or ({n},)"
        )
    return np.broadcast_to(array, (n,))
