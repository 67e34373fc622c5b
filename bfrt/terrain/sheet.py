"""The GeoTIFF of what is seen, which GDAL writes in a process of its own (bfrt.formats.remote)."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.errors import RasterioError
from rasterio.windows import Window

from bfrt.errors import StreamError
from bfrt.formats.raster.child import CONFIGURATION
from bfrt.formats.remote.serving import Verbs, serve

#: Rows and columns of a tile, and so the rows that are written at once.
TILE = 256


def main(path: str, about: list[Any]) -> None:
    """Write a file of bytes, band after band and row after row, as a GeoTIFF; then end.

    Parameters
    ----------
    path : str
        The bytes.
    about : list
        The file to write, what errors call it, the number of bands, and the raster's `Place`.
    """
    target, name, bands, (width, height, transform, crs) = about
    profile: dict[str, Any] = {
        "driver": "GTiff", "count": bands, "width": width, "height": height, "dtype": "uint8",
        "transform": rasterio.Affine(*transform), "crs": crs or None, "compress": "deflate",
        "tiled": True, "blockxsize": TILE, "blockysize": TILE, "interleave": "band",
        "BIGTIFF": "IF_SAFER",
    }  # fmt: skip

    def begin() -> tuple[list[Any], Verbs]:
        try:
            with rasterio.Env(**CONFIGURATION), rasterio.open(target, "w", **profile) as file:
                copy(Path(path), file)
        except (RasterioError, OSError) as error:
            number = getattr(error, "errno", None) or errno.EIO
            raise StreamError(name, 0, number, "writing") from error
        return [os.stat(target).st_size], {}  # noqa: PTH116

    serve(begin)


def copy(path: Path, file: Any) -> None:
    """Copy bytes into the bands of a raster that is open, a row of tiles at a time."""
    with path.open("rb") as source:
        for band in range(1, file.count + 1):
            for first in range(0, file.height, TILE):
                rows = min(TILE, file.height - first)
                block = np.fromfile(source, np.uint8, rows * file.width)
                window = Window(0, first, file.width, rows)
                file.write(block.reshape(rows, file.width), band, window=window)
