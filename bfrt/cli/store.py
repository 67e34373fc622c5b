"""Commands about a store that is there: ``bfrt info`` and ``bfrt verify``."""

from __future__ import annotations

import argparse
import json
from typing import Any

from bfrt.cli.options import command
from bfrt.scene import open_scene
from bfrt.shards.store import open_any
from bfrt.store.store import Store, bounds_to
from bfrt.store.stream import Stream


def add_info(commands: Any) -> None:
    made = command(commands, "info", run_info, "Show what a scene store holds.")
    made.add_argument("store")
    made.add_argument("--json", action="store_true", help="the same as JSON")


def run_info(options: argparse.Namespace) -> None:
    facts = describe(open_any(options.store))
    if options.json:
        print(json.dumps(facts, indent=1))
        return
    for key, value in facts.items():
        if key == "streams":
            for stream in value:
                print("  ".join(f"{k} {v}" for k, v in stream.items()))
        else:
            print(f"{key}: {value}")


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
