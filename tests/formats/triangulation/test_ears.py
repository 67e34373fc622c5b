"""Triangles of a face, of any outline, and of faces that cross themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, shapes_of
from outlines import (
    BOW_TIE,
    COMB,
    KEYHOLE,
    U,
    areas_of,
    check_closed,
    check_filled,
    newell,
    raised,
    triangles_of,
    turned,
    write,
    write_one,
)
from properties import examples

from bfrt.formats import triangulation as triangulation_module

# --- triangles of a face -------------------------------------------------------------------------


@pytest.mark.parametrize("outline", [U, KEYHOLE, COMB, U[::-1], KEYHOLE[::-1], COMB[::-1]])
@pytest.mark.parametrize("shift", range(10))
@pytest.mark.parametrize("bump", [0.0, 0.3])
def test_concave_faces(outline, shift, bump):
    outline = np.roll(outline, shift, axis=0)
    corners = raised(outline, lambda x, y: 0.25 * x + 0.5 * y + bump * math.sin(x + 2 * y))
    triangles, made = triangles_of(corners)
    check_filled(corners, triangles)
    assert not made._crossing


def test_the_area_of_a_u(tmp_path, caplog):
    write_one(tmp_path / "u.obj", raised(U, lambda x, y: 0))
    found = shapes_of(convert(tmp_path / "u.obj", triangulate=True))
    areas = areas_of(np.array(found), np.array([0, 0, 1]))
    assert areas.min() > 0
    assert areas.sum() == 9
    assert caplog.messages == []


def test_a_hole_stays_open():
    """A keyhole's hole has no triangle: no center of one is in it, and areas are what is left."""
    triangles, _ = triangles_of(raised(KEYHOLE, lambda x, y: 0))
    assert areas_of(triangles, np.array([0, 0, 1])).sum() == 12
    x, y, _ = triangles.mean(axis=1).T
    assert not ((x > 1) & (x < 3) & (y > 1) & (y < 3)).any()


@examples(300)
@given(
    seed=st.integers(0, 1 << 30),
    count=st.integers(4, 40),
    dtype=st.sampled_from([np.float32, np.float64]),
)
def test_star_shaped_faces(seed, count, dtype):
    rng = np.random.default_rng(seed)
    angles = (np.arange(count) + rng.random(count) * 0.8) * 2 * math.pi / count
    reach = rng.uniform(0.2, 2.0, count)
    corners = turned(np.stack([reach * np.cos(angles), reach * np.sin(angles)], -1), seed, dtype)
    triangles, made = triangles_of(corners, dtype=dtype)
    check_filled(corners, triangles)
    assert not made._crossing


@examples(300)
@given(seed=st.integers(0, 1 << 30), side=st.integers(2, 6), count=st.integers(4, 30))
def test_corners_on_lines(seed, side, count):
    """Outlines on a grid, round their middle: many corners are on lines with others."""
    rng = np.random.default_rng(seed)
    points = rng.integers(-side, side + 1, (count, 2))
    points = points[points.any(axis=1)]
    angles, first = np.unique(np.arctan2(points[:, 1], points[:, 0]), return_index=True)
    outline = points[first] if len(first) > 3 else np.array(COMB)
    if np.diff(angles, append=angles[:1] + 2 * math.pi).max(initial=0) >= math.pi - 1e-9:
        outline = np.array(COMB)
    flat = raised(outline, lambda x, y: 0)
    check_filled(flat, triangles_of(flat)[0])
    corners = raised(outline, lambda x, y: (x * 7 + y * 3) % 4)
    triangles, _ = triangles_of(corners)
    assert len(triangles) == len(outline) - 2
    check_closed(corners, triangles)


def test_corners_that_are_left_out_are_put_back():
    """Between teeth whose tips are on a line earcut is left with a line."""
    outline = [(0, 0), (6, 0), (6, 2), (5, 2), (4, 0.5), (3, 2), (2, 0.5), (1, 2), (0, 2)]
    corners = raised(outline)
    left_out = np.array([[0, 1, 4], [0, 4, 6], [0, 6, 8], [1, 2, 4]])
    made = triangulation_module.closed(left_out, np.array(outline, float))
    assert len(made) == len(outline) - 2
    check_closed(corners, corners[made])


def test_a_line_is_cut_up_by_the_tip_behind_it():
    """A corner in the middle of an edge is no degenerate triangle of its own."""
    square = np.array([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], float)
    made = triangulation_module.closed(np.array([[0, 2, 3], [0, 3, 4]]), square)
    assert sorted(map(tuple, made.tolist())) == [(0, 1, 3), (0, 3, 4), (1, 2, 3)]
    check_filled(raised(square), raised(square)[made])


@examples(300)
@given(
    picked=st.lists(st.integers(0, 8), min_size=4, max_size=30),
    bump=st.sampled_from([0.0, 1.0]),
)
def test_any_face_at_all(picked, bump):
    """Faces that cross themselves, come back, or are nothing become k - 2 triangles too."""
    corners = raised([(i % 3, i // 3) for i in picked], lambda x, y: bump * x * y)
    triangles, made = triangles_of(corners)
    assert triangles.shape == (len(picked) - 2, 3, 3)
    check_closed(corners, triangles)
    area = newell(corners)
    if made._crossing == 0 and area.any():
        assert areas_of(triangles, area).sum() == pytest.approx(np.linalg.norm(area))
        assert areas_of(triangles, area).min() >= -1e-8 * np.linalg.norm(area)


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize(
    ("quad", "hub"),
    [
        ([(0, 0), (3, 0), (4, 2), (1, 2)], 1),  # the shorter
        ([(0, 0), (4, 0), (1, 1), (0, 4)], 0),  # the one inside
        ([(0, 0), (5, -1), (4, 0), (5, 1)], 0),  # the longer, the other is outside
        ([(0, 9), (0, 0), (9, 0), (1, 1)], 1),
        ([(0, 0), (2, 0), (4, 0), (2, 1)], 1),  # the one of two triangles, not of a line and one
    ],
)
def test_the_diagonal(quad, hub, turn):
    corners = np.roll(raised(quad, lambda x, y: 0), -turn, axis=0)
    triangles, _ = triangles_of(corners)
    check_filled(corners, triangles)
    ends = {(*map(float, quad[i]), 0.0) for i in (hub, (hub + 2) % 4)}
    assert all(ends <= set(map(tuple, triangle.tolist())) for triangle in triangles)


def test_the_first_of_equal_diagonals():
    square = raised([(0, 0), (2, 0), (2, 2), (0, 2)], lambda x, y: 0)
    for turn in range(4):
        corners = np.roll(square, turn, axis=0)
        assert triangles_of(corners)[0].tolist() == corners[[[0, 1, 2], [0, 2, 3]]].tolist()


def test_a_face_of_too_many_corners(tmp_path, monkeypatch):
    monkeypatch.setattr(triangulation_module, "MOST_EAR_CORNERS", 7)
    file = tmp_path / "u.obj"
    write(file, raised(U), [[0, 1, 2], range(8)])
    assert failure(file, triangulate=True) == (
        "face 1: found 8 corners that are not convex, expected at most 7 to make triangles of, or "
        "polygons= to keep it as it is"
    )
    assert convert(file, polygons=True).objects == 2
    assert convert(file).objects == 2


# --- faces that cross themselves, and those that are nothing -------------------------------------


@pytest.mark.parametrize(
    "outline", [BOW_TIE, [(0, 0), (4, 4), (4, 0), (0, 1)], [(0, 0), (4, 1), (1, 3), (3, 4), (3, 0)]]
)
def test_a_face_that_crosses_itself_is_told(tmp_path, caplog, outline):
    """It is a polygon as long as it is flat, and has a plane: what it encloses may cancel out."""
    n = len(outline)
    file = tmp_path / "x.obj"
    corners = raised(outline)
    write(file, corners, [[0, 1, 2], range(n), [2, 1, 0], range(n)])
    store = convert(file)
    assert store.objects == (6 if outline is BOW_TIE else 4)
    assert bool(caplog.messages) == (outline is BOW_TIE)
    caplog.clear()
    store = convert(file, triangulate=True)
    assert store.objects == 2 + 2 * (n - 2)
    found = np.array(shapes_of(store))
    check_closed(corners, found[1 : n - 1])
    assert caplog.messages == [
        f"{file}: 2 faces cross themselves, the first is face 1: their triangles cover more or "
        "less than they do"
    ]


@pytest.mark.parametrize("scale", [1e-12, 1.0, 3e7])
def test_a_bow_tie_that_lies_in_the_plane_is_told(tmp_path, caplog, scale):
    file = tmp_path / "x.obj"
    write(file, scale * np.array([[0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 2, 0]]), [range(4)])
    assert convert(file).objects == 2
    assert "1 faces cross themselves, the first is face 0" in caplog.messages[-1]
    assert convert(file, polygons=True).objects == 1


def test_the_number_of_a_face_counts_those_that_were_dropped(tmp_path, caplog):
    file = tmp_path / "x.obj"
    vertices = np.vstack([raised(BOW_TIE), [1e39, 0, 0]])
    write(file, vertices, [[0, 1, 4], [0, 1, 2], [0, 4, 1], range(4)])
    convert(file, triangulate=True, skip_invalid=True)
    assert caplog.messages[1].startswith(f"{file}: 1 faces cross themselves, the first is face 3:")


@pytest.mark.parametrize(
    "outline",
    [[(1, 1)] * 4, [(1, 1)] * 6, [(0, 0), (1, 1), (2, 2), (3, 3)], [(0, 0), (3, 3), (1, 1), (2, 2)],
     [(0, 0), (1, 1), (2, 2), (3, 3)] * 2, [(0, 0), (0, 0), (1, 0), (1, 0), (0, 0)]],
)  # fmt: skip
def test_faces_that_are_nothing(tmp_path, caplog, outline):
    file = tmp_path / "x.obj"
    write_one(file, raised(outline))
    for asked, count in (({}, 1), ({"polygons": True}, 1), ({"triangulate": True}, None)):
        store = convert(file, **asked)
        assert store.objects == (count or len(outline) - 2)
        assert all(stream.degenerate == stream.count for stream in store.streams)
    assert all("degenerate" in message for message in caplog.messages)


@pytest.mark.parametrize("outline", [U, [(0, 0), (2, 0), (2, 2), (0, 2)]])
def test_repeated_corners(outline):
    twice = [outline[0], outline[0], *outline[1:], outline[-1]]
    triangles, made = triangles_of(raised(twice))
    area = newell(raised(outline))
    assert areas_of(triangles, area).sum() == pytest.approx(np.linalg.norm(area))
    assert areas_of(triangles, area).min() >= 0
    assert not made._crossing
