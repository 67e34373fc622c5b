"""How coordinates are stored: as float32 or float64, and relative to which origin.

float32 coordinates are stored less the origin, float64 ones in world coordinates. What a caller
does not say, the first block decides: the origin for the whole store, the dtype for each stream.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.records import Kind
from bfrt.store.given import triple_of
from bfrt.store.model import Vector

#: The first columns of the positions in a record.
POSITIONS = {
    Kind.SPHERE: (0,),
    Kind.CONE: (0, 4),
    Kind.TRIANGLE: (0, 3, 6),
    Kind.PATCH: (0, 3, 6),
    Kind.POLYGON: (0,),
}


class Coordinates:
    """Holds what is decided about a store's coordinates.

    Parameters
    ----------
    dtype : {None, "float32", "float64"}
        The type that geometry is stored as. None keeps float32 as it is and all else as float64.
    origin : (3,) array_like, optional
        By default zero if the first block is float32, and its center if it is float64.

    Raises
    ------
    SettingError, SceneError
        For another dtype, or an origin that is not three finite numbers.
    """

    def __init__(self, dtype: Any, origin: ArrayLike | None) -> None:
        self._dtype = None if dtype is None else _float_of(dtype)
        self._origin = None if origin is None else triple_of("origin", origin)

    @property
    def origin(self) -> Vector:
        """Return the origin, zero where nothing has decided it."""
        return self._origin or (0.0, 0.0, 0.0)

    @property
    def decided(self) -> Vector | None:
        """Return the origin, if it was given or a block has decided it."""
        return self._origin

    def propose_origin(self, origin: Vector) -> None:
        """Decide the origin before the first block, if it is not decided."""
        if self._origin is None:
            self._origin = triple_of("origin", origin)

    def decide_origin(self, records: NDArray[Any]) -> Vector:
        """Return the origin, which is decided by `records` if they are the first block."""
        if self._origin is None:
            self._origin = (0.0, 0.0, 0.0)
            if records.dtype != np.float32:
                with np.errstate(all="ignore"):
                    center = records[:, :3].mean(axis=0, dtype=np.float64)
                if np.isfinite(center).all():  # else the block is about to be refused
                    self._origin = triple_of("center of the first block", center)
        return self._origin

    def stored(
        self, kind: Kind, records: NDArray[Any], stream_wide: bool | None
    ) -> NDArray[np.float32] | NDArray[np.float64]:
        """Return a block as it is stored: C-contiguous, not copied where it is so already.

        Parameters
        ----------
        kind : Kind
            The kind of the objects.
        records : (n, scalars) float32 or float64
            World coordinates.
        stream_wide : bool, optional
            Whether their stream is float64, or None if they are its first block.

        Raises
        ------
        SceneError
            If the block is float64 and its stream is not.
        """
        wide = self._is_wide(kind, records.dtype, stream_wide)
        with np.errstate(over="ignore"):  # infinity is refused
            if wide:
                return np.ascontiguousarray(records, np.float64)
            return np.ascontiguousarray(self._relative(kind, records), np.float32)

    @property
    def always_wide(self) -> bool:
        """Tell whether all geometry is stored as float64, whatever comes."""
        return self._dtype is not None and bool(self._dtype == np.float64)

    def _is_wide(self, kind: Kind, dtype: np.dtype[Any], stream_wide: bool | None) -> bool:
        """Tell whether a block is stored as float64."""
        if self._dtype is not None:
            return bool(self._dtype == np.float64)
        narrow = dtype == np.float32
        if stream_wide is None:
            return not narrow or any(self.origin)
        if not stream_wide and not narrow:
            raise SceneError(
                f"{kind.label}: found a block of {dtype}, expected float32 as in the first block"
            )
        return stream_wide

    def _relative(self, kind: Kind, records: NDArray[Any]) -> NDArray[Any]:
        """Take the origin off the positions in records."""
        if not any(self.origin):
            return records
        shifted = records.astype(np.float64)
        for start in POSITIONS[kind]:
            shifted[:, start : start + 3] -= np.asarray(self.origin)
        return shifted


def _float_of(dtype: Any) -> np.dtype[Any]:
    """Return the dtype of float32 or float64 that anything stands for which NumPy takes for one."""
    found: np.dtype[Any] | None = None
    with contextlib.suppress(TypeError):
        found = np.dtype(dtype)
    if found is None or found not in (np.float32, np.float64):
        raise SettingError(f"dtype: found {dtype!r:.80}, expected float32, float64 or None")
    return found
