"""Options that several commands have, and the settings that they stand for."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from typing import Any, get_args

from bfrt.errors import SettingError
from bfrt.store.hierarchy import Hierarchy, parse_hierarchy
from bfrt.store.making import Order

#: Settings of a conversion, which files use and stores have no use for.
READING = (
    "dtype", "radius", "positions", "color_by", "colormap", "color_range", "color_log",
    "column_names", "frame", "opacity", "skip_invalid", "triangulate", "polygons", "smooth",
    "external_storage", "band", "height_scale", "curvature", "floor",
)  # fmt: skip


class Once(argparse.Action):
    """Stores an option's value, and refuses a second one, which would replace the first."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        before = getattr(namespace, self.dest)
        if before is not None:
            raise argparse.ArgumentError(self, f"found {before!r} and {values!r}, expected it once")
        setattr(namespace, self.dest, values)


def command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], None], about: str
) -> argparse.ArgumentParser:
    """Add a command with the options that all commands have."""
    made: argparse.ArgumentParser = commands.add_parser(name, help=about, description=about)
    made.add_argument("--quiet", action="store_true", help="no progress bar and no warnings")
    made.set_defaults(run=run)
    return made


def add_reading(made: argparse.ArgumentParser) -> None:
    """Add the options that say how to read files of points and meshes."""
    group = made.add_argument_group("reading files of meshes and points")
    group.add_argument(
        "--dtype", choices=("float32", "float64"), help="of coordinates (default: the file's own)"
    )
    group.add_argument(
        "--radius", type=number_or_name, metavar="R|NAME|auto",
        help="of points: in the file's units, the name of what has each one's, auto for their "
        "spacing, or by type, as 1=0.5,2=0.8",
    )  # fmt: skip
    group.add_argument(
        "--positions", metavar="NAME", help="the array of points, or a group with x, y and z"
    )
    group.add_argument(
        "--color-by", metavar="NAME",
        help="numbers that a map makes colors of, or rgb for the file's own colors",
    )  # fmt: skip
    group.add_argument(
        "--colormap", metavar="NAME", help="viridis, cubehelix, gray, or one of matplotlib's"
    )
    group.add_argument(
        "--color-range", type=number_or_name, nargs=2, metavar=("LO", "HI"),
        help="numbers of the map's ends, or percentiles, as 2%% 98%% (default: the least and the "
        "greatest, by another pass)",
    )  # fmt: skip
    group.add_argument(
        "--color-log", "--log", action="store_true", help="equal ratios of numbers are equal steps"
    )
    group.add_argument(
        "--column-names", metavar="NAMES",
        help="of points of text, as x,y,z,-,radius; - for a column that is not wanted",
    )  # fmt: skip
    group.add_argument("--frame", type=int, metavar="N", help="from 0, or from -1 back, the last")
    group.add_argument(
        "--opacity", type=float, metavar="T", help="of Gaussian splats: those as opaque, 0 to 1"
    )
    group.add_argument(
        "--skip-invalid",
        action="store_true",
        help="drop objects that are not finite "
        "and faces of fewer than three corners, and say how many",
    )
    corners = group.add_mutually_exclusive_group()
    corners.add_argument(
        "--triangulate", action="store_true",
        help="make triangles of all faces of more corners (default: of those that are not flat)",
    )  # fmt: skip
    corners.add_argument(
        "--polygons", action="store_true", help="keep all faces of more corners as polygons"
    )
    group.add_argument(
        "--smooth", action="store_true",
        help="shade by the file's normals: faces whose corners have them become patches",
    )  # fmt: skip
    group.add_argument(
        "--external-storage", action="store_true",
        help="follow external storage of HDF5: rows in files of any kind that a dataset names",
    )  # fmt: skip
    add_raster(group)


def add_raster(group: Any) -> None:
    """Add the options that say how to read a raster of heights."""
    group.add_argument("--band", type=int, help="of a raster that has the heights (1)")
    group.add_argument(
        "--height-scale", type=float, metavar="FACTOR",
        help="what heights of a raster are multiplied by, to be in units of x and y",
    )  # fmt: skip
    group.add_argument(
        "--curvature", type=float, metavar="PART",
        help="of the earth, by which a raster's heights are lowered, as gdal_viewshed's -cc",
    )  # fmt: skip
    group.add_argument(
        "--floor", type=float, metavar="Z",
        help="height down to which walls stand around cells that a raster has not",
    )  # fmt: skip


def number_or_name(text: str) -> float | str:
    """Return a number where the text is one, else the text as a name."""
    try:
        return float(text)
    except ValueError:
        return text


def add_order(made: argparse.ArgumentParser, default: str) -> None:
    made.add_argument(
        "--order", choices=get_args(Order), default=default,
        help="in which objects are stored: as they are given, or in spatial order, in treelets, "
        f"for --refine tree; auto is spatial (default: {default})",
    )  # fmt: skip


def add_hierarchy(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--hierarchy", metavar="SETTINGS",
        help="of the box hierarchy, by the paper's letters, as s=3,n=1000,l=4,t=1; and bits=0 for "
        "no quantised boxes",
    )  # fmt: skip


def hierarchy_of(options: argparse.Namespace, default: Hierarchy | None = None) -> Hierarchy | None:
    """Return the hierarchy settings that the command line gives, or None."""
    return None if options.hierarchy is None else parse_hierarchy(options.hierarchy, default)


def add_checkpoint(made: argparse.ArgumentParser, every: float) -> None:
    """Add the options of a checkpoint, which is saved every so many seconds by default."""
    made.add_argument(
        "--checkpoint", metavar="DIR",
        help="folder that keeps the state: the same command goes on from there after a kill",
    )  # fmt: skip
    made.add_argument(
        "--every", type=float, metavar="SECONDS",
        help=f"between two saves of the state, at the least ({every:g})",
    )  # fmt: skip


def check_every(options: argparse.Namespace) -> None:
    """Refuse an interval of no checkpoint."""
    if options.every is not None and options.checkpoint is None:
        raise SettingError(f"--every: found {options.every:g} without --checkpoint, which it is of")


def tell_readings(options: argparse.Namespace) -> None:
    """Have it said on standard error what readers found out, as a radius of points."""
    if not options.quiet:
        logging.getLogger("bfrt.formats").setLevel(logging.INFO)


def tell_checkpoints(options: argparse.Namespace) -> None:
    """Have it said on standard error where work goes on."""
    if not options.quiet:
        logging.getLogger("bfrt.checkpoint").setLevel(logging.INFO)
