"""The ground at the middles of a raster's pixels, as a store has it, and the ways to there.

Heights are read once more, beside the scene, and kept on disk as rows of float32: a store's
triangles have these numbers, so that a ray to a pixel ends at a corner of four cells, and not a
hair below it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.formats.raster.cells import corners_of
from bfrt.formats.raster.facts import Place
from bfrt.formats.raster.reader import Terrain
from bfrt.formats.raster.remote import Rows
from bfrt.refusals import calling
from bfrt.store.model import Vector
from bfrt.streams.writer import FileWriter

#: Pixels of the rows that are looked at once, unless one row has more.
PIXELS_AT_ONCE = 1 << 16

#: Bytes that such rows take, with the rays to them.
ROWS_BYTES = 16 << 20


class Observer(NamedTuple):
    """Stands somewhere and looks.

    Attributes
    ----------
    eye : tuple of 3 float
        World coordinates.
    reach : float
        How far it sees, in units of x and y.
    """

    eye: Vector
    reach: float


class Ground:
    """Knows the ground at the middle of every pixel.

    Parameters
    ----------
    place : Place
        Where the raster lies.
    origin : tuple of 3 float
        The point that coordinates of the store are relative to.
    path : Path
        The file of heights, float32: NaN where there are none.
    lift : float
        What of a target is above the ground.
    """

    def __init__(self, place: Place, origin: Vector, path: Path, lift: float) -> None:
        self.place = place
        self._origin = np.array(origin)
        self._path = path
        self._lift = lift

    @property
    def rows_at_once(self) -> int:
        return max(PIXELS_AT_ONCE // self.place.width, 1)

    def _rows(self) -> Iterator[Rows]:
        """Yield all heights, some rows at a time."""
        each = self.rows_at_once * self.place.width
        with calling(self._path, "reading"), self._path.open("rb") as file:
            for first in range(0, self.place.height, self.rows_at_once):
                found = np.fromfile(file, np.float32, each).reshape(-1, self.place.width)
                heights = found.astype(np.float64)
                yield Rows(first, heights, ~np.isnan(heights))

    def ways(self, observer: Observer) -> Iterator[tuple[NDArray[np.float64], NDArray[np.bool_]]]:
        """Yield the ways from an eye to the pixels that it may see, and which these are.

        Yields
        ------
        ways : (n, 3) float64
        chosen : (rows, width) bool
            The pixels, n of them, within reach and where there is ground.
        """
        eye = np.array(observer.eye)
        for rows in self._rows():
            corners = corners_of(self.place, rows)
            stored = (corners - self._origin).astype(np.float32)
            ways = stored.astype(np.float64) + self._origin - eye
            ways[..., 2] += self._lift
            chosen = rows.there & (np.hypot(ways[..., 0], ways[..., 1]) <= observer.reach)
            yield ways[chosen], chosen


def write_ground(terrain: Terrain, path: Path) -> float | None:
    """Write the heights of all pixels as the store has them; return the least, None if none.

    Raises
    ------
    SceneError, StreamError, DiskFullError
        As reading and writing are refused.
    """
    lowest = np.inf
    with FileWriter(path, False) as file:
        for rows in terrain.all_rows():
            corners = corners_of(terrain.facts.place, rows, bend=terrain.bend)
            heights = np.where(rows.there, corners[..., 2], np.nan).astype(np.float32)
            file.write(heights)
            lowest = min(lowest, float(np.min(heights, where=rows.there, initial=np.inf)))
    return lowest if np.isfinite(lowest) else None
