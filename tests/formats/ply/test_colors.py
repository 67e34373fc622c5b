"""Colors of a PLY file, its own and those of a map; and settings that do not fit it."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import FACES, VERTICES, convert, expected, failure, objects_of, shapes_of
from ply_files import CORNERS, LAYOUTS, XYZ, gray, mesh, ply, points, rgb

from bfrt.errors import SettingError

# --- colors --------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["float", "double", "uchar", "int"])
@pytest.mark.parametrize("listed", [False, True])
def test_colors_by_a_number_of_vertices(file, layout, kind, listed):
    number = float if kind in ("float", "double") else int
    heat = [number(x) for x in (0, 10, 20, 60, 200, 100)]
    more = [("l", "uchar", "uchar")] if listed else []
    rows = [[h, *row, *[[1]] * listed] for h, row in zip(heat, VERTICES.tolist(), strict=True)]
    parts = [("vertex", [("heat", kind), *XYZ, *more], rows)]
    file.write_bytes(ply(layout, *parts, ("face", CORNERS, [[face] for face in FACES])))
    store = convert(file, color_by="heat", colormap="gray")
    by_size = sorted(FACES, key=lambda face: len(face) > 3)
    means = [np.mean([heat[i] for i in face]) for face in by_size]
    for each, mean in zip(objects_of(store), means, strict=True):
        assert each.color == pytest.approx(gray(mean, 0, 200))
    assert [each.shape for each in objects_of(store)] == expected(VERTICES, FACES)
    assert not any(stream.wide for stream in store.streams)
    store = convert(file, color_by="heat", colormap="gray", color_range=(30, 40))
    for each, mean in zip(objects_of(store), means, strict=True):
        assert each.color == pytest.approx(gray(mean, 30, 40))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("listed", [False, True])
def test_a_coordinate_is_a_number_too(file, layout, listed):
    """By height, the commonest of all: z is wanted twice."""
    more = [("l", "uchar", "uchar")] if listed else []
    rows = [[*row, *[[]] * listed] for row in VERTICES.tolist()]
    parts = [("vertex", [*XYZ, *more], rows), ("face", CORNERS, [[face] for face in FACES])]
    file.write_bytes(ply(layout, *parts))
    store = convert(file, color_by="z", colormap="gray")
    assert shapes_of(store) == expected(VERTICES, FACES)
    for each in objects_of(store):
        height = np.mean([corner[2] for corner in each.shape])
        assert each.color == pytest.approx(gray(height, 0, 9))
    file.write_bytes(ply(layout, *parts[:1]))
    store = convert(file, color_by="z", radius="z", colormap="gray")
    for each, row in zip(objects_of(store), VERTICES.tolist(), strict=True):
        assert each.shape == ((*row, row[2]),)
        assert each.color == pytest.approx(gray(row[2], 0, 9))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_colors_by_a_number_of_faces(file, layout):
    corners = [("quality", "short"), *CORNERS, ("more", "uchar")]
    rows = [[10 * i - 5, face, 0] for i, face in enumerate(FACES)]
    file.write_bytes(ply(layout, ("vertex", XYZ, VERTICES.tolist()), ("face", corners, rows)))
    found = objects_of(convert(file, color_by="quality", colormap="gray"))
    for each, quality in zip(found, [-5, 15, 5, 25], strict=True):
        assert each.color == pytest.approx(gray(quality, -5, 25))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("kind", "full"), [("uchar", 255), ("ushort", 65535), ("float", 1.0)])
@pytest.mark.parametrize("owner", ["vertex", "face", "point"])
def test_colors_of_the_files_own(file, layout, kind, full, owner):
    rng = np.random.default_rng(7)
    parts = rng.random((6, 3))
    parts[0], parts[1] = (0, 0, 0), (1, 1, 1)
    own = [[type(full)(part * full) for part in row] for row in parts]
    channels = [(name, kind) for name in ("blue", "red", "green")]
    rows = [[*row, b, r, g] for row, (r, g, b) in zip(VERTICES.tolist(), own, strict=True)]
    vertex = ("vertex", [*XYZ, *channels], rows)
    asked = {"color_by": "rgb"}
    if owner == "point":
        file.write_bytes(ply(layout, vertex))
        colors, asked["radius"] = own, 1
    elif owner == "vertex":
        file.write_bytes(ply(layout, vertex, ("face", CORNERS, [[f] for f in FACES])))
        by_size = sorted(FACES, key=lambda face: len(face) > 3)
        colors = [np.mean([own[i] for i in face], axis=0) for face in by_size]
    else:
        rows = [[face, b, r, g] for face, (r, g, b) in zip(FACES, own, strict=False)]
        bare = ("vertex", XYZ, VERTICES.tolist())
        file.write_bytes(ply(layout, bare, ("face", [*CORNERS, *channels], rows)))
        colors = [own[0], own[2], own[1], own[3]]
    found = objects_of(convert(file, **asked))
    for each, color in zip(found, colors, strict=True):
        assert each.color == pytest.approx(rgb(*np.divide(color, full)), abs=1e-6)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_colors_that_are_none_are_said(file, layout, caplog):
    """Such as those of 255 levels that are floats."""
    more = [(name, "float") for name in ("red", "green", "blue")]
    colors = [[1, 0, 0.5], [255, 0, 51], [np.nan, 0, 0], [-0.5, 2, 0], *[[1, 1, 1]] * len(VERTICES)]
    rows = [[*row, *color] for row, color in zip(VERTICES.tolist(), colors, strict=False)]
    file.write_bytes(ply(layout, ("vertex", [*XYZ, *more], rows)))
    found = objects_of(convert(file, color_by="rgb", radius=1))
    assert [each.color for each in found[1:4]] == [(1, 0, 1), (0, 0, 0), (0, 1, 0)]
    said = f"{file}: 3 colors are not from 0 to 1: the nearest that are were taken"
    assert caplog.messages[-1] == said


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("names", [("diffuse_red", "diffuse_green", "diffuse_blue"), tuple("rgb")])
@pytest.mark.parametrize("owner", ["vertex", "face", "point"])
def test_colors_by_other_names(file, layout, names, owner):
    full = [255, 0, 51]
    more = [(name, "uchar") for name in names]
    if owner == "face":
        faces = ("face", [*CORNERS, *more], [[[0, 1, 2], *full]])
        file.write_bytes(ply(layout, ("vertex", XYZ, VERTICES.tolist()), faces))
    else:
        rows = [[*row, *full] for row in VERTICES.tolist()]
        faces = [("face", CORNERS, [[[0, 1, 2]]])] if owner == "vertex" else []
        file.write_bytes(ply(layout, ("vertex", [*XYZ, *more], rows), *faces))
    asked = {"radius": 1} if owner == "point" else {}
    for each in objects_of(convert(file, color_by="rgb", **asked)):
        assert each.color == pytest.approx(rgb(1, 0, 0.2))


def test_red_green_and_blue_come_before_other_names(file):
    names = ["r", "g", "b", "diffuse_red", "diffuse_green", "diffuse_blue"]
    more = [(name, "uchar") for name in names]
    row = [0, 0, 255, 0, 255, 0]
    file.write_bytes(points("ascii", more, [row]))
    assert objects_of(convert(file, radius=1, color_by="rgb"))[0].color == (0, 1, 0)
    more += [(name, "uchar") for name in ("red", "green", "blue")]
    file.write_bytes(points("ascii", more, [[*row, 255, 0, 0]]))
    assert objects_of(convert(file, radius=1, color_by="rgb"))[0].color == (1, 0, 0)
    file.write_bytes(points("ascii", more[:2], [[1, 2]]))
    assert "found no red green blue of each vertex" in failure(
        file, SettingError, radius=1, color_by="rgb"
    )


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": 1}, "found radius=1, expected none for .ply files of this content"),
        ({"radius": "x"}, "found radius='x', expected none"),
        ({"positions": "x"}, "found positions='x', expected none"),
        ({"color_by": "heat"}, "found no heat of each vertex or face, expected one of x y z"),
        ({"color_by": "rgb"}, "found no red green blue of each vertex or face"),
        ({"color_by": "vertex_indices"}, "found no vertex_indices of each vertex or face"),
        ({"colormap": "gray"}, "found without color_by, expected with it only"),
        ({"color_range": (0, 1)}, "found without color_by"),
        ({"color_by": "x", "colormap": "nope"}, "colormap: found 'nope', expected viridis"),
        ({"color_by": "x", "color_range": (1, 0)}, "the lesser first"),
    ],
)
def test_settings_that_do_not_fit_a_mesh(file, asked, words):
    file.write_bytes(mesh())
    assert words in failure(file, SettingError, **asked)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"triangulate": True}, "found triangulate=True, expected none"),
        ({"positions": "x"}, "found positions='x'"),
        ({"color_by": "heat"}, "found no heat of each vertex, expected one of red x y z"),
        ({"color_by": "rgb"}, "found no red green blue of each vertex"),
        ({"colormap": "gray"}, "found without color_by"),
        ({"radius": float("nan")}, "radius: found nan, expected a finite number"),
        ({"radius": float("inf")}, "radius: found inf, expected a finite number"),
        ({"color_by": "x", "colormap": "nope"}, "colormap: found 'nope'"),
    ],
)
def test_settings_that_do_not_fit_points(file, asked, words):
    file.write_bytes(points("ascii", [("red", "uchar")], [[1], [2]]))
    assert words in failure(file, SettingError, **{"radius": 1, **asked})


def test_names_that_cannot_be_printed(file):
    file.write_bytes(points("ascii", [("g\x7f\x00n", "uchar")], [[1], [2]]))
    said = failure(file, SettingError, radius=1, color_by="rgb")
    assert said.endswith(r"expected one of 'g\x7f\x00n' x y z")
    data = ply("ascii", ("vertex", XYZ, [[1, 2, 3]]), ("e\x1b[m", XYZ, [[1, 2, 3]]))
    file.write_bytes(data.replace(b"[m 1\n", b"[m 99999\n"))
    assert r"for 99999 rows of 'e\x1b[m': the file is truncated" in failure(file, radius=1)


def test_a_map_for_the_files_own_colors(file):
    more = [(name, "uchar") for name in ("red", "green", "blue")]
    file.write_bytes(points("ascii", more, [[1, 2, 3]]))
    for asked in ({"colormap": "gray"}, {"color_range": (0, 1)}):
        said = failure(file, SettingError, radius=1, color_by="rgb", **asked)
        assert said == "color_by: found rgb with a map, expected rgb alone"


def test_progress_counts_bytes(file):
    file.write_bytes(mesh("binary_little_endian"))
    done = []
    convert(file, progress=done.append, order="given")
    assert max(done) == file.stat().st_size
