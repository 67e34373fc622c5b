"""Rays as dask arrays: of the shapes and dtypes that rays have, in the same blocks."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from bfrt.cluster.engine import dask_array, is_lazy
from bfrt.errors import SettingError


class LazyRays(NamedTuple):
    """Holds the rays of a query in blocks.

    Attributes
    ----------
    origins, directions : dask arrays, (n, 3)
        One block has whole rows.
    t_min, t_max : float, or dask arrays, (n,)
        In the same blocks.
    """

    origins: Any
    directions: Any
    t_min: Any
    t_max: Any

    @property
    def chunks(self) -> tuple[float, ...]:
        """Return the number of rays in each block; NaN where Dask does not know it."""
        chunks: tuple[float, ...] = self.origins.chunks[0]
        return chunks

    def firsts(self) -> Any:
        """Return the number of each block's first ray, a dask array of a number a block.

        Raises
        ------
        SettingError
            If Dask does not know how many rays the blocks have.
        """
        if any(map(math.isnan, self.chunks)):
            raise SettingError(
                "origins: found blocks of unknown size, expected known ones, as "
                "origins.compute_chunk_sizes() makes them: rays are numbered through all blocks"
            )
        firsts = np.cumsum([0, *self.chunks[:-1]]).astype(np.int64)
        return dask_array().from_array(firsts, chunks=1)


def lazy_rays(origins: Any, directions: Any, t_min: Any, t_max: Any) -> LazyRays:
    """Return rays of which some are dask arrays, all in the blocks of the first that is one.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes than rays have.
    """
    if directions is None:
        raise SettingError("directions: found none, expected an array, as origins is one")
    given = origins, directions, t_min, t_max
    chunks = next((each.chunks[0] for each in given if is_lazy(each) and each.ndim), ())
    o, d = _rows("origins", origins, chunks), _rows("directions", directions, chunks)
    if not _same(o.shape, d.shape):
        raise SettingError(
            f"rays: found origins {o.shape} and directions {d.shape}, expected one shape (n, 3)"
        )
    if o.numblocks != d.numblocks:
        raise SettingError(
            f"rays: found origins in {o.numblocks[0]} blocks and directions in {d.numblocks[0]}, "
            "some of unknown size, expected the same blocks, as compute_chunk_sizes() allows"
        )
    n = o.shape[0]
    return LazyRays(o, d, _column("t_min", t_min, n, chunks), _column("t_max", t_max, n, chunks))


def _rows(name: str, given: Any, chunks: tuple[float, ...]) -> Any:
    array = _blocks(name, given, (chunks, 3))
    dtype = array.dtype
    floats = dtype.newbyteorder("=") in (np.float32, np.float64)
    if array.ndim != 2 or array.shape[1] != 3 or not (floats or dtype.kind in "iu"):
        raise SettingError(
            f"{name}: found {dtype} of shape {array.shape}, expected float32 or float64 of shape "
            "(n, 3)"
        )
    return _in_blocks(array, {0: chunks, 1: 3})


def _column(name: str, given: Any, n: float, chunks: tuple[float, ...]) -> Any:
    if not is_lazy(given) and np.ndim(given) == 0:
        number = np.asarray(given)
        if number.dtype.kind in "fiu":
            return float(number)
        raise SettingError(f"{name}: found {given!r:.80}, expected a number or (n,)")
    array = _blocks(name, given, (chunks,))
    if array.dtype.kind in "fiu" and array.ndim == 1 and _same(array.shape, (n,)):
        array = _in_blocks(array, {0: chunks})
        if array.numblocks == (len(chunks),):
            return array
    raise SettingError(
        f"{name}: found {array.dtype} of shape {array.shape}, expected a number or ({n},) in the "
        "blocks of the rays"
    )


def _blocks(name: str, given: Any, chunks: Any) -> Any:
    """Return a dask array of what may be an array of NumPy's."""
    if is_lazy(given):
        return given
    if chunks[0] == ():
        raise SettingError("rays: found a dask array of no axis, expected (n,) or (n, 3)")
    if not isinstance(given, np.ndarray):
        raise SettingError(
            f"{name}: found {type(given).__name__} with dask arrays, expected an array"
        )
    known = given.ndim == len(chunks) and sum(chunks[0]) == len(given)
    return dask_array().from_array(given, chunks=chunks if known else "auto")


def _in_blocks(array: Any, chunks: dict[int, Any]) -> Any:
    """Return an array in other blocks, where Dask knows how large they are."""
    if any(math.isnan(rows) for rows in (*array.chunks[0], *chunks[0])):
        return array
    if sum(array.chunks[0]) != sum(chunks[0]):
        return array
    return array.rechunk(chunks)


def _same(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Tell whether shapes are the same, as far as Dask knows them."""
    return len(one) == len(other) and all(
        a == b or math.isnan(a) or math.isnan(b) for a, b in zip(one, other, strict=True)
    )
