"""The command ``bfrt viewshed``: what is seen of a terrain."""

from __future__ import annotations

import argparse
from typing import Any

from bfrt.cli.bars import bars
from bfrt.cli.options import Once, command
from bfrt.terrain.asked import REFRACTION
from bfrt.terrain.viewshed import viewshed


def add_viewshed(commands: Any) -> None:
    made = command(commands, "viewshed", run_viewshed, "Find what is seen of a terrain.")
    made.add_argument("raster", help="of heights, as a GeoTIFF")
    made.add_argument(
        "-o", "--output", action=Once, required=True, help="the GeoTIFF to make: 255 where seen"
    )
    made.add_argument(
        "--observer", type=float, nargs=2, metavar=("X", "Y"), action="append", required=True,
        help="in the raster's reference system; of several, each gets a band",
    )  # fmt: skip
    made.add_argument(
        "--height", type=float, action="append", metavar="H",
        help="of the eyes above the ground (2); given once, or for each observer",
    )  # fmt: skip
    made.add_argument(
        "--target-height", type=float, default=0.0, metavar="H",
        help="of what is looked at, above the ground (0)",
    )  # fmt: skip
    made.add_argument("--max-distance", type=float, metavar="D", help="how far observers see")
    made.add_argument("--curvature", action="store_true", help="the earth is round")
    made.add_argument(
        "--refraction", type=float, metavar="K",
        help=f"the part of the curvature that the air takes back ({REFRACTION:.4f})",
    )  # fmt: skip
    made.add_argument("--band", type=int, help="that has the heights (1)")
    made.add_argument(
        "--height-scale", type=float, metavar="FACTOR",
        help="what heights are multiplied by, to be in units of x and y",
    )  # fmt: skip
    made.add_argument("--memory", help="budget of all processes (default: a quarter)")
    made.add_argument("--threads", type=int, help="that look (default: all)")
    made.add_argument("--scratch", metavar="DIR", help="folder for what does not fit in memory")


def run_viewshed(options: argparse.Namespace) -> None:
    heights = options.height or [2.0]
    with bars("look", options.quiet) as progress:
        seen = viewshed(
            options.raster,
            options.output,
            options.observer,
            height=heights[0] if len(heights) == 1 else heights,
            target_height=options.target_height,
            max_distance=options.max_distance,
            curvature=options.curvature,
            refraction=options.refraction,
            band=options.band,
            height_scale=options.height_scale,
            memory=options.memory,
            threads=options.threads,
            scratch=options.scratch,
            progress=progress,
        )
    if not options.quiet:
        for (x, y), count in zip(options.observer, seen, strict=True):
            print(f"{x:.12g} {y:.12g}: {count:,} pixels are seen")
