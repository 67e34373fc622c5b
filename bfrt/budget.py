"""The memory budget: bytes become capacities here, before anything runs.

A budget is a promise about the whole process. What is needed whatever happens (`BASELINE`, the
film, read buffers, materials) is taken off it, the grid gets its part of the rest, and rays,
candidates, hits and queues share what is left. Nothing grows after that; what does not fit waits
in spools. The module that owns a thing tells its bytes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, TypeVar

from bfrt.errors import BudgetError
from bfrt.grid.marks import MARKS_BUFFER
from bfrt.grid.partition import LOWER_BITS, Limits, Partition, partition_of
from bfrt.grid.selection import Selection
from bfrt.grid.slabs import Slabs
from bfrt.grid.voxel_rays import BLOCK_BYTES, UPPER_BYTES, VoxelRays
from bfrt.image.frame import FrameSize, HeldFrame, held_frame
from bfrt.memory import BASELINE, format_memory, machine_memory
from bfrt.phases.shading import SHADED_HIT_BYTES, Shading
from bfrt.phases.traversal import CANDIDATES_A_RAY, FEWEST_RAYS, IN_FLIGHT_BYTES
from bfrt.records import HIT_BYTES, QUEUED_BYTES, RAY_BITS, VOXEL_BITS
from bfrt.scan.deferred import DELAYS_BYTES
from bfrt.scan.scans import READ_BUFFER, GroupScans
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tree.candidates import Candidates
from bfrt.tree.forest import Forest
from bfrt.tree.pieces import PieceReader
from bfrt.tree.rays import RETIRED_BYTES

#: Of what a budget leaves, at the most: a slab; upper voxels that are voxels, or larger ones;
#: blocks; before there are rays, a subspace. Of what the grid leaves, rays in flight.
SLAB_PART = 0.15
SINGLE_PART = 0.1
UPPER_PART = 0.4
BLOCK_PART = 0.04
SUBSPACE_PART = 0.7
IN_FLIGHT_PART = 0.45
#: Treelets that may stay in memory, of what the frame leaves; sketches of them, where they do not;
#: rays at once where they do.
RESIDENT_PART = 0.6
KEPT_PART = 0.4
RESIDENT_RAYS = 1 << 16
GRID_PART = SLAB_PART + UPPER_PART + BLOCK_PART + 0.02

#: The paper's Ru: 256 upper voxels an axis.
MOST_UPPERS = 1 << 24

#: Rays that somebody asks about: there is no frame.
NO_FRAME = FrameSize()


Own = TypeVar("Own", bound="Capacities")


@dataclass(frozen=True)
class Room:
    """Holds what memory has room for of a render between two depths.

    Attributes
    ----------
    rows : int
        Rows of the frame that are in memory at a time.
    frame_on_disk : bool
        Whether the finished image is on disk.
    hits, queue : int
        Hits, and rays of a depth, that wait in memory.
    """

    rows: int
    frame_on_disk: bool
    hits: int
    queue: int

    def bands(self, height: int) -> int:
        """Return the number of bands of rows that an image of `height` rows is rendered in."""
        return -(-height // self.rows)


@dataclass(frozen=True)
class Capacities(Room):
    """Holds what a memory budget has room for, whatever rays go through.

    Attributes
    ----------
    memory : int
        Bytes of the budget.
    rays, candidates : int
        Rays in flight, and their candidates.
    read_buffer : int
        Bytes of one read buffer.
    threads : int
    """

    memory: int
    rays: int
    candidates: int
    read_buffer: int
    threads: int

    def for_hits(self: Own, count: int) -> Own:
        """Return these capacities for `count` hits at most: twice as many fit, to sort them."""
        return replace(self, hits=min(self.hits, 2 * count), queue=min(self.queue, count))


@dataclass(frozen=True)
class GridCapacities(Capacities):
    """Holds what a memory budget has room for where rays go through grids.

    Attributes
    ----------
    limits : Limits
        The limits of a grid.
    blocks : int
        Lower-level blocks of the rays' store.
    subspace : int
        Voxels that are marked at a time.
    """

    limits: Limits
    blocks: int
    subspace: int


@dataclass(frozen=True)
class TreeCapacities(Capacities):
    """Holds what a memory budget has room for where rays go through treelets.

    Attributes
    ----------
    resident : bool
        Whether there is room for all treelets.
    kept : int
        Bytes of sketches of treelets that stay where there is not.
    cached : bool
        Whether the system's cache, which has what the budget leaves, has room for all treelets.
    """

    resident: bool
    kept: int
    cached: bool


def fixed_bytes(store: Store, settings: Settings) -> int:
    """Return the bytes that a render takes under any budget, without frame, rays and grid."""
    threads = settings.threads
    shared = BASELINE + GroupScans.bytes(store.streams, threads) + Shading.bytes(store, threads)
    if settings.refinement.tree:
        return shared + Forest.bytes(store) + threads * (PieceReader.bytes(store) + RETIRED_BYTES)
    return shared + Selection.bytes(store, threads) + threads * (DELAYS_BYTES + MARKS_BUFFER)


def grid_bytes(cut: Partition, limits: Limits, blocks: int) -> int:
    """Return the bytes of a grid's slab and of its ray store."""
    stored = VoxelRays.bytes(cut.uppers, blocks if cut.lower_bits else 0)
    return Slabs.bytes(cut.bricks, limits.slab) + stored + 4096


def capacities(store: Store, settings: Settings, frame: FrameSize = NO_FRAME) -> Capacities:
    """Divide a budget.

    Raises
    ------
    BudgetError
        If it is less than the least that works; the message names that. If it does not hold the
        grid that is asked for.
    """
    memory = settings.memory
    fixed = fixed_bytes(store, settings)
    held = held_frame(frame, memory - fixed, FEWEST_RAYS)
    small = held_frame(frame, 0, FEWEST_RAYS)
    part = KEPT_PART if settings.refinement.tree else GRID_PART
    needed = int(FEWEST_RAYS * (IN_FLIGHT_BYTES / IN_FLIGHT_PART) / (1 - part) + 4096)
    least = fixed + small.bytes + needed
    if memory < least:
        what = f"{frame.width} x {frame.height} pixels" if frame.width else "rays"
        if frame.views > 1:
            what = f"{frame.views} views of {what}"
        if frame.band:
            what += f", begun in bands of {frame.band} rows,"
        raise BudgetError(
            f"memory: found {memory >> 20}MiB, expected {format_memory(least)} or more "
            f"for {what} of this scene with {settings.threads} threads"
        )
    if memory - fixed - held.bytes < needed:
        held = small
    divide = tree_capacities if settings.refinement.tree else grid_capacities
    return divide(store, settings, held, memory - fixed - held.bytes)


def grid_capacities(store: Store, settings: Settings, held: HeldFrame, left: int) -> GridCapacities:
    """Divide what the frame leaves among a grid, rays and hits."""
    limits = limits_of(left, settings)
    blocks = int(left * BLOCK_PART / BLOCK_BYTES)
    subspace = int(left * SUBSPACE_PART)
    cuts = [partition_of(group, limits) for group in store.groups]
    left -= max(grid_bytes(cut, limits, blocks) for cut in cuts)
    rays = min(int(left * IN_FLIGHT_PART / IN_FLIGHT_BYTES), 1 << RAY_BITS)
    # Between groups all rays wait, in one of two spools.
    between = 2 * HIT_BYTES if len(store.groups) > 1 else 0
    shared = shared_capacities(settings, held, left, rays, between)
    return GridCapacities(**shared, limits=limits, blocks=blocks, subspace=subspace)


def tree_capacities(store: Store, settings: Settings, held: HeldFrame, left: int) -> TreeCapacities:
    """Divide what the frame leaves among treelets, rays and hits."""
    treelets = Forest.resident_bytes(store)
    resident = treelets <= RESIDENT_PART * left
    kept = 0 if resident else min(int(KEPT_PART * left), Forest.kept_bytes(store))
    left -= treelets if resident else kept
    rays = min(int(left * IN_FLIGHT_PART / IN_FLIGHT_BYTES), 1 << RAY_BITS)
    if resident:
        rays = min(rays, RESIDENT_RAYS)
    shared = shared_capacities(settings, held, left, rays, 0)
    shared["candidates"] = Candidates.room(shared["candidates"])  # of as many bytes
    cached = treelets <= machine_memory() - settings.memory
    return TreeCapacities(**shared, resident=resident, kept=kept, cached=cached)


def shared_capacities(
    settings: Settings, held: HeldFrame, left: int, rays: int, between: int
) -> dict[str, Any]:
    """Divide what is left among rays, hits and queues; `between` bytes a hit go elsewhere."""
    others = (left - rays * IN_FLIGHT_BYTES) // 2
    return {
        "memory": settings.memory,
        "rows": held.rows,
        "frame_on_disk": held.on_disk,
        "rays": rays,
        "candidates": CANDIDATES_A_RAY * rays,
        "hits": min(others // (SHADED_HIT_BYTES + HIT_BYTES + between), 1 << RAY_BITS),
        "queue": others // (2 * QUEUED_BYTES),
        "read_buffer": READ_BUFFER,
        "threads": settings.threads,
    }


def limits_of(left: int, settings: Settings) -> Limits:
    """Return the limits of a grid that has `left` bytes of memory."""
    uppers = int(min(left * UPPER_PART / UPPER_BYTES, MOST_UPPERS))
    return Limits(
        voxels=min(uppers << 3 * LOWER_BITS, 1 << VOXEL_BITS),
        slab=int(left * SLAB_PART),
        single=int(min(left * SINGLE_PART / UPPER_BYTES, MOST_UPPERS)),
        uppers=uppers,
        grid=settings.grid,
        max_grid=settings.max_grid,
    )
