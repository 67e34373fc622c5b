"""A contact sheet: pictures of one size side by side in rows, as one PNG."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.image.picture import BAND_BYTES, Image
from bfrt.image.png import write_png
from bfrt.paths import path_of

Rows = Mapping[str, NDArray[Any]]


def check_sheet(path: str | os.PathLike[str]) -> None:
    """Refuse a contact sheet by its suffix.

    Raises
    ------
    SettingError
        If it is another than ``.png``.
    """
    suffix = path_of("image", path).suffix.lower()
    if suffix != ".png":
        raise SettingError(
            f"{os.fspath(path)}: found suffix {suffix!r} of a contact sheet, expected .png"
        )


def write_sheet(path: str | os.PathLike[str], images: Sequence[Image], columns: int) -> None:
    """Write pictures of one size side by side, so many in a row; what is left over is black.

    Raises
    ------
    SettingError
        As `check_sheet`.
    StreamError
        If the system refuses a write; `DiskFullError` where it has no room.
    """
    check_sheet(path)
    height, width = images[0].shape
    lines = math.ceil(len(images) / columns)
    write_png(path, columns * width, lines * height, sheet_rows(images, columns))


def sheet_rows(images: Sequence[Image], columns: int) -> Iterator[Rows]:
    """Yield the rows of a sheet, some at a time, which are in memory meanwhile."""
    height, width = images[0].shape
    step = max(1, BAND_BYTES // (12 * columns * width))
    for first in range(0, len(images), columns):
        line = images[first : first + columns]
        for row in range(0, height, step):
            bands = [image.band(row, row + step) for image in line]
            rows = len(bands[0]["R"])
            left = np.zeros((rows, (columns - len(line)) * width), np.float32)
            yield {name: np.hstack([*(band[name] for band in bands), left]) for name in "RGB"}
            for image in line:
                image.let_go()
