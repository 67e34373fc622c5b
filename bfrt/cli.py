"""The command ``bfrt``.

Exit status: 0 for success, 1 for bad input, 2 for wrong use or a refused budget, 130 for an
interrupt.
"""

from __future__ import annotations

import argparse
import json
import logging
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import bfrt
from bfrt.conversion.convert import convert
from bfrt.conversion.sources import READERS, is_store, parse_spd
from bfrt.conversion.views import read_view
from bfrt.errors import BfrtError, BudgetError, SettingError
from bfrt.framing import framing_camera
from bfrt.image.picture import SUFFIXES
from bfrt.planned import Plan
from bfrt.records import ON_REQUEST
from bfrt.scene import Scene, open_scene
from bfrt.settings import FINEST, REFINEMENTS, at_least_one, scratch_folder
from bfrt.spd.mount import HASHES
from bfrt.spd.recipe import SpdScene
from bfrt.store.hierarchy import Hierarchy, parse_hierarchy
from bfrt.store.model import Camera
from bfrt.store.store import Store, bounds_to, open_store
from bfrt.streams.atomic_write import atomic_path
from bfrt.view import aovs_of

BAD_INPUT = 1
WRONG_USE = 2
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    options = parser().parse_args(resolutions_apart(given))
    logging.basicConfig(
        format="bfrt: %(message)s", level=logging.ERROR if options.quiet else logging.WARNING
    )
    try:
        options.run(options)
    except (BudgetError, SettingError) as error:
        return fail(error, WRONG_USE)
    except (BfrtError, OSError) as error:
        return fail(error, BAD_INPUT)
    except KeyboardInterrupt:
        return fail("interrupted", INTERRUPTED)
    return 0


def resolutions_apart(arguments: Sequence[str]) -> list[str]:
    """Split a resolution given as one word, WxH, into the two arguments that the parser expects."""
    apart: list[str] = []
    for argument in arguments:
        option, _, value = argument.rpartition("=")
        asked = option or (apart[-1] if apart else "")
        size = re.fullmatch(r"(\d+)[xX×](\d+)", value)
        if size and len(asked) > 4 and "--resolution".startswith(asked):
            apart += [*filter(None, [option]), *size.groups()]
        else:
            apart.append(argument)
    return apart


def fail(error: object, status: int) -> int:
    """Print an error in one line."""
    print(f"bfrt: {error}", file=sys.stderr)
    return status


def parser() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    top = argparse.ArgumentParser(
        prog="bfrt",
        description="Ray trace scenes larger than memory, out of core, inside a memory budget.",
    )
    top.add_argument("--version", action="version", version=f"bfrt {bfrt.__version__}")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    add_convert(commands)
    add_render(commands)
    add_spd(commands)
    add_info(commands)
    add_verify(commands)
    return top


def command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], None], about: str
) -> argparse.ArgumentParser:
    """Add a command with the options that all commands have."""
    made: argparse.ArgumentParser = commands.add_parser(name, help=about, description=about)
    made.add_argument("--quiet", action="store_true", help="no progress bar and no warnings")
    made.set_defaults(run=run)
    return made


def add_convert(commands: Any) -> None:
    made = command(commands, "convert", run_convert, "Stream a scene file into a scene store.")
    made.add_argument(
        "input", nargs="+",
        help=f"a file ({' '.join(READERS)}), - for NFF from standard input, or spd:NAME:SIZE; "
        "of several, each is a group",
    )  # fmt: skip
    made.add_argument("-o", "--output", required=True, help="the store to make (X.bfrt)")
    made.add_argument("--memory", help="budget of the whole process (default: a quarter)")
    made.add_argument("--scratch", metavar="DIR", help="folder for what does not fit in memory")
    add_hierarchy(made)
    add_reading(made)


def add_render(commands: Any) -> None:
    made = command(commands, "render", run_render, "Render a scene inside a memory budget.")
    made.add_argument(
        "input", help="a scene store, or what convert takes, converted before and removed after"
    )
    made.add_argument(
        "-o", "--output", action="append", default=[], metavar="FILE",
        help="picture to write: .exr, .png or .npy; may be repeated",
    )  # fmt: skip
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
    made.add_argument(
        "--resolution", type=int, nargs=2, metavar=("W", "H"), help="in pixels; or as WxH"
    )
    made.add_argument(
        "--view", metavar="FILE|NAME",
        help=f"take the view (v) of this NFF file, or one of: {', '.join(bfrt.spd.VIEWS)}",
    )  # fmt: skip
    vector: dict[str, Any] = {"type": float, "nargs": 3, "metavar": ("X", "Y", "Z")}
    made.add_argument("--from", dest="eye", help="where the eye is", **vector)
    made.add_argument("--at", help="what it looks at", **vector)
    made.add_argument("--up", help="which way is up", **vector)
    made.add_argument("--angle", type=float, help="degrees from bottom to top")
    made.add_argument(
        "--refine", choices=REFINEMENTS, default=FINEST,
        help="the paper's refinements: base none, sg lazy geometry, sgb the hierarchy too (sgb)",
    )  # fmt: skip
    made.add_argument(
        "--plan", action="store_true",
        help="only print an estimate of passes, bytes, disk and seconds; nothing is written",
    )  # fmt: skip
    made.add_argument("--half", action="store_true", help="16-bit colors in the EXR")
    made.add_argument("--stats", metavar="FILE", help="write counters as JSON")
    made.add_argument("--table", action="store_true", help="print counters as a table")
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


def add_reading(made: argparse.ArgumentParser) -> None:
    """Add the options that say how to read files of points and meshes."""
    group = made.add_argument_group("reading files of meshes and points")
    group.add_argument(
        "--dtype", choices=("float32", "float64"), help="of coordinates (default: the file's own)"
    )
    group.add_argument(
        "--radius", type=number_or_name, metavar="R|NAME",
        help="of points: in the file's units, or the name of what has each one's",
    )  # fmt: skip
    group.add_argument(
        "--positions", metavar="NAME", help="the array of points, or a group with x, y and z"
    )
    group.add_argument(
        "--color-by", metavar="NAME",
        help="numbers that a map makes colors of, or rgb for the file's own colors",
    )  # fmt: skip
    group.add_argument("--colormap", metavar="NAME", help="cubehelix, gray, or one of matplotlib's")
    group.add_argument(
        "--color-range", type=float, nargs=2, metavar=("LO", "HI"),
        help="numbers of the map's ends (default: the least and the greatest, by another pass)",
    )  # fmt: skip
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


def number_or_name(text: str) -> float | str:
    """Return a number where the text is one, else the text as a name."""
    try:
        return float(text)
    except ValueError:
        return text


#: Settings of `convert` that the command line names as it does.
READING = (
    "dtype", "radius", "positions", "color_by", "colormap", "color_range", "skip_invalid",
    "triangulate", "polygons",
)  # fmt: skip


def reading_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the reader's settings that the command line gives, as keywords of `bfrt.convert`."""
    given = {name: getattr(options, name) for name in (*READING, "memory", "scratch")}
    return {name: value for name, value in given.items() if value is not None}


def add_spd(commands: Any) -> None:
    names = ", ".join(bfrt.spd.NAMES)
    made = command(commands, "spd", run_spd, "Make a standard scene of any size.")
    made.add_argument("name", help=names)
    made.add_argument("size", help="the size factor, 1 or more")
    made.add_argument("-o", "--output", metavar="DIR", help="the store to make")
    made.add_argument("--nff", metavar="FILE", help="write NFF text (- for standard output)")
    made.add_argument(
        "--hash", choices=HASHES, help="mount's noise: the package's first (default), or the better"
    )
    made.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    add_hierarchy(made)


def add_hierarchy(made: argparse.ArgumentParser) -> None:
    made.add_argument(
        "--hierarchy", metavar="SETTINGS",
        help="of the box hierarchy, by the paper's letters, as s=3,n=1000,l=4,t=1; and bits=0 for "
        "no quantised boxes",
    )  # fmt: skip


def add_info(commands: Any) -> None:
    made = command(commands, "info", run_info, "Show what a scene store holds.")
    made.add_argument("store")
    made.add_argument("--json", action="store_true", help="the same as JSON")


def add_verify(commands: Any) -> None:
    made = command(commands, "verify", run_verify, "Read a whole store and check its checksums.")
    made.add_argument("store")


def run_convert(options: argparse.Namespace) -> None:
    with reading_bar(*options.input, quiet=options.quiet) as progress:
        convert(
            options.input,
            options.output,
            hierarchy=hierarchy_of(options),
            progress=progress,
            **reading_of(options),
        )


def run_render(options: argparse.Namespace) -> None:
    check_outputs(options.output, aovs_of(options.aov))
    if options.plan:
        print(plan_asked(options))
        return
    if not options.output:
        raise SettingError("render: nothing to write: expected -o FILE, or --plan")
    with opened(options) as scene:
        image = scene.render(progress=wants_bar(options.quiet), **settings_of(options, scene))
    for output in options.output:
        image.save(output, half=options.half and output.lower().endswith(".exr"))
    assert image.stats is not None
    if options.stats:
        Path(options.stats).write_text(json.dumps(image.stats.as_dict(), indent=1) + "\n")
    if options.table:
        print(image.stats.table())


def plan_asked(options: argparse.Namespace) -> Plan:
    """Return the plan of a render; refuse an input that is no store: converting one is work."""
    if not is_store(options.input):
        raise SettingError(
            f"{options.input}: found no scene store to plan for: expected one that bfrt convert "
            "or bfrt spd has made"
        )
    scene = open_scene(options.input)
    return scene.plan(**settings_of(options, scene))


def settings_of(options: argparse.Namespace, scene: Scene) -> dict[str, Any]:
    """Return the settings that a render and its plan have in common, as keywords."""
    return {
        "memory": options.memory,
        "threads": options.threads,
        "camera": camera_of(options, scene.store),
        "samples": options.samples,
        "depth": options.depth,
        "aovs": options.aov,
        "refine": options.refine,
        "fresh_marks": options.fresh_marks,
        "grid": options.grid,
        "max_grid": options.max_grid,
        "scratch": options.scratch,
    }


def run_spd(options: argparse.Namespace) -> None:
    if options.output is None and options.nff is None:
        raise SettingError("spd: nothing to make: expected -o DIR, --nff FILE or both")
    scene = parse_spd(f"spd:{options.name}:{options.size}", hash=options.hash)
    threads = None if options.threads is None else at_least_one("threads", options.threads)
    if options.nff == "-":
        scene.write_nff(sys.stdout, threads=threads)
    elif options.nff is not None:
        with (
            atomic_path(options.nff) as path,
            path.open("w") as file,
            making_bar(scene, "text", options.quiet) as progress,
        ):
            scene.write_nff(file, threads=threads, progress=progress)
    if options.output is not None:
        if not options.quiet:
            print(
                f"{options.output}: {scene.objects:,} objects, {scene.store_bytes:,} bytes",
                file=sys.stderr,
            )
        with making_bar(scene, "store", options.quiet) as progress:
            scene.write(
                options.output,
                hierarchy=hierarchy_of(options, scene.hierarchy),
                threads=threads,
                progress=progress,
            )


def hierarchy_of(options: argparse.Namespace, default: Hierarchy | None = None) -> Hierarchy | None:
    """Return the hierarchy settings that the command line gives, or None."""
    return None if options.hierarchy is None else parse_hierarchy(options.hierarchy, default)


def run_info(options: argparse.Namespace) -> None:
    facts = describe(open_store(options.store))
    if options.json:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        if key == "streams":
            for stream in value:
                print("  ".join(f"{k} {v}" for k, v in stream.items()))
        else:
            print(f"{key}: {value}")


def run_verify(options: argparse.Namespace) -> None:
    store = open_store(options.store)
    store.verify()
    if not options.quiet:
        print(f"{store.path}: {store.objects} objects, {store.bytes} bytes, all as written")


def describe(store: Store) -> dict[str, Any]:
    """Return what ``info`` shows of a store, ready for JSON."""
    camera = store.camera
    return {
        "store": str(store.path),
        "objects": store.objects,
        "bytes": store.bytes,
        "bytes_per_object": round(store.bytes / max(store.objects, 1), 2),
        "origin": list(store.origin),
        "bounds": bounds_to(store.world_bounds),
        "camera": None if camera is None else camera.__dict__,
        "lights": len(store.lights),
        "materials": len(store.materials()),
        "outliers": sum(len(group.outliers) for group in store.groups),
        "streams": [
            {
                "group": stream.group,
                "kind": stream.kind.label,
                "objects": stream.count,
                "degenerate": stream.degenerate,
                "levels": list(stream.levels),
                "dtype": "float64" if stream.wide else "float32",
                "bytes": sum(facts.bytes for facts in stream.files.values()),
            }
            for stream in store.streams
        ],
    }


def check_outputs(outputs: list[str], aovs: tuple[str, ...]) -> None:
    """Refuse a suffix, or channels that no output would keep, before the work, not after it."""
    for output in outputs:
        if Path(output).suffix.lower() not in SUFFIXES:
            raise SettingError(
                f"{output}: found suffix {Path(output).suffix!r}, expected {', '.join(SUFFIXES)}"
            )
    if aovs and not any(output.lower().endswith(".exr") for output in outputs):
        raise SettingError(f"--aov: found outputs {', '.join(outputs)}, expected an .exr for it")


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
    folder = scratch_folder(options.scratch, Path(options.output[0]))
    temporary = Path(tempfile.mkdtemp(prefix="bfrt-", dir=folder))
    try:
        with reading_bar(options.input, quiet=options.quiet) as progress:
            name = Path(options.input.replace(":", "-")).stem or "scene"
            scene = convert(
                options.input,
                temporary / f"{name}.bfrt",
                progress=progress,
                durable=False,
                **reading_of(options),
            )
        yield scene
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def camera_of(options: argparse.Namespace, store: Store) -> Camera:
    """Return the camera to render with: the store's, a named view's, or one that frames the scene,
    with the changes that the command line asks for.
    """
    camera = store.camera if options.view is None else view_of(options.view)
    asked = {
        "eye": options.eye and tuple(options.eye),
        "at": options.at and tuple(options.at),
        "up": options.up and tuple(options.up),
        "angle": options.angle,
        "resolution": options.resolution and tuple(options.resolution),
    }
    changes: dict[str, Any] = {key: value for key, value in asked.items() if value is not None}
    return framing_camera(store, **changes) if camera is None else replace(camera, **changes)


def view_of(name: str) -> Camera:
    """Return the camera of a view of `bfrt.spd.VIEWS`, or of an NFF file."""
    return bfrt.spd.VIEWS[name] if name in bfrt.spd.VIEWS else read_view(name)


def wants_bar(quiet: bool) -> bool:
    """Tell whether to show a progress bar: on a terminal, where tqdm is installed."""
    if quiet or not sys.stderr.isatty():
        return False
    try:
        import tqdm  # noqa: F401
    except ImportError:
        return False
    return True


@contextmanager
def reading_bar(*sources: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter of the bytes read from input files, shown as a bar."""
    total = sum(path.stat().st_size for path in map(Path, sources) if path.is_file())
    with bar(total, "B", "convert", quiet or not total) as progress:
        yield progress


@contextmanager
def making_bar(scene: SpdScene, what: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter of the objects made of a scene, shown as a bar with their rate."""
    with bar(scene.objects, " objects", what, quiet) as progress:
        yield progress


@contextmanager
def bar(total: int, unit: str, what: str, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Yield a reporter that a bar shows, or None where no bar is wanted."""
    if not wants_bar(quiet):
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, unit_scale=True, desc=what) as shown:
        yield lambda done: shown.update(done - shown.n) and None
