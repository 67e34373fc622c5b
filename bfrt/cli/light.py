"""Options of the light, and the settings that they ask for."""

from __future__ import annotations

import argparse
from typing import Any

from bfrt.cli.options import Once
from bfrt.errors import SceneError, SettingError
from bfrt.store.sun import Sun


def add_light(made: argparse.ArgumentParser) -> None:
    """Add the options that say what lights a picture."""
    made.add_argument(
        "--sun", type=float, nargs=2, action=Once, metavar=("AZIMUTH", "ELEVATION"),
        help="a sun in place of all lights, in degrees: clockwise from north, +y, and above the "
        "horizon; z is up",
    )  # fmt: skip
    made.add_argument(
        "--ambient", type=float, metavar="A",
        help="intensity of the ambient light (default: that of each light)",
    )  # fmt: skip
    made.add_argument(
        "--ao", type=int, default=0, metavar="N",
        help="ambient occlusion: rays from each hit that find out what is open (0: none)",
    )  # fmt: skip
    made.add_argument(
        "--ao-distance", type=float, metavar="D", help="how far they go (default: through all)"
    )
    made.add_argument(
        "--background", type=float, nargs=3, metavar=("R", "G", "B"),
        help="color of rays that meet nothing (default: the scene's)",
    )  # fmt: skip


def light_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of the light, as keywords of `bfrt.render`."""
    try:
        lights = None if options.sun is None else [Sun(*options.sun)]
    except SceneError as error:
        raise SettingError(f"--sun: {error}") from None
    return {
        "lights": lights,
        "ambient": options.ambient,
        "ao": options.ao,
        "ao_distance": options.ao_distance,
        "background": options.background,
    }
