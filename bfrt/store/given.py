"""A caller's numbers as arrays of known shape; anything else raises `SceneError`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError
from bfrt.masks import is_masked
from bfrt.records import SCALARS, Kind


def array_of(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return anything that NumPy takes for an array as one."""
    if is_masked(value):
        raise SceneError(f"{name}: found masked elements, expected numbers")
    try:
        return np.asarray(value)
    except (TypeError, ValueError) as error:  # rows of different lengths
        raise SceneError(f"{name}: found no array, expected numbers: {error}") from None


def floats_of(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return numbers as float32 if they are float32 in any byte order, else as float64."""
    array = array_of(name, value)
    if array.dtype.kind not in "fiu" and array.size:
        raise SceneError(f"{name}: found {array.dtype}, expected numbers")
    narrow = array.dtype.kind == "f" and array.dtype.itemsize == 4
    return array.astype(np.float32 if narrow else np.float64, copy=False)


def triple_of(name: str, value: ArrayLike) -> tuple[float, float, float]:
    """Return a position, a direction or a color as a tuple."""
    array = floats_of(name, value).astype(np.float64, copy=False)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise SceneError(f"{name}: found {value!r:.80}, expected three finite numbers")
    return (float(array[0]), float(array[1]), float(array[2]))


def rows_of(name: str, value: ArrayLike, row: Sequence[int]) -> tuple[NDArray[Any], int]:
    """Return numbers of shape (n, *row), and n."""
    array = floats_of(name, value)
    if array.shape[1:] != tuple(row) or array.ndim != len(row) + 1:
        expected = ", ".join(str(r) for r in ("n", *row))
        raise SceneError(f"{name}: found shape {array.shape}, expected ({expected})")
    return array, len(array)


def rows_beside(
    name: str, value: ArrayLike, row: Sequence[int], n: int, other: str
) -> NDArray[Any]:
    """Return numbers of shape (n, *row), where `other` has n rows."""
    array, found = rows_of(name, value, row)
    if found != n:
        raise SceneError(f"{name}: found {found} rows, expected {n}, as many as {other}")
    return array


def column_of(name: str, value: ArrayLike, n: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return a number for each of n objects as a column; one number stands for all."""
    with np.errstate(over="ignore"):  # infinity is refused
        array = floats_of(name, value).astype(dtype, copy=False)
    if array.ndim == 0:
        array = np.full(n, array)
    if array.shape != (n,):
        raise SceneError(f"{name}: found shape {array.shape}, expected ({n},)")
    return array[:, None]


def records_of(kind: Kind, value: ArrayLike) -> NDArray[Any]:
    """Return records (n, scalars) of a kind that is not a polygon."""
    records = floats_of(kind.label, value)
    if records.ndim != 2 or records.shape[1] != SCALARS[kind] or kind.counted:
        raise SceneError(
            f"{kind.label}: found records of shape {records.shape}, expected (n, {SCALARS[kind]})"
        )
    return records


def vertices_of(value: ArrayLike, counts: NDArray[Any]) -> NDArray[Any]:
    """Return the vertices (m, 3) of polygons, of which `counts` (n,) are how many each has."""
    vertices = floats_of("polygon", value)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SceneError(f"polygon: found vertices of shape {vertices.shape}, expected (m, 3)")
    if counts.ndim != 1 or (len(counts) and counts.dtype.kind not in "iu"):
        raise SceneError(
            f"polygon: found counts of {counts.dtype} and shape {counts.shape}, "
            "expected integers of shape (n,)"
        )
    # No count above the sum, or sums of 64 bits could come round.
    fits = not len(counts) or 3 <= counts.min() <= counts.max() <= len(vertices)
    if not fits or int(counts.sum()) != len(vertices):
        raise SceneError(
            f"polygon: found {len(vertices)} vertices for counts of {counts.sum()} in all, "
            "expected as many, each count 3 or more"
        )
    return vertices


def faces_among(value: ArrayLike, n: int) -> NDArray[np.int64]:
    """Return the corners (m, 3) of triangles, each the number of one of n vertices."""
    faces = array_of("faces", value)
    if faces.ndim != 2 or faces.shape[1] != 3 or (faces.size and faces.dtype.kind not in "iu"):
        raise SceneError(
            f"faces: found {faces.dtype} of shape {faces.shape}, expected whole numbers (n, 3)"
        )
    if faces.size and not 0 <= int(faces.min()) <= int(faces.max()) < n:
        bad = int(np.argmax(((faces < 0) | (faces >= n)).any(axis=1)))
        expected = f"0 to {n - 1}" if n else "none"
        raise SceneError(f"faces: found {faces[bad].tolist()} in face {bad}, expected {expected}")
    return faces.astype(np.int64, copy=False)
