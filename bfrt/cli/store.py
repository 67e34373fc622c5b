"""Commands about what is there: ``bfrt info`` of a store or a scene file, and ``bfrt verify``."""

from __future__ import annotations

import argparse
import json
from typing import Any

from bfrt.cli.options import command
from bfrt.conversion.contents import describe_file, is_scene_file
from bfrt.conversion.sources import is_store
from bfrt.errors import escaped
from bfrt.formats.source import printable
from bfrt.scene import open_scene
from bfrt.shards.store import open_any
from bfrt.store.store import Store, bounds_to
from bfrt.store.stream import Stream


def add_info(commands: Any) -> None:
    about = "Show what a scene store holds, or what is in a file and which option takes it."
    made = command(commands, "info", run_info, about)
    made.add_argument("store", metavar="PATH", help="a store, or a file to convert")
    made.add_argument("--json", action="store_true", help="the same as JSON")


def run_info(options: argparse.Namespace) -> None:
    is_file = not is_store(options.store) and is_scene_file(options.store)
    facts = describe_file(options.store) if is_file else describe(open_any(options.store))
    if options.json:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        if key == "streams":
            for stream in value:
                print("  ".join(f"{k} {v}" for k, v in stream.items()))
        elif key == "contents":
            print("\n".join(lines_of(value)))
        else:
            print(f"{key}: {escaped(str(value))}")


def lines_of(contents: list[dict[str, Any]]) -> list[str]:
    """Return the parts of a file as lines of a table: name, rows, type and use."""
    rows = [
        (printable(row["name"]), " x ".join(map(str, row["shape"])), row["dtype"], row["use"])
        for row in contents
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    return ["  ".join(map(str.ljust, row, [*widths, 0])).rstrip() for row in rows]


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
        "crs": store.crs or None,
        "colors": [scale._asdict() for scale in store.colors] or None,
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
                "order": "spatial" if stream.ordered else "given",
                "treelets": stream.treelets,
                "nodes_bytes": bytes_of(stream, "nodes"),
                "ids_bytes": bytes_of(stream, "ids"),
                "bytes": sum(facts.bytes for facts in stream.files.values()),
            }
            for stream in store.streams
        ],
    }


def bytes_of(stream: Stream, name: str) -> int:
    """Return the bytes of one of a stream's files; 0 where it has none."""
    facts = stream.files.get(name)
    return 0 if facts is None else facts.bytes


def size_of(store: Store) -> str:
    """Return in words the store, its objects, and its bytes as `describe` counts them."""
    return f"{store.path}: {store.objects:,} objects, {store.bytes:,} bytes"


def add_verify(commands: Any) -> None:
    made = command(commands, "verify", run_verify, "Read a whole store and check its checksums.")
    made.add_argument("store")


def run_verify(options: argparse.Namespace) -> None:
    scene = open_scene(options.store)
    scene.verify()
    if not options.quiet:
        print(f"{size_of(scene.store)}, all as written")
