"""Which faces become triangles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from meshes import convert, objects_of
from outlines import write

import bfrt
from bfrt.cli import main
from bfrt.errors import SettingError
from bfrt.formats.reading import Reading
from bfrt.formats.triangulation import Triangulation
from bfrt.records import Kind

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
