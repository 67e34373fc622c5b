"""The bar that tells which numbers colors stand for, beside a picture: matplotlib draws it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.image.color_scale import ColorScale
from bfrt.image.colormaps import colormap, linear

Rows = Mapping[str, NDArray[Any]]

#: Pixels of the bar and its numbers: its width, and the least height.
WIDTH = 120
LEAST = 64

#: Dots an inch, by which letters are 7 pixels wide, and letters of a name at the most.
DPI = 100
MOST_LETTERS = 18

#: Numbers beside a bar.
TICKS = 5


def check_bar(path: str | os.PathLike[str]) -> None:
    """Refuse a color bar where matplotlib is missing.

    Raises
    ------
    SettingError
        If it is.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise SettingError(
            f"{os.fspath(path)}: a color bar needs matplotlib: pip install bfrt[colormaps]"
        ) from None


def check_height(height: int) -> None:
    """Refuse a picture that is too low for numbers beside it.

    Raises
    ------
    SettingError
        If it is.
    """
    if height < LEAST:
        raise SettingError(f"color_bar: found {height} rows, expected {LEAST} or more for numbers")


def check_scale(scale: object) -> None:
    """Refuse what is no scale of colors, or has no range.

    Raises
    ------
    SettingError
        If it is such.
    """
    if not isinstance(scale, ColorScale):
        raise SettingError(
            f"color_bar: found {type(scale).__name__}, expected a ColorScale, as scene.colors[0]"
        )
    if not -math.inf < scale.lo <= scale.hi < math.inf or (scale.log and scale.lo <= 0.0):
        raise SettingError(
            f"color_bar: found a range from {scale.lo!r:.40} to {scale.hi!r:.40}, expected finite "
            f"numbers, the lesser first{', above 0' if scale.log else ''}"
        )


def bar_of(scale: ColorScale, height: int) -> NDArray[np.float32]:
    """Return a color bar, (height, WIDTH, 3), linear: white, its numbers at the right.

    Raises
    ------
    SettingError
        If the picture is too low for numbers, or the scale is none.
    """
    check_height(height)
    check_scale(scale)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH / DPI, height / DPI), dpi=DPI, facecolor="white")
    canvas: Any = FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0.1, 0.06, 0.18, 0.8))
    axes.imshow(colormap(scale.colormap)[::-1, None], aspect="auto", extent=(0, 1, 0, 1))
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.set_yticks(np.arange(TICKS) / (TICKS - 1), labels=labels_of(scale), fontsize=7)
    name = scale.name if len(scale.name) <= MOST_LETTERS else f"{scale.name[: MOST_LETTERS - 1]}…"
    axes.set_title(name, fontsize=7, loc="left", parse_math=False)
    canvas.draw()
    codes = np.asarray(canvas.buffer_rgba())[:height, :WIDTH, :3]
    shown: NDArray[np.float32] = linear(codes / 255.0).astype(np.float32)
    return shown


def labels_of(scale: ColorScale) -> list[str]:
    """Return the numbers beside a bar, from its lower end to its upper one, evenly parted."""
    parts = [number / (TICKS - 1) for number in range(TICKS)]
    if scale.log:
        numbers = [scale.lo ** (1.0 - part) * scale.hi**part for part in parts]
    else:
        numbers = [scale.lo * (1.0 - part) + scale.hi * part for part in parts]
    return [f"{number:.4g}" for number in numbers]


def beside(rows: Iterable[Rows], bar: NDArray[np.float32]) -> Iterator[Rows]:
    """Yield the colors of a picture's rows, with those of a bar at their right."""
    row = 0
    for band in rows:
        part = bar[row : row + len(band["R"])]
        row += len(part)
        yield {name: np.hstack([band[name], part[:, :, k]]) for k, name in enumerate("RGB")}
