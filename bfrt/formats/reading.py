"""The settings of a conversion, and which files use them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from numbers import Real
from pathlib import Path
from typing import Any

from bfrt.errors import SettingError

#: `color_by` of colors that a file has itself, not of numbers that a map makes colors of.
RGB = "rgb"

#: The columns that such colors are in, of formats that have columns.
COLORS = ("red", "green", "blue")

#: Settings that whatever may be painted knows, and those of points.
PAINTED = ("color_by", "colormap", "color_range", "skip_invalid")
POINTS = ("radius", *PAINTED)


#: Settings that every file uses.
ALWAYS = ("room", "scratch", "uses")

#: Files of a call that an error names.
NAMED = 3


@dataclass
class Uses:
    """Notes which settings the files of one call use.

    Parameters
    ----------
    files : int
        Number of files in the call.
    """

    files: int = 1
    names: list[str] = field(default_factory=list)
    known: set[str] = field(default_factory=set)

    def add(self, name: str, known: tuple[str, ...]) -> bool:
        """Add a file and the settings that it uses; return whether it was the last."""
        self.names.append(name)
        self.known.update(known)
        return len(self.names) >= self.files

    def __str__(self) -> str:
        more = len(self.names) - NAMED
        return ", ".join(self.names[:NAMED]) + (f" and {more} more" if more > 0 else "")


@dataclass(frozen=True)
class Reading:
    """Holds the settings of a conversion that some formats use.

    Parameters
    ----------
    radius : float or str, optional
        The radius of all points, in the file's units, or the name of a column with one for each.
    positions : str, optional
        Name of the column, array or dataset that has the points' positions.
    color_by : str, optional
        Name of a column whose numbers a map makes colors of, or "rgb" for a file's own colors.
    colormap : str, optional
        The map: "cubehelix" or "gray", or the name of one of matplotlib's.
    color_range : (float, float), optional
        The numbers that get the map's first and last color; by default the column's least and
        greatest, which costs a pass over it.
    frame : int, optional
        The frame of several, from 0, or from -1 back; the last by default.
    skip_invalid : bool
        Drop and count objects that are not finite, instead of refusing them.
    triangulate, polygons : bool
        Store all faces of four and more corners as triangles, or as polygons; by default those that
        are flat are polygons.
    smooth : bool
        Make patches of faces whose corners have normals.
    external_storage : bool
        Follow the external storage of HDF5 datasets, whose rows may be in any file.
    room : int
        Bytes that a mesh's vertices may take; those of one that has more are joined on disk.
    scratch : Path
        Folder for what does not fit.
    uses : Uses
        The settings that the other files of a call use.

    Raises
    ------
    SettingError
        For a radius that is not above 0, a radius or a range that is not finite, a range whose
        ends are not in order, a frame that is no whole number, and settings that exclude each
        other.
    """

    radius: float | str | None = None
    positions: str | None = None
    color_by: str | None = None
    colormap: str | None = None
    color_range: tuple[float, float] | None = None
    frame: int | None = None
    skip_invalid: bool = False
    triangulate: bool = False
    polygons: bool = False
    smooth: bool = False
    external_storage: bool = False
    room: int = 1 << 27
    scratch: Path = Path()
    uses: Uses = field(default_factory=Uses, compare=False)

    def __post_init__(self) -> None:
        if self.radius is not None and not isinstance(self.radius, str):
            check_radius(self.radius)
        check_frame(self.frame)
        for other in ("triangulate", "smooth"):
            if getattr(self, other) and self.polygons:
                raise SettingError(f"{other}, polygons: found both, expected one of them or none")
        if self.color_range is None:
            return
        try:
            lo, hi = map(float, self.color_range)
        except (TypeError, ValueError):
            lo = hi = math.nan
        if not -math.inf < lo <= hi < math.inf:
            raise SettingError(
                f"color_range: found {self.color_range!r}, expected two finite numbers, "
                "the lesser first"
            )

    @property
    def settings(self) -> dict[str, Any]:
        """Return what changes how a file is read, for JSON."""
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        settings = {name: value for name, value in own.items() if name not in ALWAYS}
        if isinstance(self.radius, Real):
            settings["radius"] = float(self.radius)
        if self.color_range is not None:
            settings["color_range"] = [float(end) for end in self.color_range]
        return settings

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the names of the columns that colors are made from."""
        if self.color_by is None:
            return ()
        return COLORS if self.color_by == RGB else (self.color_by,)

    def refuse_all_but(self, name: str, *known: str) -> None:
        """Refuse the settings that a file has no use for, unless another of the call has.

        Each file says once what it knows; at the last one it is clear what none knows.

        Raises
        ------
        SettingError
            For the first setting that was given and is not known, or needs another.
        """
        if not self.uses.add(name, known):
            return
        for each in fields(self):
            asked = getattr(self, each.name)
            free = each.name in ALWAYS or each.name in self.uses.known
            if not free and asked is not None and asked is not False:
                kind = f"{Path(name).suffix or name} files" if self.uses.files == 1 else "files"
                raise SettingError(
                    f"{self.uses}: found {each.name}={asked!r}, expected none for {kind} of this "
                    "content"
                )
        if self.color_by is None and (self.colormap is not None or self.color_range is not None):
            raise SettingError(
                "colormap, color_range: found without color_by, expected with it only"
            )


def check_frame(frame: object) -> None:
    """Refuse a frame that is no whole number.

    Raises
    ------
    SettingError
        If it is none.
    """
    if frame is not None and (not isinstance(frame, int) or isinstance(frame, bool)):
        raise SettingError(f"frame: found {frame!r:.80}, expected a whole number, as 0 or -1")


def check_radius(radius: object) -> None:
    """Refuse a radius of points with which none could be seen: a sphere of 0 is never hit.

    Raises
    ------
    SettingError
        If it is not a finite number above 0.
    """
    number = isinstance(radius, Real) and not isinstance(radius, bool)
    if not (number and 0.0 < float(radius) < math.inf):  # type: ignore[arg-type]
        raise SettingError(f"radius: found {radius!r:.80}, expected a finite number above 0")
