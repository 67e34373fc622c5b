"""The pictures that a render of several views returns."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple, SupportsIndex, overload

from bfrt.errors import SettingError, StreamError
from bfrt.image.animation import check_animation, write_animation
from bfrt.image.color_scale import ColorScale
from bfrt.image.numbered import numbered
from bfrt.image.picture import Image, check_suffix
from bfrt.image.sheet import check_sheet, write_sheet
from bfrt.paths import check_apart, check_file
from bfrt.refusals import in_memory
from bfrt.settings import at_least_one, number_of
from bfrt.stats import Stats
from bfrt.streams.atomic_write import staged_paths

PathLike = str | os.PathLike[str]

#: Seconds that a picture of an animation is seen.
SECONDS = 0.1

#: Pictures in a row of a contact sheet at the most, and pixels of a row of any PNG.
MOST_COLUMNS = 65536
MOST_WIDTH = (1 << 31) - 1


class Output(NamedTuple):
    """Names a file that pictures become, and what writes it to a path."""

    path: str
    write: Callable[[Path], None]


class Images(list[Image]):
    """Holds the pictures of several views of one scene: a list of them, in the order of the views.

    Attributes
    ----------
    stats : bfrt.stats.Stats, optional
        The counters of the render, of all views together.
    """

    @overload
    def __getitem__(self, index: SupportsIndex) -> Image: ...
    @overload
    def __getitem__(self, index: slice) -> Images: ...
    def __getitem__(self, index: SupportsIndex | slice) -> Image | Images:
        """Return a picture; of a slice some, which are saved as all are."""
        if isinstance(index, slice):
            return Images(super().__getitem__(index))
        return super().__getitem__(index)

    @property
    def stats(self) -> Stats | None:
        """Return the counters of the render, of all views together."""
        return self[0].stats if self else None

    def _repr_html_(self) -> str:
        shown = (base64.b64encode(image._repr_png_()).decode() for image in self)
        return "".join(f'<img src="data:image/png;base64,{each}">' for each in shown)

    def save(
        self, pattern: PathLike, *, half: bool = False, color_bar: ColorScale | None = None
    ) -> None:
        """Write a file for each picture, all or none.

        Parameters
        ----------
        pattern : path-like
            The files, with a place for the view's number, which begins at 0:
            ``view-{:03d}.png`` or ``view-%03d.png``. The suffix is as of `Image.save`.
        half, color_bar
            As of `Image.save`.

        Raises
        ------
        SettingError
            If the pattern has no place for a number, or more than one; else as of `Image.save`.
        DiskFullError, StreamError
            If the system refuses a write; nothing half-written is left.
        """
        save_outputs(self.outputs(pattern, half=half, color_bar=color_bar))

    def save_sheet(self, path: PathLike, columns: int | None = None) -> None:
        """Write a contact sheet: all pictures side by side in one PNG.

        Parameters
        ----------
        path : path-like
            A ``.png``.
        columns : int, optional
            Pictures in a row, up to 65536; by default about as many as there are rows.

        Raises
        ------
        SettingError, DiskFullError, StreamError
            As of `Image.save`.
        """
        save_outputs([self.sheet(path, columns)])

    def save_animation(self, path: PathLike, seconds: float = SECONDS) -> None:
        """Write the pictures one after another into one file, which begins again at its end.

        Parameters
        ----------
        path : path-like
            A ``.png`` (animated PNG), or a ``.gif``, which needs Pillow (``bfrt[animation]``).
        seconds : float
            That each picture is seen, 0.01 to 60.

        Raises
        ------
        SettingError, DiskFullError, StreamError
            As of `Image.save`; if Pillow is needed and missing.
        """
        save_outputs([self.animation(path, seconds)])

    def outputs(
        self, pattern: PathLike, *, half: bool = False, color_bar: ColorScale | None = None
    ) -> list[Output]:
        """Return the files that `save` writes."""
        self._check()
        check_suffix(pattern, half=half)
        return [
            Output(path, partial(image.save, half=half, color_bar=color_bar))
            for path, image in zip(numbered(pattern, len(self)), self, strict=True)
        ]

    def sheet(self, path: PathLike, columns: int | None = None) -> Output:
        """Return the file that `save_sheet` writes."""
        self._check()
        check_sheet(path)
        if columns is None:
            columns = math.ceil(math.sqrt(len(self)))
        most = min(MOST_COLUMNS, MOST_WIDTH // self[0].width)
        wide = at_least_one("columns", columns, most)
        return Output(os.fspath(path), lambda file: write_sheet(file, self, wide))

    def animation(self, path: PathLike, seconds: float = SECONDS) -> Output:
        """Return the file that `save_animation` writes."""
        self._check()
        check_animation(path)
        shown = number_of(seconds)
        if not 0.01 <= shown <= 60.0:
            raise SettingError(f"seconds: found {seconds!r:.40}, expected 0.01 to 60")
        return Output(os.fspath(path), lambda file: write_animation(file, self, shown))

    def _check(self) -> None:
        if not self or {image.shape for image in self} != {self[0].shape}:
            raise SettingError("images: found none, or several sizes, expected some of one size")


def save_outputs(outputs: Sequence[Output]) -> None:
    """Write files, all or none.

    Raises
    ------
    SettingError
        If one of them could not be written, or two are the same.
    DiskFullError, StreamError
        If the system refuses a write; nothing half-written is left.
    """
    for output in outputs:
        check_file(output.path)
    check_apart(*(output.path for output in outputs))
    with staged_paths([output.path for output in outputs]) as staged:
        for output, path in zip(outputs, staged, strict=True):
            try:
                with in_memory(f"{output.path}: saving"):
                    output.write(path)
            except StreamError as error:
                raise error.about(output.path) from error
