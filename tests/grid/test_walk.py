"""Walks through the grid, and the ranges of boxes in it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import units

from bfrt.grid.grid import Grid

LOW, HIGH, START = 0, 3, 6
SHAPES = [(1, 1, 1), (7, 5, 3), (1, 40, 2), (16, 16, 16), (64, 64, 64)]
GROW = 2.0**-30


def make_lattice(rng, shape):
    lo = rng.normal(size=3) * 10
    return Grid(lo, lo + 10 ** rng.uniform(-2, 2, 3), shape, GROW)


def ends(grid):
    return np.array([p[0] for p in grid.tables]), np.array([p[-1] for p in grid.tables])


def index_of(grid, voxel):
    nx, ny, _ = grid.shape
    return voxel % nx, voxel // nx % ny, voxel // (nx * ny)


def rays_of(rng, grid, n):
    """Rays from inside and outside; along axes, in planes, through corners of the grid."""
    low, high = ends(grid)
    size = high - low
    inside = rng.uniform(low, high, (n, 3))
    axis = np.eye(3)[rng.integers(3, size=n)] * rng.choice([-1.0, 1.0], (n, 1))
    corner, other = (np.column_stack([rng.choice(p, n) for p in grid.tables]) for _ in range(2))
    flat = units(rng, n)
    flat[np.arange(n), rng.integers(3, size=n)] = rng.choice([0.0, -0.0, 1e-310, 1e-30, -1e-17], n)
    away = np.linalg.norm(size) * units(rng, n) * rng.uniform(0.5, 50, (n, 1))
    yield inside, units(rng, n)
    yield inside - away, away
    yield inside - 3 * axis * size.max(), axis
    yield inside, axis
    yield corner, units(rng, n)
    yield corner, axis
    yield corner - 2 * axis * size.max(), axis
    yield corner - 2 * (corner - other), corner - other + (corner == other) * size
    yield corner - away, away
    yield inside, flat
    yield corner - 3 * flat * size.max(), flat


def walks(seed, shape, n=12):
    """(grid, origin, direction, way) of many rays; those that miss the grid have no way."""
    rng = np.random.default_rng([seed, *shape])
    grid = make_lattice(rng, shape)
    for origins, directions in rays_of(rng, grid, n):
        for origin, direction in zip(origins, directions, strict=True):
            yield grid, origin, direction, grid.walk(origin, direction)


def inverse(direction):
    """What the core multiplies by: 0 where the axis never steps."""
    with np.errstate(divide="ignore", over="ignore"):
        inv = 1.0 / direction
    return np.where(np.isfinite(inv), inv, 0.0)


def crossings(grid, origin, direction, at):
    """When the ray comes into the layer of `at` on each axis, and when it leaves."""
    inv = inverse(direction)
    enter, leave = np.full(3, -np.inf), np.full(3, np.inf)
    for k in range(3):
        if inv[k]:
            pair = [(grid.tables[k][at[k] + e] - origin[k]) * inv[k] for e in (0, 1)]
            enter[k], leave[k] = min(pair), max(pair)
    return enter, leave


every_shape = pytest.mark.parametrize("shape", SHAPES, ids=str)


@every_shape
def test_times_ascend_and_voxels_are_adjacent(shape):
    walked = 0
    for grid, _, direction, way in walks(1, shape):
        walked += bool(way)
        for (a, _, t), (b, face, u) in pairwise(way):
            assert t <= u
            step = np.subtract(index_of(grid, b), index_of(grid, a))
            axis = face % 3
            assert np.abs(step).sum() == 1
            assert step[axis] == (1 if face < HIGH else -1)
            assert step[axis] == np.sign(direction[axis])
    assert walked > 60


@every_shape
def test_every_crossing_is_computed_from_its_plane(shape):
    """(plane - o) inv, to the last bit, of the face that the walk names."""
    for grid, origin, direction, way in walks(2, shape):
        for voxel, face, t in way:
            if face == START:
                assert t == 0.0
                continue
            enter, _ = crossings(grid, origin, direction, index_of(grid, voxel))
            assert t == enter[face % 3]


@every_shape
def test_each_voxel_brackets_its_entry(shape):
    """The first one too, from wherever the ray comes."""
    for grid, origin, direction, way in walks(3, shape):
        for voxel, _, t in way:
            enter, leave = crossings(grid, origin, direction, index_of(grid, voxel))
            assert enter.max() <= t <= leave.min()


@every_shape
def test_the_first_face_says_where_the_ray_came_from(shape):
    for grid, origin, direction, way in walks(4, shape):
        if not way:
            continue
        voxel, face, t = way[0]
        low, high = ends(grid)
        if ((low < origin) & (origin < high)).all():
            assert (face, t) == (START, 0.0)
        if face != START:
            axis = face % 3
            border = 0 if direction[axis] > 0 else grid.shape[axis] - 1
            assert index_of(grid, voxel)[axis] == border
            assert face == (LOW if direction[axis] > 0 else HIGH) + axis


@every_shape
def test_a_walk_ends_at_the_border(shape):
    for grid, origin, direction, way in walks(5, shape):
        if way:
            at = np.array(index_of(grid, way[-1][0]))
            _, leave = crossings(grid, origin, direction, at)
            axis = leave.argmin()
            border = grid.shape[axis] - 1 if direction[axis] > 0 else 0
            assert at[axis] == border


@every_shape
def test_a_resumed_walk_is_the_rest_of_the_walk(shape):
    """Bit for bit, from a voxel and a face and nothing else."""
    rng = np.random.default_rng(6)
    for grid, origin, direction, way in walks(6, shape):
        for k in {0, len(way) - 1, int(rng.integers(max(1, len(way))))} if way else ():
            voxel, face, _ = way[k]
            assert grid.walk(origin, direction, voxel, face) == way[k:]


@every_shape
def test_no_voxel_is_passed_over(shape):
    """Points along the ray, well inside of their voxels, are in voxels of the walk."""
    for grid, origin, direction, way in walks(7, shape):
        if not way:
            continue
        _, leave = crossings(grid, origin, direction, index_of(grid, way[-1][0]))
        visited = {voxel for voxel, _, _ in way}
        for t in np.linspace(way[0][2], leave.min(), 50):
            at = []
            for k, planes in enumerate(grid.tables):
                x = origin[k] + t * direction[k]
                i = int(np.searchsorted(planes, x)) - 1
                margin = 1e-9 * (abs(origin[k]) + abs(x))
                if 0 <= i < grid.shape[k] and planes[i] + margin < x < planes[i + 1] - margin:
                    at.append(i)
            if len(at) == 3:
                nx, ny, _ = grid.shape
                assert at[0] + nx * (at[1] + ny * at[2]) in visited


@every_shape
def test_a_walk_of_a_ray_that_misses_is_empty(shape):
    grid = make_lattice(np.random.default_rng(8), shape)
    low, high = ends(grid)
    assert grid.walk(high + 1.0, [1.0, 1.0, 1.0]) == []
    assert grid.walk(low - 1.0, [1.0, 0.0, 0.0]) == []
    assert grid.walk([low[0] - 1.0, high[1] * 0.5 + low[1] * 0.5, np.nextafter(high[2], np.inf)],
                        [1.0, 0.0, 0.0]) == []  # fmt: skip
    assert grid.walk([low[0] - 1.0, low[1], high[2]], [1.0, 0.0, 0.0]) != []


@every_shape
def test_a_range_holds_the_grown_box(shape):
    """Of boxes anywhere, on the planes too; and not a voxel more on a side than rounding needs."""
    rng = np.random.default_rng([9, *shape])
    lo = np.float32(rng.normal(size=3) * 10).astype(float)
    grid = Grid(lo, lo + 16, shape, GROW)
    low, high = ends(grid)
    for _ in range(300):
        a, b = rng.uniform(low, high, (2, 3))
        snapped = [rng.choice(p) for p in grid.tables]
        a = np.where(rng.random(3) < 0.3, snapped, a)
        b = np.where(rng.random(3) < 0.3, a, b)
        box = np.float32([np.minimum(a, b), np.maximum(a, b)])
        first, last = grid.range_of(box.reshape(-1))
        for k, planes in enumerate(grid.tables):
            from_, to = float(box[0, k]) - 2 * GROW, float(box[1, k]) + 2 * GROW
            assert 0 <= first[k] <= last[k] < shape[k]
            assert first[k] == 0 or planes[first[k]] <= from_
            assert last[k] == shape[k] - 1 or planes[last[k] + 1] > to
            assert planes[first[k] + 1] > from_ or first[k] == shape[k] - 1
            assert planes[last[k]] <= to or last[k] == 0


def test_planes_are_ascending_and_reach_beyond_the_boxes():
    grid = Grid([0.0, -5.0, 1e6], [1.0, 5.0, 1e6 + 1], (10, 20, 30), 1e-8)
    for planes, lo, hi in zip(grid.tables, (0, -5, 1e6), (1, 5, 1e6 + 1), strict=True):
        assert (np.diff(planes) > 0).all()
        assert planes[0] <= lo - 2e-8
        assert planes[-1] >= hi + 2e-8
        assert not planes.flags.writeable
    assert grid.voxels == 6000


@given(seed=st.integers(0, 2**32), shift=st.sampled_from([1, 2, 4]))
def test_leaving_a_cube_is_walking_out_of_it(seed, shift):
    """To the last bit, on rays that are parallel, diagonal, through corners, and backwards."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 40, 3))
    grid = Grid((0.0,) * 3, shape if rng.random() < 0.5 else (1.0, 2.0, 3.0), shape, 0.0)
    planes = [np.asarray(table) for table in grid.tables]
    for turn in range(12):
        point = np.array([rng.choice(table) for table in planes])  # a corner of voxels
        way = rng.normal(0, 1, 3)
        if turn % 3 == 0:
            way = rng.choice([-1.0, 0.0, 1.0], 3)  # along axes and diagonals
        if turn % 3 == 1:
            way[rng.integers(3)] *= 1e-9
        if not way.any():
            continue
        origin = point - way * rng.choice([0.0, 0.5, 1.0, 3.0, 1e6])
        single = grid.walk(origin, way)
        expected, last = [], None
        for state in single:
            z, y, x = np.unravel_index(state[0], shape[::-1])
            cube = (x >> shift, y >> shift, z >> shift)
            if cube != last:
                expected.append(state)
            last = cube
        assert grid.walk(origin, way, shift=shift) == expected
