"""The picture that a render returns."""

from __future__ import annotations

import io
import itertools
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from bfrt.errors import SettingError
from bfrt.image.color_bar import bar_of, beside, check_bar
from bfrt.image.color_scale import ColorScale
from bfrt.image.exr import write_exr
from bfrt.image.image_buffer import expect, forget
from bfrt.image.png import encode_png, encode_srgb, write_png
from bfrt.masks import is_masked
from bfrt.paths import check_outside, path_of, without_links
from bfrt.refusals import in_memory
from bfrt.stats import Stats
from bfrt.streams.atomic_write import write_parts

SUFFIXES = (".exr", ".png", ".npy")

#: Bytes of the rows that are written at once; of an image on disk they are in memory meanwhile.
BAND_BYTES = 1 << 21


class Image:
    """Holds a picture in memory: color, and what the first sample of each pixel met.

    Parameters
    ----------
    channels : dict of str to ndarray, shape (height, width)
        The arrays, which are kept, not copied. R G B A are needed: linear color and alpha, float32.
        A render adds these of each pixel's first sample: Z, float32, the distance from the eye in
        world units, inf on a miss; N.X N.Y N.Z, float32, the unit normal, 0 on a miss; id.lo
        id.hi, uint32, the halves of the 64-bit object id, 0xFFFFFFFF on a miss; and on request P.X
        P.Y P.Z, float32, the position in world coordinates, inf on a miss, and albedo.R albedo.G
        albedo.B, float32, the material's color, 0 on a miss.
    metadata : dict of str to str
        The scene and the settings that change the picture. ``.exr`` files contain it.
    stats : bfrt.stats.Stats, optional
        The counters of the render. No file contains them.

    Raises
    ------
    SettingError
        If a color channel is missing, or shapes or types differ from these.
    """

    def __init__(
        self,
        channels: Mapping[str, npt.NDArray[Any]],
        metadata: Mapping[str, str] | None = None,
        stats: Stats | None = None,
    ) -> None:
        self.channels = dict(channels)
        self.metadata = dict(metadata or {})
        self.stats = stats
        _check_channels(self.channels)

    @property
    def shape(self) -> tuple[int, int]:
        """Return height and width in pixels."""
        height, width = self.channels["R"].shape
        return height, width

    @property
    def height(self) -> int:
        """Return the number of rows."""
        return self.shape[0]

    @property
    def width(self) -> int:
        """Return the number of columns."""
        return self.shape[1]

    @property
    def rgb(self) -> npt.NDArray[np.float32]:
        """Return linear color, a new float32 array of shape (height, width, 3)."""
        return np.stack([self.channels[name] for name in "RGB"], axis=-1)

    @property
    def rgba(self) -> npt.NDArray[np.float32]:
        """Return linear color and alpha, a new float32 array of shape (height, width, 4)."""
        return np.stack([self.channels[name] for name in "RGBA"], axis=-1)

    @property
    def ids(self) -> npt.NDArray[np.uint64]:
        """Return the 64-bit object ids, uint64 of shape (height, width); 2^64 - 1 on a miss."""
        if "id.lo" not in self.channels:
            raise SettingError(
                f"image: found channels {' '.join(self.channels)}, expected id.lo and id.hi"
            )
        ids = self.channels["id.hi"].astype(np.uint64) << np.uint64(32)
        ids |= self.channels["id.lo"]
        return ids

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("image: an array of it is always a copy, found copy=False")
        return self.rgba.astype(np.float32 if dtype is None else dtype, copy=False)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        half: bool = False,
        color_bar: ColorScale | None = None,
    ) -> None:
        """Write the picture to a file, whole or not at all.

        Parameters
        ----------
        path : path-like
            The file to write. The suffix decides: ``.exr`` keeps every channel and the metadata,
            ``.png`` is clipped 8-bit sRGB without alpha, ``.npy`` is `rgba`.
        half : bool
            Store color and alpha in 16 bits, clamped to +-65504; only for ``.exr``.
        color_bar : ColorScale, optional
            Put a bar at the right that tells which numbers colors stand for, as `Scene.colors` has
            them; only for ``.png``. It needs matplotlib (``bfrt[colormaps]``).

        Raises
        ------
        SettingError
            If the suffix is another, `half` is given for another format than ``.exr`` or
            `color_bar` than ``.png``, matplotlib is needed and missing, or the file would be in a
            scene store.
        DiskFullError, StreamError
            If the system refuses a write; nothing half-written is left.
        """
        file, suffix = path_of("image", path), check_suffix(path, half=half)
        check_outside(str(file), without_links(file).parent)
        if color_bar is not None:
            self._save_with_bar(path, suffix, color_bar)
            return
        with in_memory(f"{path}: saving"):
            if suffix == ".exr":
                write_exr(path, self.width, self.height, self.bands(), self.metadata, half=half)
            elif suffix == ".png":
                write_png(path, self.width, self.height, self.bands())
            else:
                self._write_npy(path)

    def _save_with_bar(
        self, path: str | os.PathLike[str], suffix: str, color_bar: ColorScale
    ) -> None:
        if suffix != ".png":
            raise SettingError(f"{path}: found color_bar for {suffix}, expected it only for .png")
        check_bar(path)
        with in_memory(f"{path}: saving"):
            bar = bar_of(color_bar, self.height)
            width = self.width + bar.shape[1]
            write_png(path, width, self.height, beside(self.bands(), bar))

    def _write_npy(self, path: str | os.PathLike[str]) -> None:
        layout = {"descr": "<f4", "fortran_order": False, "shape": (*self.shape, 4)}
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(header, layout)
        stacked = (np.stack([band[name] for name in "RGBA"], axis=-1) for band in self.bands())
        rows = (pixels.astype("<f4", copy=False).tobytes() for pixels in stacked)
        write_parts(path, itertools.chain([header.getvalue()], rows))

    def bands(self) -> Iterator[dict[str, npt.NDArray[Any]]]:
        """Yield the channels by bands of rows, so that saving takes a copy of a band only."""
        step = max(1, BAND_BYTES // (4 * self.width * len(self.channels)))
        for row in range(0, self.height, step):
            yield self.band(row, row + step)
            self.let_go()

    def band(self, first: int, last: int) -> dict[str, npt.NDArray[Any]]:
        """Return rows [first, last) of the channels, which the system reads at once."""
        for pixels in self.channels.values():
            expect(pixels, slice(first, last))
        return {name: pixels[first:last] for name, pixels in self.channels.items()}

    def let_go(self) -> None:
        """Release the memory of what was read of channels on disk."""
        for pixels in self.channels.values():
            forget(pixels)

    def plot(self, axes: Any = None) -> Any:
        """Show the picture by matplotlib, as its PNG shows it.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Where it is shown; by default on a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        SettingError
            If matplotlib is not installed, or `axes` are none of its.
        """
        try:
            from matplotlib import pyplot
        except ImportError:
            raise SettingError(
                "image: a plot needs matplotlib: pip install bfrt[colormaps]"
            ) from None
        if axes is not None and not hasattr(axes, "imshow"):
            raise SettingError(f"axes: found {type(axes).__name__}, expected axes of matplotlib")
        axes = pyplot.subplots()[1] if axes is None else axes
        axes.imshow(self.srgb(), interpolation="none")
        axes.set_axis_off()
        return axes

    def srgb(self) -> npt.NDArray[np.uint8]:
        """Return the codes that a PNG has, sRGB, a new array of shape (height, width, 3)."""
        codes = np.empty((*self.shape, 3), np.uint8)
        row = 0
        for band in self.bands():
            some = np.stack([encode_srgb(band[name]) for name in "RGB"], axis=-1)
            codes[row : row + len(some)] = some
            row += len(some)
        return codes

    def _repr_png_(self) -> bytes:
        return b"".join(encode_png(self.width, self.height, self.bands()))

    def __repr__(self) -> str:
        metadata = "".join(f", {key}={text!r}" for key, text in self.metadata.items())
        return f"<bfrt.Image {self.width} x {self.height}, {' '.join(self.channels)}{metadata}>"


def check_suffix(path: str | os.PathLike[str], *, half: bool = False) -> str:
    """Return the suffix of a picture's file, in small letters.

    Raises
    ------
    SettingError
        If it is none of `SUFFIXES`, or not ``.exr`` where `half` is asked for.
    """
    suffix = path_of("image", path).suffix.lower()
    if suffix not in SUFFIXES:
        raise SettingError(
            f"{path}: found suffix {suffix!r}, expected one of {', '.join(SUFFIXES)}"
        )
    if half and suffix != ".exr":
        raise SettingError(f"{path}: found half=True for {suffix}, expected it only for .exr")
    return suffix


def _check_channels(channels: Mapping[str, npt.NDArray[Any]]) -> None:
    missing = [name for name in "RGBA" if name not in channels]
    if missing:
        raise SettingError(
            f"image: found channels {' '.join(channels) or 'none'}, expected also "
            f"{' '.join(missing)}"
        )
    if ("id.lo" in channels) != ("id.hi" in channels):
        raise SettingError("image: found one of id.lo and id.hi, expected both or neither")
    shape = channels["R"].shape
    if len(shape) != 2 or 0 in shape:
        raise SettingError(f"image: R: found shape {shape}, expected (height, width)")
    for name, pixels in channels.items():
        wanted = np.dtype(np.uint32 if name.startswith("id.") else np.float32)
        if is_masked(pixels):
            raise SettingError(f"image: {name}: found masked elements, expected a value for each")
        if pixels.shape != shape or pixels.dtype != wanted:
            raise SettingError(
                f"image: {name}: found {pixels.dtype} of shape {pixels.shape}, "
                f"expected {wanted} of shape {shape}"
            )
