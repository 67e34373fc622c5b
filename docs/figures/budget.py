"""How a budget of 256 MiB is divided for a billion objects, by the code's own numbers.

    python docs/figures/budget.py [FOLDER]

A small store stands for the large one: its streams are told to have a billion objects together, and
what a budget leaves each part is asked of `bfrt.budget`. No object is read.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("agg")
from matplotlib import pyplot

import bfrt
from bfrt.budget import GridCapacities, capacities, fixed_bytes
from bfrt.grid.partition import partition_of
from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import BLOCK_BYTES, VoxelRays
from bfrt.image.frame import FrameSize, held_frame
from bfrt.memory import BASELINE
from bfrt.phases.shading import SHADED_HIT_BYTES
from bfrt.phases.traversal import FEWEST_RAYS, IN_FLIGHT_BYTES
from bfrt.records import HIT_BYTES, QUEUED_BYTES
from bfrt.settings import Settings
from bfrt.store.store import Store, open_store

OBJECTS = 10**9
MEMORY = 256 << 20
FRAME = FrameSize(512, 512, 0)

COLORS = {
    "interpreter and code": "#6d6d6d",
    "read buffers, all that is fixed": "#a3a3a3",
    "frame": "#e0a030",
    "grid: a slab of marks": "#7fb3d5",
    "grid: upper voxels": "#2e6f9e",
    "grid: lower-level blocks": "#1b4f72",
    "rays in flight, their candidates": "#c1272d",
    "hits": "#3f8f3f",
    "two queues of rays": "#8bc08b",
}


def enlarged(store: Store, objects: int) -> Store:
    """A store's header, as if it had so many objects in the same proportions."""
    (group,) = store.groups
    present = sum(stream.count for stream in group.streams)
    streams = [
        replace(stream, count=stream.count * objects // present, degenerate=0)
        for stream in group.streams
    ]
    return replace(store, groups=[replace(group, streams=streams)])


def division(store: Store) -> tuple[dict[str, int], GridCapacities]:
    """The bytes of each part, and how many of each thing there are."""
    settings = Settings.of(memory=MEMORY, threads=2)
    held = capacities(store, settings, FRAME)
    assert isinstance(held, GridCapacities)
    fixed = fixed_bytes(store, settings)
    frame = held_frame(FRAME, MEMORY - fixed, FEWEST_RAYS).bytes
    cut = partition_of(store.groups[0], held.limits)
    blocks = held.blocks if cut.lower_bits else 0
    return {
        "interpreter and code": BASELINE,
        "read buffers, all that is fixed": fixed - BASELINE,
        "frame": frame,
        "grid: a slab of marks": Slabs.bytes(cut.bricks, held.limits.slab),
        "grid: upper voxels": VoxelRays.bytes(cut.uppers, blocks) - blocks * BLOCK_BYTES,
        "grid: lower-level blocks": blocks * BLOCK_BYTES,
        "rays in flight, their candidates": held.rays * IN_FLIGHT_BYTES,
        "hits": held.hits * (SHADED_HIT_BYTES + HIT_BYTES),
        "two queues of rays": held.queue * 2 * QUEUED_BYTES,
    }, held


def draw(parts: dict[str, int], held: GridCapacities, path: Path) -> None:
    """A bar whose parts have their MiB, and a list of what they are."""
    counts = {
        "rays in flight, their candidates": f"{held.rays:,} rays",
        "hits": f"{held.hits:,} hits",
        "two queues of rays": f"{held.queue:,} rays each",
        "grid: lower-level blocks": f"{held.blocks:,} blocks",
        "frame": f"{FRAME.width} x {FRAME.height} pixels",
    }
    figure, axis = pyplot.subplots(figsize=(8.2, 3.4), layout="constrained")
    at = 0.0
    for name, size in parts.items():
        mib = size / 2**20
        said = f"{name}: {mib:.1f} MiB" + (f", {counts[name]}" if name in counts else "")
        axis.barh(0, mib, left=at, height=0.6, color=COLORS[name], edgecolor="white", label=said)
        if mib > 5:
            axis.text(at + mib / 2, 0, f"{mib:.0f}", ha="center", va="center", color="white")
        at += mib
    axis.set(xlim=(0, MEMORY / 2**20), ylim=(-0.4, 0.4), yticks=[], xlabel="MiB")
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.02), ncols=2, frameon=False, fontsize="small"
    )
    figure.savefig(path, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


def main(folder: str = str(Path(__file__).parent)) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "rings.bfrt"
        bfrt.spd.scene("rings", 7).write(path)
        parts, held = division(enlarged(open_store(path), OBJECTS))
    draw(parts, held, Path(folder) / "budget.png")
    for what, size in parts.items():
        print(f"{size / 2**20:8.1f} MiB  {what}")
    print(f"{sum(parts.values()) / 2**20:8.1f} MiB  in all")


if __name__ == "__main__":
    main(*sys.argv[1:])
