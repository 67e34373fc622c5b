"""The marks are those of every box, one at a time: of the boxes that rays will meet."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest
from boxes import boxes_of
from scenes import random_objects

import bfrt
from bfrt.grid.bricks import BRICK, BRICK_BYTES
from bfrt.grid.grid import Grid
from bfrt.grid.marks import open_marks
from bfrt.grid.marks_home import marks_path
from bfrt.grid.partition import partition_of
from bfrt.grid.subspace import Subspace
from bfrt.phases._preprocess import mark
from bfrt.phases.preprocess import grid_of, layout_of
from bfrt.records import Kind
from bfrt.scan.files import StreamFiles
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.settings import REFINEMENTS, Settings
from bfrt.stats import Counters
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.store import open_store
from bfrt.traced_group import TracedGroup
from bfrt.workers import Workers

#: A voxel's bits that are marks.
FACES = 63


def marked_one_by_one(store, grid, quantised):
    """By the definition: of a voxel a bit for each of its faces where a box's region begins."""
    marks = np.zeros(grid.layered, np.uint8)
    for box in boxes_of(store, quantised=quantised):
        first, last = grid.range_of(box)
        for face in range(6):
            low, high = list(first), list(last)
            axis = face % 3
            low[axis] = high[axis] = first[axis] if face < 3 else last[axis]
            where = tuple(slice(low[k], high[k] + 1) for k in reversed(grid.order))
            marks[where] |= np.uint8(1 << face)
    return marks


def marked(store, grid, layout, scratch):
    """What the marks on disk say."""
    marks = open_marks(marks_path(store, store.groups[0], scratch), store, layout)
    layers, rows, row = layout.bricks
    whole = np.zeros((layers, rows, row, BRICK, BRICK, BRICK), np.uint8)
    for number, occupied in enumerate(marks.occupied.astype(bool)):
        bricks = np.empty((occupied.sum(), BRICK_BYTES), np.uint8)
        marks.read(number, bricks)
        whole[number][occupied] = bricks.reshape(-1, BRICK, BRICK, BRICK) & FACES
    marks.close()
    a, b, c = grid.layered
    whole = whole.transpose(0, 3, 1, 4, 2, 5).reshape(layers * BRICK, rows * BRICK, row * BRICK)
    assert not whole[a:].any() and not whole[:, b:].any() and not whole[:, :, c:].any()
    return whole[:a, :b, :c]


@pytest.mark.parametrize("refine", ["base", "sg", "sgb"])
@pytest.mark.parametrize("subspace", [1 << 30, 3000])
def test_marks_are_those_of_every_box(refine, subspace, tmp_path):
    """Of quantised boxes with sgb; whatever is in memory at a time."""
    objects = random_objects(np.random.default_rng(7), 400)
    store = fast.gridded(fast.write(objects, tmp_path / "a.bfrt", origin=(0, 0, 0)))
    group = store.groups[0]
    capacities = replace(fast.limited(fast.ROOMY, voxels=24**3), subspace=subspace, threads=2)
    workers = Workers(2)
    settings = Settings(0, 2, REFINEMENTS[refine], scratch=tmp_path)
    scans = GroupScans(store, group, 2, 4096, settings.refinement.lazy)
    field = TracedGroup(store, group, settings, capacities.limits, scans, workers)
    field.preprocess(capacities.subspace, Counters(), fresh=True)
    workers.close()
    cut = partition_of(group, capacities.limits)
    grid = grid_of(store, group, cut.shape, cut.axis)
    layout = layout_of(group, cut, refine == "sgb")
    assert (layout.boxes != 0) == (refine == "sgb")
    found = marked(store, grid, layout, tmp_path)
    assert 0.1 < (found != 0).mean() < 0.9
    expected = marked_one_by_one(store, grid, refine == "sgb")
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("kind", "bits", "name", "width"),
    [
        (Kind.TRIANGLE, 0, "boxes", 24),
        (Kind.TRIANGLE, 8, "quantised", 6),
        (Kind.SPHERE, 8, "geometry", 16),
    ],
)
def test_of_boxes_those_are_read_that_are_chosen(tmp_path, kind, bits, name, width):
    """And short gaps between, but no byte beyond: what comes next is far."""
    corners = np.random.default_rng(1).random((100_000, 9), np.float32)
    with bfrt.SceneWriter(
        tmp_path / "a.bfrt", hierarchy=Hierarchy(bits=bits), order="given"
    ) as writer:
        writer.append(kind, corners if kind == Kind.TRIANGLE else corners[:, :4].copy())
    (stream,) = open_store(tmp_path / "a.bfrt").streams
    files = StreamFiles(stream, lazy=True)
    scan = StreamScan(stream, (0.0,) * 3, files, np.empty(0, np.int64), 1 << 18)
    scan.rewind(prefetched=True)
    scan.window(0, 90_020)
    grid = Grid((0.0,) * 3, (1.0,) * 3, (4, 4, 4), 0.0)
    marks = np.zeros(grid.layered, np.uint8)
    gap = (1 << 14) // width  # that is read through
    b = 10 + gap
    c = b + 10 + gap + 1
    ranges = np.array([[5, 10], [b, b + 10], [c, c + 10], [30_000, 70_000], [90_000, 90_010]])
    parents = np.array([[0, 0, 0, 1, 1, 1]] * 5, np.float32) if stream.quantised else None
    mark(scan, ranges, parents, grid, Subspace(grid, 0, 4), marks)
    assert marks.any()
    chosen = (b + 10 - 5) + 10 + 40_000 + 10
    assert files.counts()[0] == width * chosen
    assert name in stream.files


def test_quantised_boxes_of_another_hierarchy_have_other_marks(tmp_path):
    """The store is the same but for its hierarchy: so would be the name of its marks in scratch."""
    stores = [
        bfrt.spd.gears(2).write(tmp_path / f"{number}.bfrt", hierarchy=settings).store
        for number, settings in enumerate([Hierarchy(), Hierarchy(s=1.5), Hierarchy(bits=0)])
    ]
    assert len({store.checksum for store in stores}) == 1
    sums = [store.groups[0].quantised_checksum for store in stores]
    assert len(set(sums)) == 3 and sums[2] == 0


def test_marks_are_made_again_for_other_boxes(tmp_path):
    scene = bfrt.spd.gears(2)
    store = scene.write(tmp_path / "a.bfrt")
    camera = replace(scene.camera, resolution=(16, 16))
    reused = [
        bfrt.render(store, memory="128MiB", camera=camera, refine=refine).stats.marks_reused
        for refine in ("sgb", "sgb", "sg", "base", "sgb")
    ]
    assert reused == [False, True, False, True, False]
