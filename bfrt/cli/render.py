"""The command ``bfrt render``: pictures of a store, or of what is converted for it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bfrt.checkpoint.checkpoint import EVERY, Checkpoint
from bfrt.cli.bars import wants_bar
from bfrt.cli.convert import Wanted, convert_input
from bfrt.cli.light import add_light, light_of
from bfrt.cli.options import (
    READING,
    Once,
    add_checkpoint,
    add_reading,
    check_every,
    command,
    tell_checkpoints,
)
from bfrt.cli.view import add_view, cameras_of, first_of, is_of_several
from bfrt.conversion.sources import is_store
from bfrt.errors import SettingError
from bfrt.image.animation import check_animation
from bfrt.image.color_bar import check_bar, check_height
from bfrt.image.color_scale import ColorScale
from bfrt.image.numbered import numbered
from bfrt.image.picture import SUFFIXES, Image
from bfrt.image.pictures import Images, Output, save_outputs
from bfrt.image.sheet import check_sheet
from bfrt.paths import check_apart, check_file
from bfrt.planning.planned import Plan
from bfrt.records import ON_REQUEST
from bfrt.refusals import calling
from bfrt.scene import Scene, open_scene
from bfrt.settings import REFINEMENTS, scratch_folder
from bfrt.streams.atomic_write import atomic_path, temporary_folder
from bfrt.view import aovs_of


def add_render(commands: Any) -> None:
    made = command(commands, "render", run_render, "Render a scene inside a memory budget.")
    made.add_argument(
        "input", help="a scene store, or what convert takes, converted before and removed after"
    )
    made.add_argument(
        "-o", "--output", action="append", default=[], metavar="FILE",
        help="picture to write: .exr, .png or .npy; may be repeated; of several views with a "
        "place for the number, as view-{:03d}.png",
    )  # fmt: skip
    _add_of_several(made)
    made.add_argument(
        "--memory", help="budget of the whole process, as 256MiB or 1GB (default: a quarter)"
    )
    made.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    made.add_argument(
        "--samples", type=int, metavar="N",
        help="stratified samples a pixel (default: one ray at each pixel corner)",
    )  # fmt: skip
    made.add_argument("--depth", type=int, default=5, metavar="N", help="hits along a path (5)")
    made.add_argument(
        "--aov", type=lambda names: tuple(names.split(",")), default=(), metavar="NAMES",
        help="channels that the EXR has too, of: " + ",".join(ON_REQUEST),
    )  # fmt: skip
    add_view(made)
    add_light(made)
    made.add_argument(
        "--refine", choices=REFINEMENTS,
        help="tree: treelets, in spatial order (its default); the paper's refinements, with a "
        "grid: base none, sg lazy geometry, sgb the hierarchy too (the default in other order)",
    )  # fmt: skip
    made.add_argument(
        "--plan", action="store_true",
        help="only print an estimate of passes, bytes, disk and seconds, and of what spatial order "
        "would take; nothing is written",
    )  # fmt: skip
    made.add_argument("--half", action="store_true", help="16-bit colors in the EXR")
    made.add_argument(
        "--color-bar", action="store_true",
        help="beside a PNG, the numbers that colors stand for (needs matplotlib)",
    )  # fmt: skip
    made.add_argument("--stats", action=Once, metavar="FILE", help="write counters as JSON")
    made.add_argument("--table", action="store_true", help="print counters as a table")
    add_checkpoint(made, EVERY)
    made.add_argument("--scratch", metavar="DIR", help="folder for what does not fit in memory")
    made.add_argument(
        "--fresh-marks", action="store_true", help="make the voxel marks of the store again"
    )
    made.add_argument(
        "--grid", type=int, metavar="N", help="voxels on the longest axis, instead of the rule's"
    )
    made.add_argument(
        "--max-grid", type=int, metavar="N", help="voxels on the longest axis at the most"
    )
    add_reading(made)


def _add_of_several(made: argparse.ArgumentParser) -> None:
    """Add the files that show several views."""
    made.add_argument(
        "--contact-sheet", action=Once, metavar="FILE", help="write all views side by side: .png"
    )
    made.add_argument(
        "--animation", action=Once, metavar="FILE",
        help="write all views one after another: .png, or .gif (needs Pillow)",
    )  # fmt: skip


def run_render(options: argparse.Namespace) -> None:
    check_outputs(options, aovs_of(options.aov))
    check_every(options)
    if options.plan:
        print(plan_asked(options))
        return
    if not written(options):
        raise SettingError("render: nothing to write: expected -o FILE, or --plan")
    with kept(options) as checkpoint:
        with opened(options) as scene:
            bar = scale_of(options, scene)
            settings = settings_of(options, scene)
            if bar is not None:
                check_height(first_of(settings["camera"]).resolution[1])
            made = scene.render(
                progress=wants_bar(options.quiet), checkpoint=checkpoint, **settings
            )
        write_outputs(options, made, bar)
        if checkpoint is not None:  # not before all is written
            checkpoint.remove()


def written(options: argparse.Namespace) -> list[str]:
    """Return the pictures that are asked for, of several views those of the first."""
    if not is_of_several(options):
        for flag in ("contact_sheet", "animation"):
            if getattr(options, flag) is not None:
                name = flag.replace("_", "-")
                raise SettingError(f"--{name}: found one view, expected --turntable or --views")
        return list(options.output)
    whole = [options.contact_sheet, options.animation]
    first = [numbered(output, 1)[0] for output in options.output]
    return [*first, *(file for file in whole if file is not None)]


def scale_of(options: argparse.Namespace, scene: Scene) -> ColorScale | None:
    """Return what a scene's colors say, where a bar is asked for that tells it."""
    if not options.color_bar:
        return None
    if len(scene.colors) != 1:
        raise SettingError(
            f"--color-bar: found {len(scene.colors)} ranges of numbers that {options.input} is "
            "colored by, expected one, as convert --color-by makes it"
        )
    return scene.colors[0]


def write_outputs(
    options: argparse.Namespace, made: Image | Images, bar: ColorScale | None
) -> None:
    """Write the pictures and the counters to the files asked for."""
    if isinstance(made, Images):
        save_outputs(outputs_of(options, made, bar))
    else:
        for output in options.output:
            made.save(output, **kept_in(options, output, bar))
    assert made.stats is not None
    if options.stats is not None:
        with atomic_path(options.stats) as path, calling(options.stats, "writing"):
            path.write_text(json.dumps(made.stats.as_dict(), indent=1) + "\n")
    if options.table:
        print(made.stats.table())


def kept_in(options: argparse.Namespace, output: str, bar: ColorScale | None) -> dict[str, Any]:
    """Return what a picture of this suffix is saved with, as keywords."""
    suffix = Path(output).suffix.lower()
    return {
        "half": options.half and suffix == ".exr",
        "color_bar": bar if suffix == ".png" else None,
    }


def outputs_of(options: argparse.Namespace, images: Images, bar: ColorScale | None) -> list[Output]:
    """Return the files that the pictures of several views become, which are all written or none."""
    outputs = []
    for pattern in options.output:
        outputs += images.outputs(pattern, **kept_in(options, pattern, bar))
    if options.contact_sheet is not None:
        outputs.append(images.sheet(options.contact_sheet))
    if options.animation is not None:
        outputs.append(images.animation(options.animation))
    return outputs


@contextmanager
def kept(options: argparse.Namespace) -> Iterator[Checkpoint | None]:
    """Yield the checkpoint asked for, open, which says on standard error where it goes on."""
    if options.checkpoint is None:
        yield None
        return
    tell_checkpoints(options)
    every = EVERY if options.every is None else options.every
    with Checkpoint(options.checkpoint, every) as checkpoint:
        yield checkpoint


def check_outputs(options: argparse.Namespace, aovs: tuple[str, ...]) -> None:
    """Refuse before the work what could not be written after it: a suffix, channels that no output
    would keep, a file in a folder that is not there.
    """
    outputs: list[str] = written(options)
    stats = [] if options.stats is None else [options.stats]
    for output in options.output:
        if Path(output).suffix.lower() not in SUFFIXES:
            raise SettingError(
                f"{output}: found suffix {Path(output).suffix!r}, expected {', '.join(SUFFIXES)}"
            )
    if options.contact_sheet is not None:
        check_sheet(options.contact_sheet)
    if options.animation is not None:
        check_animation(options.animation)
    if options.color_bar:
        named = [output for output in options.output if output.lower().endswith(".png")]
        if not named:
            raise SettingError("--color-bar: found no -o FILE.png, expected one for it")
        check_bar(named[0])
    for flag, asked in (("aov", aovs), ("half", options.half)):
        if asked and not any(output.lower().endswith(".exr") for output in outputs):
            found = ", ".join(outputs)
            raise SettingError(f"--{flag}: found outputs {found}, expected an .exr for it")
    for file in (*outputs, *stats):
        check_file(file)
    kept = [] if options.checkpoint is None else [options.checkpoint]
    check_apart(options.input, *outputs, *stats, *kept)


def plan_asked(options: argparse.Namespace) -> Plan:
    """Return the plan of a render; refuse an input that is no store: converting one is work."""
    if not is_store(options.input):
        raise SettingError(
            f"{options.input}: found no scene store to plan for: expected one that bfrt convert "
            "or bfrt spd has made"
        )
    scene = open_scene(options.input)
    return scene.plan(checkpoint=options.checkpoint, **settings_of(options, scene))


def settings_of(options: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the settings that a render and its plan have in common, as keywords."""
    return {
        "memory": options.memory,
        "threads": options.threads,
        "camera": cameras_of(options, scene.store),
        "samples": options.samples,
        "depth": options.depth,
        "aovs": options.aov,
        **light_of(options),
        "refine": options.refine,
        "fresh_marks": options.fresh_marks,
        "grid": options.grid,
        "max_grid": options.max_grid,
        "scratch": options.scratch,
    }


@contextmanager
def opened(options: argparse.Namespace) -> Iterator[Scene]:
    """Yield the scene to render: the store given, or a file converted in the scratch folder."""
    if is_store(options.input):
        for name in READING:
            asked = getattr(options, name)
            if asked is not None and asked is not False:
                flag = name.replace("_", "-")
                raise SettingError(
                    f"{options.input}: found --{flag}, expected it for a file, not for a store"
                )
        yield open_scene(options.input)
        return
    folder = scratch_folder(options.scratch, Path(written(options)[0]))
    name = Path(options.input.replace(":", "-")).stem or "scene"
    with temporary_folder(folder, name) as temporary:
        yield convert_input(options, temporary / f"{name}.bfrt", Wanted(durable=False))
