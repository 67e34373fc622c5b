"""However the grid is cut, every ray hits the same, and no walk is repeated."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest
from scenes import units

from bfrt.grid.marks_home import marks_path
from bfrt.grid.marks_layout import Layout
from bfrt.grid.partition import Limits, cut, partition, resolution, uppers_of
from bfrt.reference import exhaustive
from bfrt.reference.independent import Objects
from bfrt.store.extent import Bounds

BRICK = 512


@pytest.fixture(scope="module")
def row(tmp_path_factory):
    """A row of spheres and triangles, 64 bricks long and one wide, and rays along and across."""
    rng = np.random.default_rng(1)
    n = 4000
    place = rng.random((n, 3)) * [0.7, 0.7, 64.0]
    corners = place[:2000, None] + rng.normal(0, 0.02, (2000, 3, 3))
    spheres = np.column_stack([place[2000:], np.full(2000, 0.06)])
    objects = fast.stored(Objects(spheres=spheres, triangles=corners.reshape(-1, 9)))
    store = fast.write(objects, tmp_path_factory.mktemp("row") / "s.bfrt", origin=(0, 0, 0))
    ends = rng.random((2, 400, 3)) * [0.7, 0.7, 64.0]
    origins = np.concatenate([ends[0], ends[0] - 3.0 * units(rng, 400)])
    directions = np.concatenate([ends[1] - ends[0], units(rng, 400)])
    along = np.tile([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], (200, 1))
    directions[200:600] = along + 1e-3 * units(rng, 400)
    return store, origins, directions


def limits_of(slabs, bits):
    """Of a grid of 8 x 8 x 512 voxels, a brick wide."""
    uppers = uppers_of((8, 8, 512), bits)
    return Limits(
        voxels=8 * 8 * 512, slab=BRICK * -(-64 // slabs), single=uppers, uppers=uppers, grid=512
    )


def trace(row, scratch, slabs=1, bits=0, **capacities):
    store, origins, directions = row
    roomy = replace(fast.ROOMY, limits=limits_of(slabs, bits), **capacities)
    marks_path(store, store.groups[0], scratch).unlink(missing_ok=True)
    return fast.nearest(fast.gridded(store), origins, directions, scratch, roomy)


@pytest.fixture(scope="module")
def whole(row, tmp_path_factory):
    found = trace(row, tmp_path_factory.mktemp("scratch"))
    t, ids = exhaustive.nearest(*row)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.ids, ids)
    assert 200 < np.isfinite(t).sum() < 800
    return found


def same(found, whole, threads=1):
    np.testing.assert_array_equal(found.t, whole.t)
    np.testing.assert_array_equal(found.ids, whole.ids)
    if threads > 1:  # candidates in a pass are in proportion to what reads, and threads, have read
        return
    assert found.counters.voxel_steps == whole.counters.voxel_steps
    assert found.counters.box_tests == whole.counters.box_tests


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("slabs", [1, 2, 3, 5, 8, 16, 32, 64])
def test_slabs(row, whole, tmp_path, slabs, threads):
    found = trace(row, tmp_path, slabs, threads=threads)
    same(found, whole, threads)
    whole_read = whole.counters.phases.traversal.bytes_read
    store = row[0]
    file = marks_path(store, store.groups[0], tmp_path).stat().st_size
    assert whole_read == file - Layout((8, 8, 512), 2).data_at  # the one slab, once
    assert whole_read < 64 * BRICK  # for it is coded
    assert found.counters.phases.traversal.bytes_read > (whole_read if slabs > 1 else 0)


@pytest.mark.parametrize("subspaces", [1, 2, 7, 16, 64])
def test_subspaces(row, whole, tmp_path, subspaces):
    found = trace(row, tmp_path, subspace=7 * 7 * 512 // subspaces)
    same(found, whole)
    assert found.counters.passes - whole.counters.passes >= subspaces - 1


@pytest.mark.parametrize("blocks", [0, 1, 2, 5, 40, 10_000])
@pytest.mark.parametrize("bits", [1, 2])
def test_lower_level_blocks(row, whole, tmp_path, bits, blocks):
    same(trace(row, tmp_path, bits=bits, blocks=blocks), whole)


def test_few_rays_at_a_time_in_many_slabs(row, whole, tmp_path):
    found = trace(row, tmp_path, 16, 2, rays=37, candidates=90, blocks=2, subspace=3000, threads=2)
    np.testing.assert_array_equal(found.t, whole.t)
    np.testing.assert_array_equal(found.ids, whole.ids)


def test_marks_do_not_depend_on_subspaces(row, tmp_path):
    store = fast.gridded(row[0])
    files = []
    for subspace in (1 << 20, 9000, 512):
        path = marks_path(store, store.groups[0], tmp_path)
        trace(row, tmp_path, subspace=subspace)
        files.append(path.read_bytes())
        path.unlink()
    assert files[0] == files[1] == files[2]


def test_a_slab_where_no_ray_waits_is_not_read(row, tmp_path):
    store, _, _ = row
    rng = np.random.default_rng(2)
    origins = rng.random((50, 3)) + np.array([0, 0, 20])  # across, in one place
    directions = units(rng, 50) * [1, 1, 1e-3]
    capacities = replace(fast.ROOMY, limits=limits_of(64, 0))
    found = fast.nearest(fast.gridded(store), origins, directions, tmp_path, capacities)
    counters = found.counters
    assert counters.phases.traversal.bytes_read < 4 * BRICK * (counters.passes + 1)


def cube(side):
    return Bounds(np.zeros(3), np.array([side, side, side], np.float64))


def test_the_papers_rule_for_two_levels():
    """One level where R <= Ru; else Rl is the least that is enough, and Ru goes down with it."""
    big = Limits(voxels=1 << 30, slab=1 << 30, single=128**3, uppers=128**3)
    for r, lower in ((100, 1), (128, 1), (129, 2), (256, 2), (257, 4), (512, 4)):
        found = cut((r, r, r), big)
        assert found.lower_bits == {1: 0, 2: 1, 4: 2}[lower]
        assert found.uppers == (-(-r // lower)) ** 3
    assert cut((513, 513, 513), big) is None


def test_a_billion_objects_have_a_thousand_voxels_an_axis():
    from bfrt.budget import UPPER_BYTES

    limits = Limits(voxels=1 << 30, slab=24 << 20, single=1 << 22, uppers=16 << 20)
    found = partition(cube(1.0), 1_000_787_041, limits)
    assert min(found.shape) >= 1000 and found.lower_bits == 2
    assert found.uppers * UPPER_BYTES < 70e6


@pytest.mark.parametrize("sides", [(1, 1, 1), (1, 2, 3), (10, 1, 0.2)])
def test_voxels_are_cubes_as_many_as_asked_for(sides):
    bounds = Bounds(np.zeros(3), np.array(sides, np.float64))
    shape = resolution(bounds, 100_000)
    assert np.prod(shape) == pytest.approx(100_000, rel=0.3)
    voxel = (bounds.grid_sides() / shape)[np.array(shape) > 9]
    assert voxel.max() < 1.1 * voxel.min()


def test_slabs_lie_across_the_longest_axis():
    big = Limits(voxels=1 << 30, slab=1 << 30, single=1 << 24, uppers=1 << 24)
    assert [cut(s, big).axis for s in ((9, 3, 3), (3, 9, 3), (3, 3, 9), (5, 5, 5))] == [0, 1, 2, 2]


def test_a_grid_that_is_asked_for_is_made_or_refused():
    limits = Limits(voxels=1 << 20, slab=1 << 16, single=1 << 20, uppers=1 << 20)
    assert partition(cube(1.0), 10, limits._replace(grid=64)).shape == (64, 64, 64)
    assert partition(cube(1.0), 10, limits._replace(grid=200)) is None  # too many voxels
    assert partition(cube(1.0), 10, limits._replace(grid=101, slab=8 * 96 * 96)) is None
    assert max(partition(cube(1.0), 10**6, limits._replace(max_grid=50)).shape) == 50
    assert max(partition(cube(1.0), 10, limits._replace(max_grid=50)).shape) < 10
