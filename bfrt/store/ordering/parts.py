"""Objects in any order, parted by where they are: an external distribution sort.

The cells of a grid are counted first. Runs of cells along a Morton curve that have few enough
objects are a part each, and get their region in one file; a second pass brings the objects there.
A part of more than a window's weight is parted again, by a grid around its own. One that has most
of the objects' bytes gets no region: it is picked out of all of them again, so that all regions
together take no more than twice those.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import NOTHING, Bounds, bounds_of
from bfrt.store.ordering._loops import codes_of
from bfrt.store.ordering.objects import Layout, Objects, joined
from bfrt.store.ordering.regions import Regions, object_bytes
from bfrt.workers import ahead

#: Bits on each axis of the cells that are counted.
CELL_BITS = 6

#: The most weight of a window, which becomes treelets in memory: an object's is 1, a polygon's
#: more, by the vertices that weigh as much as another object.
WINDOW = 1 << 17
WEIGHING = 4

#: Parts at once, at the most: so many ends of regions are written to in turn.
PARTS = 1024

Weights = NDArray[np.int64]


class Source(NamedTuple):
    """Holds objects in any order.

    Attributes
    ----------
    layout : Layout
    blocks : callable
        Gives them block by block, as often as it is called.
    around : Bounds
        A box around most of their centers; those outside count as on its border.
    """

    layout: Layout
    blocks: Callable[[], Iterator[Objects]]
    around: Bounds


class Means(NamedTuple):
    """Says how objects are parted.

    Attributes
    ----------
    scratch : Path
        Folder of the parts.
    threads : int
    window : int
        The most weight of a window.
    """

    scratch: Path
    threads: int
    window: int = WINDOW


class Placed(NamedTuple):
    """Holds a block of objects, and the cell of each."""

    objects: Objects
    cells: NDArray[np.int64]
    centers: NDArray[np.float64]


def as_they_come(source: Source, means: Means, done: int = 0) -> Generator[Objects, None, None]:
    """Yield all objects in windows, in the order in which they are.

    The first `done` objects, which are those of whole windows, are left out.
    """
    held: list[Objects] = []
    weight = 0
    for block in _behind(source.blocks(), done, source.layout):
        ends = np.cumsum(weights_of(block, source.layout))
        first = 0
        while first < block.number:
            before = int(ends[first - 1]) if first else 0
            last = max(
                first + 1, int(np.searchsorted(ends, before + means.window - weight, "right"))
            )
            if weight and int(ends[first]) - before + weight > means.window:
                last = first  # not even one fits
            if last > first:
                held.append(block.between(first, last, source.layout))
                weight += int(ends[last - 1]) - before
            if last < block.number:
                yield joined(held)
                held, weight = [], 0
            first = last
    if held:
        yield joined(held)


def _behind(blocks: Iterator[Objects], done: int, layout: Layout) -> Iterator[Objects]:
    """Yield the objects behind the first `done`."""
    for block in blocks:
        if done < block.number:
            yield block.between(done, block.number, layout) if done else block
        done = max(0, done - block.number)


def by_place(source: Source, means: Means, done: int = 0) -> Generator[Objects, None, None]:
    """Yield all objects in windows, along a curve through space.

    The first `done` objects, which are those of whole windows, are left out: parts of such alone
    get no region.
    """
    if source.around.diagonal == 0.0:  # all in one place
        yield from as_they_come(source, means, done)
        return

    def picker() -> Iterator[Objects]:
        return _picked(source, part_of == picked, means)

    weights, objects, records = _counted(source, means)
    part_of, parts = _parts(weights, means.window)
    counted = [np.bincount(part_of, each, parts).astype(np.int64) for each in (objects, records)]
    heavy = np.bincount(part_of, weights, parts) > means.window
    layout = source.layout
    ends = np.cumsum(counted[0])
    begins = ends - counted[0]
    left = ends > np.maximum(begins, done)
    sizes = counted[0] * object_bytes(layout) + counted[1] * layout.stride
    most = int(sizes.argmax())
    picked = most if heavy[most] and 2 * sizes[most] > sizes.sum() else -1
    kept = left & (np.arange(parts) != picked)
    regions = Regions(layout, counted[0] * kept, counted[1] * kept, means.scratch)
    try:
        around = _fill(regions, part_of, heavy, source, means)
        for part in np.flatnonzero(left).tolist():
            if heavy[part]:
                reader = regions.reader(part) if part != picked else picker
                behind = max(0, done - int(begins[part]))
                yield from by_place(Source(layout, reader, around[part]), means, behind)
            else:
                yield joined(list(regions.reader(part)()))
    finally:
        regions.close()


def weights_of(some: Objects, layout: Layout) -> Weights:
    """Return the weight of each object."""
    if layout.kind.counted:
        weights: Weights = 1 + some.counts.astype(np.int64) // WEIGHING
        return weights
    return np.ones(some.number, np.int64)


def _placed(source: Source, means: Means) -> Generator[Placed, None, None]:
    """Yield all objects with their cells."""
    return ahead(_placing(source), source.blocks(), means.threads)


def _placing(source: Source) -> Callable[[Objects], Placed]:
    """Return what finds the cells of objects, for any thread."""
    lo = source.around.lo
    scale = np.full(3, (1 << CELL_BITS) / float((source.around.hi - lo).max()))

    def place(some: Objects) -> Placed:
        boxes = some.boxes(source.layout)
        codes = np.empty(some.number, np.uint64)
        codes_of(boxes, lo, scale, CELL_BITS, codes)
        return Placed(some, codes.astype(np.int64), 0.5 * boxes[:, :3] + 0.5 * boxes[:, 3:])

    return place


def _picked(source: Source, wanted: NDArray[np.bool_], means: Means) -> Iterator[Objects]:
    """Yield the objects in some cells."""
    for some in _placed(source, means):
        order = np.flatnonzero(wanted[some.cells]).astype(np.uint32)
        if len(order):
            yield some.objects.taken(order, source.layout)


def _counted(source: Source, means: Means) -> tuple[Weights, Weights, Weights]:
    """Return the weight, the objects and the records in each cell."""
    cells = 1 << 3 * CELL_BITS
    sums = np.zeros((3, cells), np.int64)
    polygons = source.layout.kind.counted
    for some in _placed(source, means):
        objects = np.bincount(some.cells, minlength=cells)
        sums[1] += objects
        if polygons:
            weights = weights_of(some.objects, source.layout)
            sums[0] += np.bincount(some.cells, weights, cells).astype(np.int64)
            sums[2] += np.bincount(some.cells, some.objects.counts, cells).astype(np.int64)
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
    regions: Regions, part_of: NDArray[np.int64], heavy: NDArray[np.bool_], source: Source,
    means: Means,
) -> dict[int, Bounds]:  # fmt: skip
    """Bring all objects to their regions; return the bounds of the centers of heavy parts."""
    place = _placing(source)

    def part(some: Objects) -> tuple[Objects, Weights, dict[int, Bounds]]:
        """Sort objects by their parts; return where each part ends, and bounds of heavy ones."""
        placed = place(some)
        parts = part_of[placed.cells]
        order = np.argsort(parts.astype(np.uint16), kind="stable").astype(np.uint32)
        ends = np.cumsum(np.bincount(parts, minlength=len(heavy)))
        bounds = {}
        for k in np.flatnonzero(heavy).tolist():
            own = placed.centers[order[ends[k - 1] if k else 0 : ends[k]]]
            own = own[np.isfinite(own[:, 0])]  # of an empty box there is none
            bounds[k] = bounds_of(np.hstack([own, own]))
        return some.taken(order, source.layout), ends, bounds

    around = dict.fromkeys(np.flatnonzero(heavy).tolist(), NOTHING)
    for taken, ends, bounds in ahead(part, source.blocks(), means.threads):
        begins = np.concatenate([[0], ends[:-1]])
        for k in np.flatnonzero((ends > begins) & (regions.objects > 0)).tolist():
            own = taken.between(int(begins[k]), int(ends[k]), source.layout)
            regions.append(k, own)
        around = {k: box.union(bounds[k]) for k, box in around.items()}
    return around
