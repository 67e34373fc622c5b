"""Rays as dask arrays: of the shapes and dtypes that rays have, in the same blocks."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.cluster.engine import dask_array, is_lazy
from bfrt.errors import SettingError
from bfrt.queries.given import SIX, check_frame, has_numbers


class LazyRays(NamedTuple):
    """Holds the rays of a query in blocks.

    Attributes
    ----------
    origins, directions : dask arrays, (n, 3) or (h, w, 3)
        Blocks are of whole rows: parts of the first axis alone.
    t_min, t_max : float, or dask arrays, (n,) or (h, w)
        In the same blocks.
    """

    origins: Any
    directions: Any
    t_min: Any
    t_max: Any

    @property
    def lead(self) -> tuple[int, ...]:
        """Return the leading shape behind the first axis: () or (w,)."""
        lead: tuple[int, ...] = self.origins.shape[1:-1]
        return lead

    @property
    def chunks(self) -> tuple[float, ...]:
        """Return the number of rays in each block; NaN where Dask does not know it."""
        each = math.prod(self.lead)
        return tuple(rows * each for rows in self.origins.chunks[0])

    def firsts(self) -> Any:
        """Return the number of each block's first ray, a dask array of a number a block.

        Raises
        ------
        SettingError
            If Dask does not know how many rays the blocks have.
        """
        return _firsts("origins", "rays", self.chunks)


class LazyPoints(NamedTuple):
    """Holds the points of a query in blocks.

    Attributes
    ----------
    points, normals : dask arrays, (n, 3) or (h, w, 3)
        In blocks of whole rows. None where there are no normals.
    """

    points: Any
    normals: Any

    @property
    def lead(self) -> tuple[int, ...]:
        """Return the leading shape behind the first axis: () or (w,)."""
        lead: tuple[int, ...] = self.points.shape[1:-1]
        return lead

    def firsts(self) -> Any:
        """Return the number of each block's first point, a dask array of a number a block.

        Raises
        ------
        SettingError
            If Dask does not know how many points the blocks have.
        """
        each = math.prod(self.lead)
        chunks = tuple(rows * each for rows in self.points.chunks[0])
        return _firsts("points", "points", chunks)


def _firsts(name: str, what: str, chunks: tuple[float, ...]) -> Any:
    if any(map(math.isnan, chunks)):
        raise SettingError(
            f"{name}: found blocks of unknown size, expected known ones, as "
            f"{name}.compute_chunk_sizes() makes them: {what} are numbered through all blocks"
        )
    firsts = np.cumsum([0, *chunks[:-1]]).astype(np.int64)
    return dask_array().from_array(firsts, chunks=1)


#: The blocks of the first axis, and the sizes of the axes between that and a ray's numbers.
Cut = tuple[tuple[float, ...], tuple[int, ...]]


def lazy_rays(origins: Any, directions: Any, t_min: Any, t_max: Any) -> LazyRays:
    """Return rays of which some are dask arrays, all in the blocks of the first that is one.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes than rays have.
    """
    if directions is None:
        origins, directions = _halves(origins)
    cut = _cut_of([(origins, 1), (directions, 1), (t_min, 0), (t_max, 0)])
    o, d = _rows("origins", origins, cut), _rows("directions", directions, cut)
    if o is None or d is None:
        o, d = _spread(origins, d) if o is None else o, _spread(directions, o) if d is None else d
    if not _same(o.shape, d.shape):
        raise SettingError(
            f"rays: found origins {o.shape} and directions {d.shape}, expected one shape (n, 3) or "
            "(h, w, 3), or one of them for all"
        )
    if o.numblocks != d.numblocks:
        raise SettingError(
            f"rays: found origins in {o.numblocks[0]} blocks and directions in {d.numblocks[0]}, "
            "some of unknown size, expected the same blocks, as compute_chunk_sizes() allows"
        )
    lead = o.shape[:-1]
    return LazyRays(o, d, _column("t_min", t_min, lead, cut), _column("t_max", t_max, lead, cut))


def lazy_points(points: Any, normals: Any) -> LazyPoints:
    """Return points of which some are dask arrays, and their normals, in the same blocks.

    Raises
    ------
    SettingError
        If they have other shapes or dtypes than points have.
    """
    cut = _cut_of([(points, 1), (normals, 1)])
    p = _rows("points", points, cut)
    if p is None:
        raise SettingError("points: found one with dask arrays of normals, expected as many")
    if normals is None:
        return LazyPoints(p, None)
    n = _rows("normals", normals, cut)
    n = _spread(normals, p) if n is None else n
    if not _same(p.shape, n.shape) or p.numblocks != n.numblocks:
        raise SettingError(
            f"normals: found shape {n.shape} in {n.numblocks[0]} blocks, expected {p.shape} in "
            f"{p.numblocks[0]}, as points have, or (3,) for all"
        )
    return LazyPoints(p, n)


def _halves(rays: Any) -> tuple[Any, Any]:
    """Return the origins and the directions of rays of six numbers."""
    if not is_lazy(rays) or rays.ndim < 2 or rays.shape[-1] != SIX:
        raise SettingError(
            "directions: found none, expected an array, as origins is one, or rays of shape (n, 6)"
        )
    return rays[..., :3], rays[..., 3:]


def _cut_of(given: list[tuple[Any, int]]) -> Cut:
    """Return how the first dask array of several is cut; each comes with the axes of a row."""
    for each, row in given:
        if is_lazy(each) and each.ndim > row:
            between: tuple[int, ...] = each.shape[1 : each.ndim - row]
            if any(map(math.isnan, between)):
                raise SettingError(
                    f"rays: found a dask array of shape {each.shape}, expected one of which only "
                    "the first axis is of unknown size"
                )
            return each.chunks[0], between
    raise SettingError("rays: found a dask array of no axis, expected (n,) or (n, 3)")


def _rows(name: str, given: Any, cut: Cut) -> Any:
    """Return rays' origins or directions as a dask array; None for one that is for all."""
    check_frame(name, given)
    chunks, between = cut
    if _is_one(given):
        return None
    array = _blocks(name, given, (chunks, *between, 3))
    if array.ndim < 2 or array.shape[-1] != 3 or not has_numbers(array.dtype):
        raise SettingError(
            f"{name}: found {array.dtype} of shape {array.shape}, expected float32 or float64 of "
            "shape (n, 3) or (h, w, 3)"
        )
    return _in_blocks(array, chunks)


def _is_one(given: Any) -> bool:
    """Tell whether a plain array or list has three numbers, and no rows."""
    if isinstance(given, (list, tuple)):
        return len(given) == 3 and all(
            not isinstance(number, (list, tuple, np.ndarray)) for number in given
        )
    return isinstance(given, np.ndarray) and given.shape == (3,)


def _spread(one: Any, other: Any) -> Any:
    """Return one origin or direction, (3,), for each of the others, in their blocks."""
    number = np.asarray(one)
    if not has_numbers(number.dtype):
        raise SettingError(
            f"rays: found {number.dtype} of shape (3,), expected float32 or float64 of shape (3,)"
        )
    return other.map_blocks(repeated, number, dtype=number.dtype, meta=np.empty((0, 3)))


def repeated(block: NDArray[Any], one: NDArray[Any]) -> NDArray[Any]:
    """Return one row for each of a block."""
    return np.broadcast_to(one, block.shape)


def _column(name: str, given: Any, lead: tuple[float, ...], cut: Cut) -> Any:
    if not is_lazy(given) and np.ndim(given) == 0:
        number = np.asarray(given)
        if number.dtype.kind in "fiu":
            return float(number)
        raise SettingError(f"{name}: found {given!r:.80}, expected a number or (n,)")
    chunks, between = cut
    array = _blocks(name, given, (chunks, *between))
    if array.dtype.kind in "fiu" and _same(array.shape, lead):
        array = _in_blocks(array, chunks)
        if array.numblocks[0] == len(chunks):
            return array
    raise SettingError(
        f"{name}: found {array.dtype} of shape {array.shape}, expected a number or {lead} in the "
        "blocks of the rays"
    )


def _blocks(name: str, given: Any, chunks: Any) -> Any:
    """Return a dask array of what may be an array of NumPy's."""
    if is_lazy(given):
        return given
    if not isinstance(given, np.ndarray):
        raise SettingError(
            f"{name}: found {type(given).__name__} with dask arrays, expected an array"
        )
    known = given.ndim == len(chunks) and sum(chunks[0]) == len(given)
    return dask_array().from_array(given, chunks=chunks if known else "auto")


def _in_blocks(array: Any, chunks: tuple[float, ...]) -> Any:
    """Return an array in blocks of whole rows, of those sizes where Dask knows its own."""
    whole = dict.fromkeys(range(1, array.ndim), -1)
    known = not any(math.isnan(rows) for rows in (*array.chunks[0], *chunks))
    if known and sum(array.chunks[0]) == sum(chunks):
        return array.rechunk({0: chunks, **whole})
    return array.rechunk(whole) if known else array


def _same(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Tell whether shapes are the same, as far as Dask knows them."""
    return len(one) == len(other) and all(
        a == b or math.isnan(a) or math.isnan(b) for a, b in zip(one, other, strict=True)
    )
