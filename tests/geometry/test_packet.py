"""Boxes in vector lanes, eight at a time: the same, bit for bit, as one at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import units

from bfrt.grid.grid import Grid
from bfrt.records import Kind
from bfrt.reference import _kernels
from bfrt.store._bounds import bound

#: Faces by which a voxel is entered: low ones of three axes, high ones, and none for a start.
LOW, HIGH, START = 0, 3, 6

#: An empty box, and the voxels of one.
NONE = np.array([np.inf] * 3 + [-np.inf] * 3, np.float32)
NOWHERE = [2**31 - 1] * 3 + [-1] * 3

coordinates = st.floats(-(2.0**100), 2.0**100, width=32)
radii = st.one_of(st.just(0.0), st.floats(-(2.0**100), 2.0**100, width=32))
spheres = st.lists(st.tuples(coordinates, coordinates, coordinates, radii), min_size=1, max_size=8)


@given(spheres, st.sampled_from([np.float32, np.float64]), st.tuples(*[coordinates] * 3))
def test_boxes_of_spheres(rows, dtype, origin):
    records = np.array(rows, dtype)
    wide = dtype is np.float64
    expected = np.empty((len(rows), 6), np.float32)
    none = np.zeros(len(rows), np.uint32)
    bound(Kind.SPHERE, records, none, origin, expected)
    found, around = _kernels.sphere_boxes(
        records.view(np.uint8).reshape(len(rows), -1), wide, origin
    )
    np.testing.assert_array_equal(found[: len(rows)].view(np.uint32), expected.view(np.uint32))
    assert (found[len(rows) :] == NONE).all()
    low, high = found[:, :3].min(axis=0), found[:, 3:].max(axis=0)
    assert (around[:3] <= low).all()
    assert (around[3:] >= high).all()
    if records[:, 3].all():
        np.testing.assert_array_equal(around, np.concatenate([low, high]))


def test_rounding_where_numbers_vanish():
    """Of a radius that float32 does not have, a side is the least number below zero, not zero."""
    records = np.array([[0.0, 1e-60, -1e-60, 1e-50]])
    found, _ = _kernels.sphere_boxes(records.view(np.uint8), True, (0, 0, 0))
    least = np.nextafter(np.float32(0), np.float32(1))
    np.testing.assert_array_equal(found[:1], [[-least, -least, -least, least, least, least]])


@pytest.mark.parametrize("count", range(1, 9))
def test_spans(count):
    rng = np.random.default_rng(count)
    corners = rng.integers(-3, 4, size=(count, 2, 3)).astype(np.float32)
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    origins = rng.integers(-4, 5, size=(300, 3)).astype(float)
    directions = np.where(rng.random((300, 3)) < 0.3, 0.0, units(rng, 300))
    directions[:20, 0] = 5e-324  # of which the inverse is infinite
    reach = 2.5
    found, hit = _kernels.spans_of_eight(boxes, 0.25, origins, directions, reach)
    for i, box in enumerate(boxes):
        own = np.tile(box, (len(origins), 1))
        expected = _kernels.spans(own, 0.25, origins, directions)
        met = expected[:, 0] <= expected[:, 1]
        np.testing.assert_array_equal(found[met, i], expected[met])
        np.testing.assert_array_equal(hit >> i & 1, met & (expected[:, 0] <= reach))
        assert (found[~met, i, 0] > found[~met, i, 1]).all()
        assert 0 < met.sum() < len(met)


@given(st.integers(0, 2**32), st.integers(1, 8))
def test_voxels(seed, count):
    """Those of each box by itself, where sides lie on planes of the grid, and outside it, too."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(1, 9, 3))
    grid = Grid((-1.0, 0.0, 2.0), (3.0, 5.0, 3.0), shape, 2.0**-40)
    planes = [
        np.linspace(lo, hi, n + 1) for lo, hi, n in zip((-1, 0, 2), (3, 5, 3), shape, strict=True)
    ]
    corners = np.stack([rng.choice(p, (count, 2)) for p in planes], axis=-1)
    corners += rng.choice([0.0, 1e-7, -1e-7, 0.1, 9.0], corners.shape)
    boxes = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1).astype(np.float32)
    boxes[rng.random(count) < 0.2] = NONE
    voxels, around = _kernels.voxels_of_eight(boxes, grid)
    for box, found in zip(boxes, voxels[:count], strict=True):
        expected = NOWHERE if box[0] > box[3] else [*sum(grid.range_of(box), ())]
        assert found.tolist() == expected
    assert (voxels[count:] == NOWHERE).all()
    np.testing.assert_array_equal(around[:3], boxes[:, :3].min(axis=0))
    np.testing.assert_array_equal(around[3:], boxes[:, 3:].max(axis=0))


@given(st.integers(0, 2**32), st.integers(1, 8), st.floats(-30, 30))
def test_decoded_boxes_and_the_box_around_them(seed, count, scale):
    rng = np.random.default_rng(seed)
    ends = np.sort((rng.normal(0, 1, (2, 3)) * 2.0**scale).astype(np.float32), axis=0)
    codes = rng.integers(0, rng.choice([2, 256]), (count, 6)).astype(np.uint8)
    boxes, around = _kernels.decoded_eight(ends.reshape(-1), codes)
    step = np.abs(ends[1].astype(np.float64) - ends[0]) / 255
    lo = ends[0] + codes[:, :3] * step
    hi = ends[1] - codes[:, 3:] * step
    np.testing.assert_allclose(boxes[:count], np.hstack([lo, hi]), rtol=0, atol=1e-5 * 2.0**scale)
    assert (boxes[count:] == NONE).all()
    np.testing.assert_array_equal(around[:3], boxes[:count, :3].min(axis=0))
    np.testing.assert_array_equal(around[3:], boxes[:count, 3:].max(axis=0))


triples = st.tuples(*[st.integers(0, 3)] * 3)
rows_of_regions = st.lists(st.tuples(triples, triples, st.booleans()), min_size=1, max_size=8)


@given(
    rows_of_regions, st.lists(st.tuples(triples, st.integers(0, START)), min_size=1, max_size=64)
)
def test_regions_that_are_entered(rows, entries):
    corners = np.array([row[:2] for row in rows], np.int32)
    ranges = np.tile(np.array(NOWHERE, np.int32), (8, 1))
    ranges[: len(rows)] = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    ranges[: len(rows)][[row[2] for row in rows]] = NOWHERE
    voxels = np.array([entry[0] for entry in entries], np.int32)
    faces = np.array([entry[1] for entry in entries], np.uint8)
    found = _kernels.entered_of_eight(np.ascontiguousarray(ranges.T), voxels, faces)
    for j, (voxel, face) in enumerate(zip(voxels, faces, strict=True)):
        expected = 0
        for i in range(8):
            inside = (ranges[i, :3] <= voxel).all() and (voxel <= ranges[i, 3:]).all()
            if face < HIGH:
                inside = inside and voxel[face - LOW] == ranges[i, face - LOW]
            elif face < START:
                inside = inside and voxel[face - HIGH] == ranges[i, face]
            expected |= int(inside) << i
        assert found[j] == expected
