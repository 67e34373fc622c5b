"""The command ``bfrt clean``."""

from __future__ import annotations

import argparse
from typing import Any

from bfrt.cleaning import clean
from bfrt.cli.options import command


def add_clean(commands: Any) -> None:
    about = (
        "Remove what killed runs left in a folder, and voxel marks in the user's cache, and in the "
        "folder as --scratch, whose read-only store is gone or is another by now."
    )
    made = command(commands, "clean", run_clean, about)
    made.add_argument("folder", help="a folder of outputs, stores or spools; or a store")
    made.add_argument("--dry-run", action="store_true", help="only tell what would be removed")


def run_clean(options: argparse.Namespace) -> None:
    found = clean(options.folder, dry_run=options.dry_run)
    if options.quiet:
        return
    for left in found:
        print(f"{left.path}: {left.bytes:,} bytes")
    if not found:
        print(f"{options.folder}: found nothing that a killed run left")
        return
    things = "1 thing" if len(found) == 1 else f"{len(found):,} things"
    removed = "would be removed" if options.dry_run else "removed"
    print(f"{options.folder}: {things}, {sum(left.bytes for left in found):,} bytes {removed}")
