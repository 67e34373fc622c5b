"""The process that reads a raster for another, by rasterio and GDAL (bfrt.formats.raster).

GDAL decodes a file by blocks, tiles or strips, and keeps some in its cache. A file says how large
they are, or names others that do, so that the process has a limit of its own beside: what GDAL asks
for beyond is refused to it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import resource
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import MaskFlags
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.windows import Window

from bfrt.errors import BudgetError, SceneError, SettingError
from bfrt.formats.raster.facts import Facts, Place
from bfrt.formats.raster.suffixes import DRIVERS, OPENINGS
from bfrt.formats.remote.serving import Answer, Verbs, serve
from bfrt.formats.source import said
from bfrt.memory import format_memory

#: Bytes of GDAL's cache of blocks, which one block at least is in however large it is.
CACHE = 8 << 20

#: How often a block is in memory while it is decoded: packed, unpacked, and in the cache.
BLOCK_COPIES = 3

#: Bytes that a height takes in both processes while its rows are handed over, and made float64.
HEIGHT_BYTES = 40

#: Bytes that the process may take beside the room that it is given, the cache included.
SLACK = 32 << 20

#: What GDAL says where something could not be read that it does without.
UNREAD = re.compile("IO error|tag ignored")

#: A proxy of a kind that there is not: through it nothing comes from a network.
NOWHERE = "none://nowhere"

#: No file of those that a file names comes from a network, and none is a program.
CONFIGURATION = {
    "GDAL_CACHEMAX": CACHE,
    "GDAL_NUM_THREADS": "1",
    "GDAL_VRT_ENABLE_PYTHON": "NO",
    "CPL_VSIL_CURL_ALLOWED_EXTENSIONS": ".none",
    "GDAL_HTTP_PROXY": NOWHERE,
    "GDAL_HTTPS_PROXY": NOWHERE,
}

#: The larger half axis of an ellipsoid, in WKT, meters.
ELLIPSOID = re.compile(r'(?:SPHEROID|ELLIPSOID)\["[^"]*",\s*([0-9.]+)')
EARTH = 6378137.0


class Complaints(logging.Handler):
    """Keeps what GDAL warns of."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []
        log = logging.getLogger("rasterio")
        log.addHandler(self)
        log.setLevel(logging.WARNING)
        log.propagate = False

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


class Server:
    """Answers what is asked of one band.

    Parameters
    ----------
    path : str
    band : int
        Its number, from 1.
    taken : int
        Bytes of a budget that are not for rows and blocks, for errors.
    room : int
        Bytes for these.
    """

    def __init__(self, path: str, band: int, taken: int, room: int) -> None:
        self._path, self._band = path, band
        self._taken, self._room = taken, room
        self._complaints = Complaints()
        driver = DRIVERS[Path(path).suffix.lower()]
        with self._asking(f"what GDAL's driver {driver} reads"):
            self._file = rasterio.open(path, driver=driver, **OPENINGS.get(driver, {}))
        if not 1 <= band <= self._file.count:
            raise SettingError(
                f"{path}: found band={band}, expected 1 to {self._file.count}, as the file has"
            )
        self._window: Window | None = None
        self._heights: NDArray[Any] | None = None
        flags = self._file.mask_flag_enums[band - 1]
        self._filled = MaskFlags.nodata in flags
        self._masked = not self._filled and MaskFlags.all_valid not in flags
        self.verbs: Verbs = {"rows": self.rows, "there": self.there}

    def facts(self) -> Facts:
        """Return what the file says of itself.

        Raises
        ------
        SceneError
            If it has no heights, or no transform but points on the ground.
        BudgetError
            If its blocks or its rows are larger than the room.
        """
        file, k = self._file, self._band - 1
        dtype = file.dtypes[k]
        if np.dtype(dtype).kind not in "iuf":
            raise SceneError(f"{self._path}: found {dtype} numbers, expected real ones as heights")
        if file.gcps[0] and file.transform.is_identity:
            raise SceneError(
                f"{self._path}: found points on the ground and no transform, expected one: make "
                "it by gdalwarp"
            )
        with self._asking("a reference system that PROJ knows"):
            place = Place(file.width, file.height, tuple(file.transform)[:6], self._crs())
            degrees = bool(file.crs and file.crs.is_geographic)
            radius = self._radius()
        fill = file.nodata if self._filled else None
        rows = self._rows_at_once(np.dtype(dtype))
        return Facts(place, dtype, rows, file.scales[k], file.offsets[k], degrees, radius, fill)

    def _crs(self) -> str:
        return str(self._file.crs.to_string()) if self._file.crs else ""

    def _radius(self) -> float:
        """Return the ellipsoid's larger half axis, in units of x and y."""
        crs = self._file.crs
        found = ELLIPSOID.search(crs.to_wkt()) if crs else None
        unit = crs.linear_units_factor[1] if crs and crs.is_projected else 1.0
        return (float(found[1]) if found else EARTH) / unit

    def _rows_at_once(self, dtype: np.dtype[Any]) -> int:
        """Return how many rows are read at once, of a block at the most."""
        rows, columns = self._file.block_shapes[self._band - 1]
        bands = self._file.count if self._file.profile.get("interleave") == "pixel" else 1
        block = BLOCK_COPIES * rows * columns * dtype.itemsize * bands
        row = HEIGHT_BYTES * self._file.width
        most = (self._room - block) // row
        if most < 2:
            raise BudgetError(
                f"{self._path}: found blocks of {rows} x {columns} {dtype} and rows of "
                f"{self._file.width}, expected smaller blocks, as gdal_translate -co TILED=YES "
                f"makes, or memory={format_memory(self._taken + block + 2 * row)} or more"
            )
        return int(min(rows, most))

    def rows(self, first: int, count: int) -> Answer:
        """Return the heights of some rows, (count, width)."""
        self._window = Window(0, first, self._file.width, count)
        with self._asking("rows that are whole", f"rows {first} to {first + count - 1}: "):
            self._heights = self._file.read(self._band, window=self._window)
        return ["done", list(self._heights.shape)], self._heights

    def there(self) -> Answer:
        """Return which of the rows' heights there are, (count, width) uint8; None for all."""
        assert self._heights is not None
        if self._filled:
            fill, heights = self._file.nodata, self._heights
            found = np.isnan(heights) if np.isnan(fill) else heights == heights.dtype.type(fill)
            there = np.logical_not(found).view(np.uint8)
        elif self._masked:
            with self._asking("a mask that is whole"):
                there = self._file.read_masks(self._band, window=self._window)
        else:
            return ["done", None], None
        return ["done", list(there.shape)], there

    @contextlib.contextmanager
    def _asking(self, expected: str, place: str = "") -> Iterator[None]:
        """Give GDAL's errors, and what it warns of and does without, the file's name."""
        self._complaints.texts.clear()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotGeoreferencedWarning)  # `facts` tell it
                yield
        except MemoryError as error:
            raise self._too_large() from error
        except (RasterioError, ValueError, OSError, UnicodeError) as error:
            causes = [error, error.__cause__, error.__context__]
            texts = " ".join(map(str, causes))
            if re.search("[Oo]ut of memory|[Cc]annot allocate|allocat", texts):
                raise self._too_large() from error
            cause = error.__cause__ or error
            raise SceneError(
                f"{self._path}: {place}found {said(cause)}, expected {expected}"
            ) from error
        for text in self._complaints.texts:
            if UNREAD.search(text):
                raise SceneError(f"{self._path}: {place}found {text!r:.200}, expected {expected}")

    def _too_large(self) -> BudgetError:
        return BudgetError(
            f"{self._path}: found blocks that GDAL takes more than {format_memory(self._room)} "
            "for, expected smaller ones, as gdal_translate -co TILED=YES makes, or more memory"
        )


def limit(room: int) -> None:
    """Have the system refuse the process memory beyond the room, where it can."""
    if sys.platform == "linux":
        found = re.search(r"VmData:\s*(\d+) kB", Path("/proc/self/status").read_text())
        assert found is not None
        most = (int(found[1]) << 10) + SLACK + room
        with contextlib.suppress(ValueError, OSError):  # a lower one is there
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def main(path: str, limits: list[Any]) -> None:
    """Say what a raster is like, and answer until nothing is asked any more."""
    band, taken, room = limits
    for name in ("no_proxy", "NO_PROXY"):  # for which places there is none
        os.environ.pop(name, None)
    with contextlib.ExitStack() as opened:

        def begin() -> tuple[list[Any], Verbs]:
            opened.enter_context(rasterio.Env(**CONFIGURATION))
            limit(room)
            server = Server(path, band, taken, room)
            return [*server.facts()], server.verbs

        serve(begin)
