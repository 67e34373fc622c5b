"""Faces of more than three corners: which stay polygons, and the triangles that others become."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, shapes_of

import bfrt
from bfrt.cli import main
from bfrt.errors import SettingError
from bfrt.formats import triangulation as triangulation_module
from bfrt.formats.reading import Reading
from bfrt.formats.triangulation import Triangulation
from bfrt.records import Kind

U = [(0, 0), (3, 0), (3, 4), (2, 4), (2, 1), (1, 1), (1, 4), (0, 4)]
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
#: Two dents between teeth, their corners on lines with others.
COMB = [(0, 0), (4, 0), (4, 2), (3, 1), (2, 2), (1, 1), (0, 2)]
BOW_TIE = [(0, 0), (2, 2), (2, 0), (0, 2)]


def raised(outline, height=lambda x, y: 0.25 * x + 0.5 * y):
    """An outline as a face in space."""
    return np.array([(x, y, height(x, y)) for x, y in outline], np.float64)


def write(path, vertices, faces):
    """An OBJ file."""
    lines = ["v " + " ".join(map(repr, row)) for row in np.asarray(vertices, float).tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def write_one(path, corners):
    """A file of a single face."""
    write(path, corners, [range(len(corners))])


def newell(corners):
    """The area of a face as a vector."""
    rest = corners - corners[0]
    return np.cross(rest, np.roll(rest, -1, axis=0)).sum(axis=0) / 2


def triangles_of(corners, counts=None, dtype=np.float64):
    """The triangles of faces (k, 3, 3), and what is told of them."""
    corners = np.asarray(corners, dtype)
    counts = np.array([len(corners)] if counts is None else counts, np.uint32)
    made = Triangulation("x", Reading(triangulate=True))
    triangles = made.triangles(corners, counts, np.arange(len(counts)))
    return triangles.reshape(-1, 3, 3), made


def areas_of(triangles, normal):
    """Signed areas as seen along a normal."""
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    return np.cross(b - a, c - a) @ (normal / np.linalg.norm(normal)) / 2


def check_filled(corners, triangles):
    """The triangles fill the face, turn as it does, and have all its edges and each other's."""
    area = newell(np.asarray(corners, float))
    parts = areas_of(triangles, area)
    assert len(triangles) == len(corners) - 2
    assert parts.min() >= -1e-9 * np.linalg.norm(area)
    assert parts.sum() == pytest.approx(np.linalg.norm(area), rel=1e-9)
    check_closed(corners, triangles)


def check_closed(corners, triangles):
    """Edges that are passed one way only are those of the face."""
    ring = [tuple(row) for row in np.asarray(corners).tolist()]
    left = {}
    edges = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    for a, b, c in triangles.tolist():
        edges += [(tuple(q), tuple(p)) for p, q in ((a, b), (b, c), (c, a))]
    for p, q in edges:
        left[p, q] = left.get((p, q), 0) + 1
    assert all(count == left.get((q, p), 0) for (p, q), count in left.items())


def turned(outline, seed, dtype):
    """An outline in a plane that lies anywhere."""
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (np.asarray(outline, float) @ axes[:2] + rng.normal(size=3) * 10).astype(dtype)


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


@settings(max_examples=300)
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


@settings(max_examples=300)
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


@settings(max_examples=300)
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


# --- which faces become triangles ----------------------------------------------------------------

CUBE = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def bulged():
    """A cube one of whose corners is pulled out: three sides are not flat, three are."""
    vertices = CUBE.copy()
    vertices[7] += 0.3, 0.2, 0.1
    return vertices


def test_what_is_not_flat_becomes_triangles(tmp_path, caplog):
    file = tmp_path / "x.obj"
    write(file, bulged(), SIDES)
    triangles, polygons = convert(file).streams
    assert (triangles.kind, triangles.count) == (Kind.TRIANGLE, 6)
    assert (polygons.kind, polygons.count) == (Kind.POLYGON, 3)
    assert caplog.messages == [f"{file}: 3 faces that are not flat became 6 triangles"]
    caplog.clear()
    (polygons,) = convert(file, polygons=True).streams
    assert (polygons.kind, polygons.count) == (Kind.POLYGON, 6)
    (triangles,) = convert(file, triangulate=True).streams
    assert (triangles.kind, triangles.count) == (Kind.TRIANGLE, 12)
    write(file, CUBE, SIDES)
    (polygons,) = convert(file).streams
    assert (polygons.kind, polygons.count) == (Kind.POLYGON, 6)
    assert caplog.messages == []


def test_large_counts_have_commas(tmp_path, caplog):
    file = tmp_path / "x.obj"
    write(file, bulged(), SIDES * 500)
    convert(file)
    assert caplog.messages == [f"{file}: 1,500 faces that are not flat became 3,000 triangles"]


def test_a_closed_mesh_has_no_leak(tmp_path):
    """A ball of squares that are not flat: every ray from its middle hits it once."""
    n = 24
    grid = np.stack(np.meshgrid(*[np.tan(np.linspace(-1, 1, n + 1) * math.pi / 4)] * 2), -1)
    flat = np.concatenate([grid, np.ones((n + 1, n + 1, 1))], axis=2).reshape(-1, 3)
    rng = np.random.default_rng(0)
    vertices, faces, known = [], [], {}
    for axis in range(3):
        for sign in (1, -1):
            points = np.roll(flat * [1, sign, sign], axis, axis=1)
            index = []
            for point in np.round(points, 12):
                key = tuple((point + 0.0).tolist())
                if key not in known:
                    known[key] = len(vertices)
                    vertices.append(point / np.linalg.norm(point) * rng.uniform(0.9, 1.1))
                index.append(known[key])
            at = np.array(index).reshape(n + 1, n + 1)
            quads = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1)
            faces += quads.reshape(-1, 4).tolist()
    file = tmp_path / "ball.obj"
    write(file, vertices, faces)
    directions = rng.normal(size=(20_000, 3))
    origins = np.zeros_like(directions)

    def hits(**asked):
        scene = bfrt.open(convert(file, **asked).path)
        return bfrt.count_intersections(scene, origins, directions)["counts"]

    assert (hits() == 1).all()
    assert (hits(polygons=True) == 1).all()


@pytest.mark.parametrize("offset", [0.0, 1e6])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("seed", range(8))
def test_flat_faces_stay_polygons(offset, dtype, seed):
    """However they lie, and however far from the origin: coordinates are rounded, no more."""
    rng = np.random.default_rng(seed)
    faces = []
    for size in (3.0, 40.0, 1000.0):
        for _ in range(50):
            outline = (np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) + rng.random((4, 2)) / 4) * size
            axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            faces.append(outline @ axes[:2] + rng.uniform(-1, 1, 3) * offset)
    corners = np.concatenate(faces).astype(dtype)
    counts = np.full(len(faces), 4, np.uint32)
    assert not Triangulation("x", Reading()).wanted(corners, counts).any()


def test_heights_far_out_are_not_rounded_away():
    """A terrain in map coordinates: x and y are rounded to halves, but z is not."""
    corners = np.array([(0, 0, 5), (30, 0, 5.2), (30, 30, 5), (0, 30, 5.2)], np.float32)
    corners += np.array([500_000, 4_000_000, 100], np.float32)
    assert Triangulation("x", Reading()).wanted(corners, np.array([4], np.uint32)).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("count", [4, 7])
def test_how_flat(dtype, count):
    """Corners off by a part in a hundred thousand of their face's size are off."""
    angles = np.arange(count) * 2 * math.pi / count
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    off = (-1.0) ** np.arange(count)
    for part, bent in ((0.0, False), (1e-7, False), (1e-5, True)):
        for size in (1e-3, 1.0, 1e6):
            corners = ((ring + [[0, 0, part]] * off[:, None]) * size).astype(dtype)
            found = Triangulation("x", Reading()).wanted(corners, np.array([count], np.uint32))
            assert found.all() == bent


@pytest.mark.parametrize("asked", [{}, {"triangulate": True}])
def test_triangles_have_their_faces_colors_in_order(tmp_path, asked):
    """Triangles of the file and those of its faces are in the order of the faces."""
    file = tmp_path / "x.obj"
    names = "abcd"
    colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)]
    library = [f"newmtl {n}\nKd {c[0]} {c[1]} {c[2]}\n" for n, c in zip(names, colors, strict=True)]
    (tmp_path / "x.mtl").write_text("".join(library))
    write(file, bulged(), [])
    faces = [SIDES[1], SIDES[5], [0, 1, 2], SIDES[3]]
    text = ["mtllib x.mtl"]
    for name, face in zip(names, faces, strict=True):
        text += [f"usemtl {name}", "f " + " ".join(str(i + 1) for i in face)]
    file.write_text(file.read_text() + "\n".join(text))
    found = objects_of(convert(file, **asked))
    assert [each.color for each in found] == [colors[i] for i in (0, 0, 1, 1, 2, 3, 3)]
    for each, i in zip(found, (0, 0, 1, 1, 2, 3, 3), strict=True):
        assert set(each.shape) <= {tuple(row) for row in bulged()[faces[i]].tolist()}


def test_polygons_and_triangles_exclude_each_other(tmp_path, capsys):
    file = tmp_path / "x.obj"
    write(file, bulged(), SIDES)
    with pytest.raises(SettingError, match="triangulate, polygons: found both, expected one"):
        convert(file, triangulate=True, polygons=True)
    out = str(tmp_path / "x.bfrt")
    with pytest.raises(SystemExit) as caught:
        main(["convert", str(file), "-o", out, "--triangulate", "--polygons"])
    assert caught.value.code == 2
    assert "not allowed with argument" in capsys.readouterr().err
    assert main(["convert", str(file), "-o", out, "--polygons"]) == 0
    assert [stream.kind for stream in bfrt.open(out).store.streams] == [Kind.POLYGON]
