"""The command ``bfrt convert``, and the conversion that ``bfrt render`` begins with."""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

from bfrt.cli.bars import bars
from bfrt.cli.options import (
    Once,
    add_checkpoint,
    add_hierarchy,
    add_order,
    add_reading,
    check_every,
    command,
    hierarchy_of,
    tell_checkpoints,
    tell_readings,
)
from bfrt.conversion.convert import convert
from bfrt.conversion.kept import EVERY
from bfrt.conversion.sources import READERS
from bfrt.scene import PathLike, Scene
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order


class Kept(NamedTuple):
    """Says where a conversion keeps its state, and after how many seconds at the least."""

    folder: str
    every: float


class Wanted(NamedTuple):
    """Says what store, or sharded scene, is wanted.

    Attributes
    ----------
    hierarchy : Hierarchy, optional
    order : {"given", "spatial", "auto"}
    shards : int, optional
        Stores of a sharded scene.
    kept : Kept, optional
    durable : bool
        Whether it outlives a loss of power.
    """

    hierarchy: Hierarchy | None = None
    order: Order = "auto"
    shards: int | None = None
    kept: Kept | None = None
    durable: bool = True


def add_convert(commands: Any) -> None:
    made = command(commands, "convert", run_convert, "Stream a scene file into a scene store.")
    made.add_argument(
        "input", nargs="+",
        help=f"a file ({' '.join(READERS)}), - for NFF from standard input, or spd:NAME:SIZE; "
        "of several, each is a group",
    )  # fmt: skip
    made.add_argument(
        "-o", "--output", action=Once, required=True,
        help="the store to make (X.bfrt), or the sharded scene (X.bfrts): a store for each input",
    )  # fmt: skip
    made.add_argument("--memory", help="budget of the whole process (default: a quarter)")
    made.add_argument("--scratch", metavar="DIR", help="folder for what does not fit in memory")
    made.add_argument(
        "--shards", type=int, metavar="N", help="stores of a sharded scene (default: one an input)"
    )
    add_order(made, "auto")
    add_hierarchy(made)
    add_reading(made)
    add_checkpoint(made, EVERY)


def run_convert(options: argparse.Namespace) -> None:
    check_every(options)
    tell_checkpoints(options)
    kept = None
    if options.checkpoint is not None:
        kept = Kept(options.checkpoint, EVERY if options.every is None else options.every)
    wanted = Wanted(hierarchy_of(options), options.order, options.shards, kept)
    convert_input(options, options.output, wanted)


def convert_input(options: argparse.Namespace, target: PathLike, wanted: Wanted) -> Scene:
    """Convert what the command line names as input, with its settings, under a progress bar."""
    tell_readings(options)
    kept = wanted.kept
    sources = [options.input] if isinstance(options.input, str) else options.input
    with bars("convert", options.quiet) as progress:
        return convert(
            sources,
            target,
            dtype=options.dtype,
            hierarchy=wanted.hierarchy,
            order=wanted.order,
            memory=options.memory,
            scratch=options.scratch,
            radius=options.radius,
            positions=options.positions,
            color_by=options.color_by,
            colormap=options.colormap,
            color_range=options.color_range,
            color_log=options.color_log,
            column_names=options.column_names,
            frame=options.frame,
            opacity=options.opacity,
            skip_invalid=options.skip_invalid,
            triangulate=options.triangulate,
            polygons=options.polygons,
            smooth=options.smooth,
            external_storage=options.external_storage,
            band=options.band,
            height_scale=options.height_scale,
            curvature=options.curvature,
            floor=options.floor,
            progress=progress,
            durable=wanted.durable,
            checkpoint=None if kept is None else kept.folder,
            every=EVERY if kept is None else kept.every,
            shards=wanted.shards,
        )
