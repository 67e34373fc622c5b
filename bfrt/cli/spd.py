"""The command ``bfrt spd``: a standard scene as a store, as NFF text, or as both."""

from __future__ import annotations

import argparse
import errno
import sys
from typing import Any

import bfrt
from bfrt.cli.bars import bars
from bfrt.cli.options import Once, add_hierarchy, add_order, command, hierarchy_of
from bfrt.cli.store import size_of
from bfrt.conversion.sources import parse_spd
from bfrt.errors import SettingError, StreamError
from bfrt.paths import check_apart, check_file, check_folder
from bfrt.process import say
from bfrt.refusals import calling
from bfrt.settings import at_least_one
from bfrt.spd.mount import HASHES
from bfrt.store.writer import check_new_store
from bfrt.streams.atomic_write import atomic_path


def add_spd(commands: Any) -> None:
    names = ", ".join(bfrt.spd.NAMES)
    made = command(commands, "spd", run_spd, "Make a standard scene of any size.")
    made.add_argument("name", help=names)
    made.add_argument("size", help="the size factor, 1 or more")
    made.add_argument("-o", "--output", action=Once, metavar="DIR", help="the store to make")
    made.add_argument(
        "--nff", action=Once, metavar="FILE", help="write NFF text (- for standard output)"
    )
    made.add_argument(
        "--hash", choices=HASHES, help="mount's noise: the package's first (default), or the better"
    )
    made.add_argument("--memory", help="budget of the whole process (default: a quarter)")
    made.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    add_order(made, "given")
    add_hierarchy(made)


def run_spd(options: argparse.Namespace) -> None:
    if options.output is None and options.nff is None:
        raise SettingError("spd: nothing to make: expected -o DIR, --nff FILE or both")
    scene = parse_spd(f"spd:{options.name}:{options.size}", hash=options.hash)
    threads = None if options.threads is None else at_least_one("threads", options.threads)
    hierarchy = hierarchy_of(options, scene.hierarchy)
    check_outputs(options)
    if options.nff == "-":
        if sys.stdout is None:
            raise StreamError("<stdout>", 0, errno.EBADF, "opening")
        scene.write_nff(sys.stdout, threads=threads)
    elif options.nff is not None:
        with (
            atomic_path(options.nff) as path,
            calling(options.nff, "writing"),
            path.open("w") as file,
            bars("text", options.quiet) as progress,
        ):
            scene.write_nff(file, threads=threads, progress=progress)
    if options.output is not None:
        with bars("store", options.quiet) as progress:
            made = scene.write(
                options.output,
                hierarchy=hierarchy,
                order=options.order,
                memory=options.memory,
                threads=threads,
                progress=progress,
            )
        if not options.quiet:
            say(size_of(made.store))


def check_outputs(options: argparse.Namespace) -> None:
    """Refuse before the work what could not be written after it."""
    text = [] if options.nff in (None, "-") else [options.nff]
    for file in text:
        check_file(file)
    if options.output is not None:
        target = check_new_store(options.output)
        check_folder("spd", target.parent, ())
        check_apart(options.output, *text)
