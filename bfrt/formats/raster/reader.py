"""Rasters of heights, by GDAL, some rows at a time: two triangles a cell."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.contents import COLOR, Row
from bfrt.formats.gzipped import suffix_of
from bfrt.formats.object_writer import LARGEST, ObjectWriter, SceneSink
from bfrt.formats.raster.cells import triangles_in
from bfrt.formats.raster.esri_grid import check_grid
from bfrt.formats.raster.facts import Facts, check_place
from bfrt.formats.raster.remote import RemoteRaster, Rows
from bfrt.formats.raster.suffixes import DRIVERS, GRID
from bfrt.formats.reading import RASTERS, Reading
from bfrt.formats.remote.process import is_installed
from bfrt.formats.room import need_of
from bfrt.formats.source import Report, Source
from bfrt.store.model import Vector

log = logging.getLogger(__name__)

#: The name of the numbers that colors may be made from.
HEIGHT = "z"

#: Bytes for blocks and rows of a raster that is only told of, which reads none.
TOLD = 1 << 62

#: The transform of a raster that has none.
PIXELS = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)

#: Degrees of latitude that a meter has, about.
DEGREES = "1/111320 = 8.98e-6"


class Terrain:
    """Reads the heights of a raster as a conversion wants them.

    Parameters
    ----------
    path : str
    raster : RemoteRaster
    reading : Reading

    Attributes
    ----------
    bend : float
        What heights are lowered by for the square of their distance from the middle.
    missing : int
        Heights that were not finite, and are taken for missing.
    """

    def __init__(self, path: str, raster: RemoteRaster, reading: Reading) -> None:
        self.name = path
        self.facts: Facts = raster.facts
        self._raster = raster
        self._skip = reading.skip_invalid
        self._scale = 1.0 if reading.height_scale is None else reading.height_scale
        self._floor = reading.floor
        self.bend = bend_of(path, raster.facts, reading.curvature)
        self.missing = 0
        check_place(path, self.facts.place)
        if self.facts.degrees and reading.height_scale is None:
            raise SettingError(self._in_degrees())
        if DRIVERS[suffix_of(path)] == GRID:
            check_grid(path, self.facts.place)

    def _in_degrees(self) -> str:
        x, y = self.facts.place.middle
        zone = min(max(int((x + 180) // 6) + 1, 1), 60)
        number = (32600 if y >= 0 else 32700) + zone
        return (
            f"{self.name}: found a reference system in degrees, {self.facts.place.crs:.60}, "
            f"expected one in meters: reproject it (gdalwarp -t_srs EPSG:{number}), or give "
            f"height_scale (--height-scale), which makes degrees of heights: {DEGREES} for meters"
        )

    @property
    def origin(self) -> Vector:
        """Return a point near all x and y, of whole numbers, so that whole ones stay so."""
        x, y = self.facts.place.middle
        return float(round(x)), float(round(y)), 0.0

    def all_rows(self) -> Iterator[Rows]:
        """Yield all rows of heights that are finite.

        Raises
        ------
        SceneError
            If others are not to be skipped.
        """
        for rows in self._raster.all_rows():
            heights = rows.heights if self._scale == 1.0 else rows.heights * self._scale
            wrong = rows.there & ~(np.abs(heights) <= LARGEST)
            if wrong.any():
                self._note(Rows(rows.first, heights, wrong))
            yield Rows(rows.first, heights, rows.there & ~wrong)

    def _note(self, rows: Rows) -> None:
        """Count heights that are not finite, or refuse the first."""
        if not self._skip:
            row, column = np.argwhere(rows.there)[0]
            raise SceneError(
                f"{self.name}: row {rows.first + row}, column {column}: found "
                f"{rows.heights[row, column]:g}, expected a finite height, or that the file says "
                "of it that it is no data"
            )
        self.missing += int(np.count_nonzero(rows.there))

    def blocks(self) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Yield all triangles (n, 9) in blocks, with the rows that are done."""
        last: Rows | None = None
        for rows in self.all_rows():
            joined = rows if last is None else below(last, rows)
            for triangles in triangles_in(self.facts.place, joined, self.bend, self._floor):
                yield rows.first, triangles
            last = Rows(rows.first + len(rows.heights) - 1, rows.heights[-1:], rows.there[-1:])

    def numbers(self) -> Iterator[NDArray[Any]]:
        """Yield the numbers that a color map takes its range from."""
        for _, triangles in self.blocks():
            yield heights_of(triangles)
        self.missing = 0


def bend_of(name: str, facts: Facts, curvature: float | None) -> float:
    """Return what heights are lowered by for the square of their distance from a point.

    A point at a distance d is lower by d^2 / 2R than the plane that touches the earth, and the
    air's refraction lifts it by a part of that: the coefficient, `curvature`, is what is left, as
    in ``gdal_viewshed -cc``. From whichever point distances are taken makes no difference to what
    hides what: heights lowered from p differ from those lowered from q by
    bend (2 (x - p).(q - p) - |q - p|^2), which is linear in x, and leaves lines straight.

    Raises
    ------
    SettingError
        If x and y are degrees.
    """
    if not curvature:
        return 0.0
    if facts.degrees:
        raise SettingError(
            f"{name}: found curvature={curvature:g} and a reference system in degrees, expected "
            "one in meters: reproject it by gdalwarp"
        )
    return curvature / (2.0 * facts.radius)


def below(last: Rows, rows: Rows) -> Rows:
    """Return rows with the one before them."""
    heights = np.concatenate([last.heights, rows.heights])
    return Rows(last.first, heights, np.concatenate([last.there, rows.there]))


def heights_of(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean height of each triangle, (n,)."""
    mean: NDArray[np.float64] = triangles[:, 2::3].mean(axis=1)
    return mean


def write_terrain(terrain: Terrain, writer: ObjectWriter, report: Report) -> None:
    """Write all triangles of a terrain."""
    painted = writer.reading.color_by is not None
    if painted:
        writer.paint_by(terrain.numbers)
    for row, triangles in terrain.blocks():
        report(row)
        writer.triangles(triangles, heights_of(triangles) if painted else None)
    if terrain.missing:
        log.warning("%s: %d heights that are not finite are missing", terrain.name, terrain.missing)


def read_raster(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read a raster of heights: two triangles for each cell whose four corners it has.

    Raises
    ------
    SceneError
        If it is none, or is broken.
    SettingError
        If a setting does not fit it, or rasterio is missing.
    BudgetError
        If its blocks are larger than memory allows.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, *RASTERS)
    if reading.color_by not in (None, HEIGHT):
        raise SettingError(
            f"{path}: found color_by={reading.color_by!r}, expected {HEIGHT!r}, which a raster has"
        )
    check_library(path)
    with Source(path) as source:
        size = source.size
    with closing(opened(path, reading)) as raster:
        terrain = Terrain(path, raster, reading)
        if raster.facts.place.transform == PIXELS:
            log.warning("%s: found no transform: x and y count pixels, from the first one", path)
        sink.place(terrain.origin, raster.facts.place.crs)
        writer = ObjectWriter(sink, path, reading)

        def done(row: int) -> None:
            if report is not None:
                report(size * row // raster.facts.place.height)

        write_terrain(terrain, writer, done)
        done(raster.facts.place.height)
        writer.report()


def opened(path: str, reading: Reading) -> RemoteRaster:
    """Open the band of a raster that is asked for."""
    band = 1 if reading.band is None else reading.band
    return RemoteRaster(path, band, need_of(path).blocks, reading.room)


def contents_of_raster(path: str) -> list[Row]:
    """Tell how large a raster's first band is; else as `read_raster`."""
    check_library(path)
    with closing(opened(path, Reading(room=TOLD))) as raster:
        place, dtype = raster.facts.place, raster.facts.dtype
    use = f"triangles: --band N, {COLOR.format(HEIGHT)}"
    return [Row("band 1", (place.height, place.width), dtype, use)]


def check_library(path: str) -> None:
    """Refuse a raster where rasterio is missing."""
    if not is_installed("rasterio"):
        raise SettingError(f"{path}: found no rasterio, expected it: install bfrt[raster]")
