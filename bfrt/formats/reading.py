"""The settings of a conversion, and which files use them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from fractions import Fraction
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

from bfrt.errors import SettingError

#: `color_by` of colors that a file has itself, not of numbers that a map makes colors of.
RGB = "rgb"

#: `radius` of points that tell it by their spacing.
AUTO = "auto"

#: What parts a type from its radius, and types.
OF_TYPE, TYPES = "=", ","

#: What is behind a percentile.
PERCENT = "%"

#: The columns that such colors are in, of formats that have columns.
COLORS = ("red", "green", "blue")

#: Settings that whatever may be painted knows, and those of points.
PAINTED = ("color_by", "colormap", "color_range", "color_log", "skip_invalid")
POINTS = ("radius", *PAINTED)

#: Those of rasters.
RASTERS = ("band", "height_scale", "curvature", "floor", *PAINTED)


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


class End(NamedTuple):
    """Says where a map's range ends: at a number, or at a rank of all numbers, as part of them."""

    number: float
    rank: Fraction | None = None

    @classmethod
    def of(cls, asked: float | str) -> End:
        """Return the end that a caller asks for: a number, or a percentile, as "2%"."""
        if isinstance(asked, str) and asked.rstrip().endswith(PERCENT):
            return cls(0.0, Fraction(asked.rstrip().removesuffix(PERCENT)) / 100)
        return cls(float(asked))

    @property
    def sound(self) -> bool:
        """Tell whether it is one: a finite number, or a rank from 0 to 1."""
        return math.isfinite(self.number) if self.rank is None else 0 <= self.rank <= 1


@dataclass(frozen=True)
class Reading:
    """Holds the settings of a conversion that some formats use.

    Parameters
    ----------
    radius : float or str, optional
        The radius of all points, in the file's units, or the name of a column with one for each;
        "auto" for the points' spacing, or radii of types, as "1=0.5,2=0.8".
    positions : str, optional
        Name of the column, array or dataset that has the points' positions.
    color_by : str, optional
        Name of a column whose numbers a map makes colors of, or "rgb" for a file's own colors.
    colormap : str, optional
        The map: "viridis" (the default), "cubehelix" or "gray", or the name of one of matplotlib's.
    color_range : (float or str, float or str), optional
        The numbers that get the map's first and last color, or percentiles, as "2%"; by default the
        column's least and greatest, which costs a pass over it, and a percentile up to four.
    color_log : bool
        Make equal ratios of numbers equal steps of the map; those of 0 and below have no color.
    column_names : str, optional
        Names for the columns of points of text, parted by commas or blanks; - for one of none.
    frame : int, optional
        The frame of several, from 0, or from -1 back; the last by default.
    opacity : float, optional
        Of Gaussian splats those are taken that are as opaque as that, 0 to 1.
    skip_invalid : bool
        Drop and count objects that are not finite, instead of refusing them.
    triangulate, polygons : bool
        Store all faces of four and more corners as triangles, or as polygons; by default those that
        are flat are polygons.
    smooth : bool
        Make patches of faces whose corners have normals.
    external_storage : bool
        Follow the external storage of HDF5 datasets, whose rows may be in any file.
    band : int, optional
        The band of a raster that has the heights, from 1; by default the first.
    height_scale : float, optional
        What heights of a raster are multiplied by, so that they are in units of x and y.
    curvature : float, optional
        The part of the earth's curvature by which a raster's heights are lowered, as GDAL's -cc.
    floor : float, optional
        A height down to which walls stand around missing cells of a raster.
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
        ends are not in order, a frame that is no whole number, an opacity that is not from 0 to 1,
        a band that is no number from 1, a scale of 0, and settings that exclude each other.
    """

    radius: float | str | None = None
    positions: str | None = None
    color_by: str | None = None
    colormap: str | None = None
    color_range: tuple[float | str, float | str] | None = None
    color_log: bool = False
    column_names: str | None = None
    frame: int | None = None
    opacity: float | None = None
    skip_invalid: bool = False
    triangulate: bool = False
    polygons: bool = False
    smooth: bool = False
    external_storage: bool = False
    band: int | None = None
    height_scale: float | None = None
    curvature: float | None = None
    floor: float | None = None
    room: int = 1 << 27
    scratch: Path = Path()
    uses: Uses = field(default_factory=Uses, compare=False)

    def __post_init__(self) -> None:
        if self.radius is not None and not isinstance(self.radius, str):
            check_radius(self.radius)
        for radius in (self.radii or {}).values():
            check_radius(radius)
        check_frame(self.frame)
        check_opacity(self.opacity)
        for other in ("triangulate", "smooth"):
            if getattr(self, other) and self.polygons:
                raise SettingError(f"{other}, polygons: found both, expected one of them or none")
        check_band(self.band)
        check_number("height_scale", self.height_scale)
        check_number("curvature", self.curvature)
        check_number("floor", self.floor)
        if self.height_scale == 0:
            raise SettingError("height_scale: found 0, expected a number that leaves heights")
        _ = self.ends

    @property
    def settings(self) -> dict[str, Any]:
        """Return what changes how a file is read, for JSON."""
        own = {each.name: getattr(self, each.name) for each in fields(self)}
        settings = {name: value for name, value in own.items() if name not in ALWAYS}
        for name in ("radius", "height_scale", "curvature", "floor"):
            if isinstance(settings[name], Real):
                settings[name] = float(settings[name])
        if self.ends is not None:
            settings["color_range"] = [
                end.number if end.rank is None else str(end.rank) for end in self.ends
            ]
        return settings

    @property
    def ends(self) -> tuple[End, End] | None:
        """Return the ends of the map's range, if one is asked for.

        Raises
        ------
        SettingError
            If they are no numbers or percentiles, or not in order as far as that is known.
        """
        if self.color_range is None:
            return None
        try:
            lo, hi = map(End.of, self.color_range)
        except (TypeError, ValueError):
            lo = hi = End(math.nan)
        alike = (lo.rank is None) == (hi.rank is None)
        if not lo.sound or not hi.sound or (alike and lo > hi):
            raise SettingError(
                f"color_range: found {self.color_range!r}, expected two finite numbers, or "
                "percentiles as 2%, the lesser first"
            )
        return lo, hi

    @property
    def radius_column(self) -> str | None:
        """Return the name of the column that has each point's radius, if the setting is one."""
        named = isinstance(self.radius, str) and self.radius != AUTO and self.radii is None
        return str(self.radius) if named else None

    @property
    def radii(self) -> dict[float, float] | None:
        """Return radii by the points' type, if the setting gives such."""
        pairs = [pair.partition(OF_TYPE) for pair in str(self.radius).split(TYPES)]
        try:
            return {float(kind): float(radius) for kind, _, radius in pairs}
        except ValueError:
            return None

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
        if self.uses.add(name, known):
            self.refuse_unused(name)

    def refuse_unused(self, name: str) -> None:
        """Refuse the settings that no file of the call has a use for, the last of which is named.

        Raises
        ------
        SettingError
            For the first setting that was given and is not known, or needs another.
        """
        for each in fields(self):
            asked = getattr(self, each.name)
            free = each.name in ALWAYS or each.name in self.uses.known
            if not free and asked is not None and asked is not False:
                kind = f"{Path(name).suffix or name} files" if self.uses.files == 1 else "files"
                raise SettingError(
                    f"{self.uses}: found {each.name}={asked!r}, expected none for {kind} of this "
                    "content"
                )
        mapped = self.colormap is not None or self.color_range is not None or self.color_log
        if self.color_by is None and mapped:
            raise SettingError(
                "colormap, color_range, color_log: found without color_by, expected with it only"
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


def check_opacity(opacity: object) -> None:
    """Refuse an opacity that none can have.

    Raises
    ------
    SettingError
        If it is not from 0 to 1.
    """
    number = isinstance(opacity, Real) and not isinstance(opacity, bool)
    if opacity is not None and not (number and 0.0 <= float(opacity) <= 1.0):  # type: ignore[arg-type]
        raise SettingError(f"opacity: found {opacity!r:.80}, expected a number from 0 to 1")


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


def check_band(band: object) -> None:
    """Refuse a band that is no whole number from 1.

    Raises
    ------
    SettingError
    """
    whole = isinstance(band, int) and not isinstance(band, bool)
    if band is not None and not (whole and 1 <= band < 1 << 31):  # type: ignore[operator]
        raise SettingError(f"band: found {band!r:.80}, expected a whole number from 1")


def check_number(name: str, value: object) -> None:
    """Refuse what is given and no finite number.

    Raises
    ------
    SettingError
    """
    number = isinstance(value, Real) and not isinstance(value, bool)
    if value is not None and not (number and math.isfinite(value)):  # type: ignore[arg-type]
        raise SettingError(f"{name}: found {value!r:.80}, expected a finite number")
