"""The memory budget: bytes become capacities here, before anything runs.

A budget is a promise about the whole process. What a render needs whatever happens (`BASELINE`,
the film, read buffers, materials) is taken off it, the grid gets its part of the rest, and rays,
candidates, hits and queues share what is left. Nothing grows after that; what does not fit waits
in spools.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bfrt.errors import BudgetError, SettingError
from bfrt.phases.delays import DELAYS_BYTES
from bfrt.phases.partition import LOWER_BITS, Limits, Partition, partition_of
from bfrt.phases.selection import AHEAD, CHOSEN_BYTES, LEVEL_BUFFER
from bfrt.records import (
    AOV_BYTES,
    CANDIDATE_BYTES,
    FILM_BYTES,
    HIT_BYTES,
    MATERIAL_BYTES,
    ON_REQUEST,
    PATH_BYTES,
    QUEUED_BYTES,
    RAY_BITS,
    RAY_BYTES,
    VOXEL_BITS,
)
from bfrt.scene.marks import BRICK_BYTES, MARKS_BUFFER
from bfrt.scene.store import Store

UNITS = {"": 1, "B": 1}
for _power, _letter in enumerate("KMGT", 1):
    UNITS[_letter + "B"] = UNITS[_letter.lower() + "B"] = 1000**_power
    UNITS[_letter + "iB"] = 1024**_power

#: Interpreter, NumPy, OpenEXR, our code and stacks (measured: 44 MiB), and the allocator's slack.
BASELINE = 52 << 20

#: Where Linux says which cgroups this process is in, and what their limits are.
OWN_CGROUPS = Path("/proc/self/cgroup")
CGROUPS = Path("/sys/fs/cgroup")

#: Bytes of one read buffer; a worker has up to five a stream.
READ_BUFFER = 1 << 18

#: A pixel of the finished image: R G B A, Z, N and the two halves of the id, 4 bytes each.
PIXEL_BYTES = 40

#: Bytes that a band of image rows takes while it is written, encoders' copies included.
IMAGE_BAND = 4 << 20

#: An upper voxel: where its rays begin, and a bit of the occupancy, with what is above that.
UPPER_BYTES = 4 + 1 / 8 + 1 / 32

#: A lower-level block: where the rays of 64 voxels begin, a bit for each, whose it is, and twice a
#: place in the table by which it is found.
BLOCK_BYTES = 4 * 64 + 8 + 4 + 2 * 8

#: A brick: where it is, whether it is there, and its part of a cube.
TABLED_BYTES = 4 + 1 + 1 / 8 + 1

#: The fewest rays in flight that are worth a sweep over the objects.
FEWEST_RAYS = 4096

#: A candidate slot each, four of which a ray gets at the least.
CANDIDATES_A_RAY = 4

#: Candidates of a ray that there is room for where rays are few: the longest way through a cube of
#: the most voxels steps to fewer. One that has more takes another pass.
MOST_CANDIDATES = 4 << VOXEL_BITS // 3

#: A hit in the shading phase: itself, its sorted copy, its id and its place in the order.
SHADED_HIT_BYTES = 2 * HIT_BYTES + 16

#: In flight: the ray, what it is for, its place in its slab, what it may still take, and its
#: candidates.
FLYING_BYTES = RAY_BYTES + PATH_BYTES + 4 + 4 + CANDIDATES_A_RAY * CANDIDATE_BYTES

#: Of what a budget leaves, at the most: a slab; upper voxels that are voxels, or larger ones;
#: blocks; before there are rays, a subspace. Of what the grid leaves, rays in flight.
SLAB_PART = 0.15
SINGLE_PART = 0.1
UPPER_PART = 0.4
BLOCK_PART = 0.04
SUBSPACE_PART = 0.7
FLYING_PART = 0.45
GRID_PART = SLAB_PART + UPPER_PART + BLOCK_PART + 0.02

#: Of what is left after what is always needed: a frame that is in memory, or a band of it.
FRAME_PART = 0.5
BAND_PART = 0.15

#: The paper's Ru: 256 upper voxels an axis.
MOST_UPPERS = 1 << 24


def parse_memory(text: str | int) -> int:
    """Bytes of ``"256MiB"``, ``"1.5 GB"`` or a number; MiB is 2^20, MB 10^6.

    Raises
    ------
    SettingError
        If it is not an amount of memory.
    """
    if isinstance(text, (int, np.integer)) and not isinstance(text, bool):
        return int(text)
    match = isinstance(text, str) and re.fullmatch(
        r"\s*([0-9]+(?:\.[0-9]+)?)\s*([A-Za-z]*)\s*", text
    )
    if not match or match[2] not in UNITS:
        raise SettingError(f"memory: found {text!r}, expected an amount such as 256MiB or 1.5GB")
    return int(Fraction(match[1]) * UNITS[match[2]])


def format_memory(amount: int) -> str:
    """An amount as people write it, rounded up to MiB."""
    return f"{-(-amount // (1 << 20))}MiB"


def default_memory() -> int:
    """A quarter of the machine's memory, or of its cgroup's limit where that is less."""
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min([machine, *cgroup_limits()]) // 4


def cgroup_limits() -> list[int]:
    """Memory limits of this process's cgroup and of those above it; none where there are none."""
    groups = OWN_CGROUPS.read_text().splitlines() if OWN_CGROUPS.exists() else []
    limits = []
    for group in groups:
        _, controllers, name = group.split(":", 2)
        if controllers == "":  # version 2
            root, file = CGROUPS, "memory.max"
        elif "memory" in controllers.split(","):
            root, file = CGROUPS / "memory", "memory.limit_in_bytes"
        else:
            continue
        folder = Path(name.lstrip("/"))
        for path in (root / part / file for part in (folder, *folder.parents)):
            if path.exists() and (text := path.read_text().strip()).isdigit():
                limits.append(int(text))
    return limits


@dataclass(frozen=True)
class Capacities:
    """What a budget holds."""

    memory: int
    rows: int
    frame_on_disk: bool
    limits: Limits
    blocks: int
    subspace: int
    rays: int
    candidates: int
    hits: int
    queue: int
    read_buffer: int
    threads: int

    def bands(self, height: int) -> int:
        """Bands of rows in which an image so high is rendered."""
        return -(-height // self.rows)

    def for_rays(self, count: int) -> Capacities:
        """Take no memory that so few rays cannot fill: a page that is touched is a page cleared."""
        rays = min(self.rays, max(count, 1))
        freed = (self.rays - rays) * RAY_BYTES // CANDIDATE_BYTES
        most = rays * MOST_CANDIDATES
        return replace(self, rays=rays, candidates=min(self.candidates + freed, most))

    def for_hits(self, count: int) -> Capacities:
        """Take no memory that so few hits cannot fill, twice over, for half of it sorts them."""
        return replace(self, hits=min(self.hits, 2 * count), queue=min(self.queue, count))


def frame_bytes(width: int, height: int, samples: int, extra: int) -> int:
    """The film, and the finished image that is made of it while it is still there."""
    return band_bytes(width, height, samples, extra) + image_bytes(width, height, extra)


def image_bytes(width: int, height: int, extra: int) -> int:
    """The finished image, in memory or on disk."""
    return width * height * (PIXEL_BYTES + extra)


def band_bytes(width: int, rows: int, samples: int, extra: int) -> int:
    """The film of a band of rows, while the image is on disk."""
    corners = samples == 0
    return (width + corners) * (rows + corners) * (FILM_BYTES + AOV_BYTES + extra) + IMAGE_BAND


def extra_bytes(aovs: Sequence[str]) -> int:
    """What a film element, and a pixel, have of these beyond what they always have."""
    return sum(ON_REQUEST[name] for name in aovs)


class Frame(NamedTuple):
    """How a frame is held: so many rows at a time, in so many bytes."""

    rows: int
    bytes: int
    on_disk: bool


def frame_of(width: int, height: int, samples: int, extra: int, room: int) -> Frame:
    """The whole frame where it takes no more than its part of the memory, else bands of rows.

    Ray queries have none. `extra` are the bytes that a film element, and a pixel, have beyond
    what they always have.
    """
    if not width:
        return Frame(0, 0, on_disk=False)
    whole = frame_bytes(width, height, samples, extra)
    if whole <= room * FRAME_PART:
        return Frame(height, whole, on_disk=False)
    first = band_bytes(width, 1, samples, extra)
    row = band_bytes(width, 2, samples, extra) - first
    fits = int((room * BAND_PART - first) / row) + 1
    rows = min(height, max(fits, -(-FEWEST_RAYS // width)))
    return Frame(rows, band_bytes(width, rows, samples, extra), on_disk=True)


def fixed_bytes(store: Store, threads: int) -> int:
    """What a render takes whatever the budget is, without frame, rays and grid."""
    largest = max((s.stride * s.largest for s in store.streams), default=0)
    buffers = len(store.streams) * threads * (READ_BUFFER * 10 // 4 + largest)
    outgoing = emit_room(len(store.lights)) * QUEUED_BYTES
    each = threads * (outgoing + DELAYS_BYTES + MARKS_BUFFER)
    levels = sum(len(s.levels) for s in store.streams) * LEVEL_BUFFER
    levels += len(store.groups) * (2 + threads) * AHEAD * CHOSEN_BYTES
    palette = store.palette.bytes // MATERIAL_BYTES * MATERIAL_BYTES * 2
    return BASELINE + buffers + levels + each + palette


def grid_bytes(cut: Partition, limits: Limits, blocks: int) -> int:
    """A grid's slab, where its bricks are, and its ray store."""
    slab = min(cut.bricks * BRICK_BYTES, limits.slab)
    store = cut.uppers * UPPER_BYTES + (blocks * BLOCK_BYTES if cut.lower_bits else 0)
    return int(slab + store + cut.bricks * TABLED_BYTES) + 4096


def emit_room(lights: int) -> int:
    """Rays that a worker gathers while it shades: a thousand, or a few hits' worth."""
    return max(1024, 4 * (lights + 2))


def capacities(
    store: Store,
    width: int,
    height: int,
    samples: int,
    memory: int,
    threads: int,
    *,
    aovs: Sequence[str] = (),
    grid: int | None = None,
    max_grid: int | None = None,
) -> Capacities:
    """Divide a budget.

    Parameters
    ----------
    width, height : int
        Of the frame; 0 where there is none, for rays that somebody asks about.
    aovs : sequence of str
        Which of `records.ON_REQUEST` the frame has.
    grid, max_grid : int, optional
        Voxels on the longest axis of a grid, or the most that there may be.

    Raises
    ------
    BudgetError
        If it is less than the least that works; the message names that. If it does not hold the
        grid that is asked for.
    """
    fixed = fixed_bytes(store, threads)
    extra = extra_bytes(aovs)
    frame = frame_of(width, height, samples, extra, memory - fixed)
    small = frame_of(width, height, samples, extra, 0)
    needed = int(FEWEST_RAYS * (FLYING_BYTES / FLYING_PART) / (1 - GRID_PART) + 4096)
    least = fixed + small.bytes + needed
    if memory < least:
        what = f"{width} x {height} pixels" if width else "rays"
        raise BudgetError(
            f"memory: found {memory >> 20}MiB, expected {format_memory(least)} or more "
            f"for {what} of this scene with {threads} threads"
        )
    if memory - fixed - frame.bytes < needed:
        frame = small
    left = memory - fixed - frame.bytes
    uppers = int(min(left * UPPER_PART / UPPER_BYTES, MOST_UPPERS))
    limits = Limits(
        voxels=min(uppers << 3 * LOWER_BITS, 1 << VOXEL_BITS),
        slab=int(left * SLAB_PART),
        single=int(min(left * SINGLE_PART / UPPER_BYTES, MOST_UPPERS)),
        uppers=uppers,
        grid=grid,
        max_grid=max_grid,
    )
    blocks = int(left * BLOCK_PART / BLOCK_BYTES)
    subspace = int(left * SUBSPACE_PART)
    cuts = [partition_of(group, limits) for group in store.groups]
    left -= max(grid_bytes(cut, limits, blocks) for cut in cuts)
    rays = min(int(left * FLYING_PART / FLYING_BYTES), 1 << RAY_BITS)
    others = (left - rays * FLYING_BYTES) // 2
    # Between groups all rays wait, in one of two spools.
    hit = SHADED_HIT_BYTES + HIT_BYTES + (2 * HIT_BYTES if len(store.groups) > 1 else 0)
    return Capacities(
        memory=memory,
        rows=frame.rows,
        frame_on_disk=frame.on_disk,
        limits=limits,
        blocks=blocks,
        subspace=subspace,
        rays=rays,
        candidates=CANDIDATES_A_RAY * rays,
        hits=min(others // hit, 1 << RAY_BITS),
        queue=others // (2 * QUEUED_BYTES),
        read_buffer=READ_BUFFER,
        threads=threads,
    )
