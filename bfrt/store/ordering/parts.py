"""Objects in any order, parted by where they are: an external distribution sort.

The cells of a grid are counted first. Runs of cells along a Morton curve that have few enough
objects are a part each, and get their region in one file; a second pass brings the objects there.
A part of more than a window's weight is parted again, by a grid around its own. One that has most
of the objects' bytes gets no region: it is picked out of all of them again, so that all regions
together take no more than twice those. Where that happens again inside of it, one reading picks
by all grids at once, so that memory has one block at a time, however deep they are.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import NOTHING, Bounds, bounds_of_points
from bfrt.store.ordering._loops import codes_of, give_back
from bfrt.store.ordering.objects import Filling, Layout, Objects
from bfrt.store.ordering.regions import Regions, object_bytes
from bfrt.workers import WAITING, ahead

#: Bits on each axis of the cells that are counted.
CELL_BITS = 6
CELLS = 1 << 3 * CELL_BITS

#: The most weight of a window, which becomes treelets in memory: an object's is 1, a polygon's
#: more, by the vertices that weigh as much as another object.
WINDOW = 1 << 17
WEIGHING = 4

#: Vertices of a polygon at the least: one of three is a triangle.
LEAST_VERTICES = 4

#: Parts at once, at the most: so many ends of regions are written to in turn.
PARTS = 1024

Weights = NDArray[np.int64]


class Choice(NamedTuple):
    """Says which objects are picked: those in some cells of a grid.

    Attributes
    ----------
    around : Bounds
        The grid's.
    cells : (cells,) bool
        Whether a cell's objects are picked.
    """

    around: Bounds
    cells: NDArray[np.bool_]


class Source(NamedTuple):
    """Holds objects in any order.

    Attributes
    ----------
    layout : Layout
    blocks : callable
        Gives them, and others, block by block, as often as it is called.
    around : Bounds
        A box around most of their centers; those outside count as on its border.
    choices : tuple of Choice
        What picks them out of the blocks, one after the other.
    """

    layout: Layout
    blocks: Callable[[], Iterator[Objects]]
    around: Bounds
    choices: tuple[Choice, ...] = ()

    def picked(self, some: Objects) -> Objects:
        """Return those of a block that are picked."""
        for around, cells in self.choices:
            own = placed(some, around, self.layout).cells
            some = some.taken(np.flatnonzero(cells[own]).astype(np.uint32), self.layout)
        return some


class Means(NamedTuple):
    """Says how objects are parted.

    Attributes
    ----------
    scratch : Path
        Folder of the parts.
    threads : int
    window : int
        The most weight of a window.
    waiting : int
        Blocks, or windows, that wait beside those that threads are at.
    """

    scratch: Path
    threads: int
    window: int = WINDOW
    waiting: int = WAITING


class Plan(NamedTuple):
    """Says what the parts of objects are.

    Attributes
    ----------
    part_of : (cells,) uint16
        The part of each cell.
    heavy : (parts,) bool
        Whether a part has more than a window's weight.
    objects, records : (parts,) int64
        What each part has.
    picked : int
        The part that is picked out of all objects again, or -1.
    """

    part_of: NDArray[np.uint16]
    heavy: NDArray[np.bool_]
    objects: Weights
    records: Weights
    picked: int


class Placed(NamedTuple):
    """Holds a block of objects, and the cell of each."""

    objects: Objects
    cells: NDArray[np.int64]
    centers: NDArray[np.float32]


def as_they_come(source: Source, means: Means, done: int = 0) -> Generator[Objects, None, None]:
    """Yield all objects in windows, in the order in which they are.

    The first `done` objects, which are those of whole windows, are left out.
    """
    held: Filling | None = None
    weight = 0
    for block in source.blocks():
        some = source.picked(block)
        del block
        passed = min(done, some.number)
        if passed:
            done -= passed
            some = some.between(passed, some.number, source.layout)
        ends = np.cumsum(weights_of(some, source.layout))
        first = 0
        while first < some.number:
            before = int(ends[first - 1]) if first else 0
            last = max(
                first + 1, int(np.searchsorted(ends, before + means.window - weight, "right"))
            )
            if weight and int(ends[first]) - before + weight > means.window:
                last = first  # not even one fits
            if last > first:
                held = held or _room_of_window(int(ends[first]) - before, source.layout, means)
                held.add(some.between(first, last, source.layout))
                weight += int(ends[last - 1]) - before
            if last < some.number and held is not None:
                window, held, weight = held.taken(), None, 0
                yield window
                del window
            first = last
        del some  # before the next block is read
    if held is not None:
        yield held.taken()


def _room_of_window(first: int, layout: Layout, means: Means) -> Filling:
    """Return what takes a window, of which the first object's weight is given."""
    weight = max(first, means.window)
    return Filling(layout, weight, WEIGHING * weight if layout.kind.counted else weight)


def by_place(source: Source, means: Means, done: int = 0) -> Generator[Objects, None, None]:
    """Yield all objects in windows, along a curve through space.

    The first `done` objects, which are those of whole windows, are left out: parts of such alone
    get no region.
    """
    if source.around.diagonal == 0.0:  # all in one place
        yield from as_they_come(source, means, done)
        return
    layout = source.layout
    part_of, heavy, objects, records, picked = _plan(source, means)
    ends = np.cumsum(objects)
    begins = ends - objects
    left = ends > np.maximum(begins, done)
    kept = left & (np.arange(len(left)) != picked)
    choice = Choice(source.around, part_of == picked)
    regions = Regions(layout, objects * kept, records * kept, means.scratch)
    try:
        around = _fill(regions, part_of, heavy, source, means)
        del part_of
        give_back()
        for part in np.flatnonzero(left).tolist():
            behind = max(0, done - int(begins[part]))
            if part == picked:
                choices = (*source.choices, choice)
                own = Source(layout, source.blocks, around[part], choices)
                yield from by_place(own, means, behind)
            elif heavy[part]:
                own = Source(layout, regions.reader(part), around[part])
                yield from by_place(own, means, behind)
            else:
                held = Filling(layout, int(objects[part]), int(records[part]))
                for block in regions.reader(part)():
                    held.add(block)
                    del block
                window = held.taken()
                del held
                yield window
                del window
    finally:
        regions.close()


def _plan(source: Source, means: Means) -> Plan:
    """Count all objects, and decide what the parts are."""
    layout = source.layout
    counted = _counted(source, means)
    give_back()
    part_of, parts = _parts(counted[0], means.window)
    weights, objects, records = (
        np.bincount(part_of, each, parts).astype(np.int64) for each in counted
    )
    heavy = weights > means.window
    sizes = objects * object_bytes(layout) + records * layout.stride
    most = int(sizes.argmax())
    picked = most if heavy[most] and 2 * sizes[most] > sizes.sum() else -1
    return Plan(part_of.astype(np.uint16), heavy, objects, records, picked)


def weights_of(some: Objects, layout: Layout) -> Weights:
    """Return the weight of each object."""
    if layout.kind.counted:
        weights: Weights = 1 + some.counts.astype(np.int64) // WEIGHING
        return weights
    return np.ones(some.number, np.int64)


def placed(some: Objects, around: Bounds, layout: Layout) -> Placed:
    """Return objects with their cells of the grid in a box."""
    scale = np.full(3, (1 << CELL_BITS) / float((around.hi - around.lo).max()))
    boxes = some.boxes(layout)
    codes = np.empty(some.number, np.uint64)
    codes_of(boxes, around.lo, scale, CELL_BITS, codes)
    return Placed(some, codes.astype(np.int64), 0.5 * boxes[:, :3] + 0.5 * boxes[:, 3:])


def _placing(source: Source) -> Callable[[Objects], Placed]:
    """Return what picks objects and finds their cells, for any thread."""
    return lambda block: placed(source.picked(block), source.around, source.layout)


def _counted(source: Source, means: Means) -> tuple[Weights, Weights, Weights]:
    """Return the weight, the objects and the records in each cell."""
    sums = np.zeros((3, CELLS), np.int64)
    polygons = source.layout.kind.counted
    placing = _placing(source)
    for some in ahead(placing, source.blocks(), means.threads, means.waiting):
        objects = np.bincount(some.cells, minlength=CELLS)
        sums[1] += objects
        if polygons:
            weights = weights_of(some.objects, source.layout)
            sums[0] += np.bincount(some.cells, weights, CELLS).astype(np.int64)
            sums[2] += np.bincount(some.cells, some.objects.counts, CELLS).astype(np.int64)
    return (sums[0], sums[1], sums[2]) if polygons else (sums[1], sums[1], sums[1])


def _parts(weights: Weights, window: int) -> tuple[NDArray[np.int64], int]:
    """Return the part of each cell, and the number of parts."""
    ends = np.cumsum(weights)
    most = max(window, -(-int(ends[-1]) // (PARTS // 2)))
    part_of = np.zeros(len(weights), np.int64)
    first = part = 0
    while first < len(weights):
        before = int(ends[first - 1]) if first else 0
        last = max(first + 1, int(np.searchsorted(ends, before + most, "right")))
        part_of[first:last] = part
        first, part = last, part + 1
    return part_of, part


def _fill(
    regions: Regions, part_of: NDArray[np.uint16], heavy: NDArray[np.bool_], source: Source,
    means: Means,
) -> dict[int, Bounds]:  # fmt: skip
    """Bring all objects to their regions; return the bounds of the centers of heavy parts."""
    place = _placing(source)

    def part(some: Objects) -> tuple[Objects, Weights, dict[int, Bounds]]:
        """Sort objects by their parts; return where each part ends, and bounds of heavy ones."""
        placed = place(some)
        parts = part_of[placed.cells]
        order = np.argsort(parts, kind="stable").astype(np.uint32)
        ends = np.cumsum(np.bincount(parts, minlength=len(heavy)))
        bounds = {}
        for k in np.flatnonzero(heavy).tolist():
            own = placed.centers[order[ends[k - 1] if k else 0 : ends[k]]]
            own = own[np.isfinite(own[:, 0])]  # of an empty box there is none
            bounds[k] = bounds_of_points(own)
        return placed.objects.taken(order, source.layout), ends, bounds

    around = dict.fromkeys(np.flatnonzero(heavy).tolist(), NOTHING)
    for taken, ends, bounds in ahead(part, source.blocks(), means.threads, means.waiting):
        begins = np.concatenate([[0], ends[:-1]])
        for k in np.flatnonzero((ends > begins) & (regions.objects > 0)).tolist():
            own = taken.between(int(begins[k]), int(ends[k]), source.layout)
            regions.append(k, own)
        around = {k: box.union(bounds[k]) for k, box in around.items()}
    return around
