"""Normals of files make patches where they are asked for."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import FACES, VERTICES, convert, failure, objects_of, outcome, shapes_of, small_room
from ply_files import XYZ, ply
from properties import examples

import bfrt
from bfrt.errors import SceneError, SettingError
from bfrt.formats import source as source_module
from bfrt.records import Kind

RNG = np.random.default_rng(11)
NORMALS = RNG.normal(size=(len(VERTICES), 3)).astype("f4")
TRIANGLES = [[0, 1, 5], [5, 3, 0], [2, 5, 1]]
NXYZ = [("nx", "float"), ("ny", "float"), ("nz", "float")]
CORNERS = [("vertex_indices", "uchar", "int")]
THERE = "normals are there and not used: smooth=True (--smooth) shades by them"


def patches_of(faces, vertices=VERTICES, normals=NORMALS):
    """What `shapes_of` gives for triangles of vertices with normals."""
    rows, own = (np.asarray(a).astype("f8").tolist() for a in (vertices, normals))
    return [tuple(tuple(a[i]) for a in (rows, own) for i in face) for face in faces]


def write_ply(path, layout="ascii", faces=TRIANGLES, normals=NORMALS, more=()):
    rows = np.column_stack([VERTICES, normals, *(column for _, _, column in more)]).tolist()
    names = [*XYZ, *NXYZ, *((name, kind) for name, kind, _ in more)]
    path.write_bytes(ply(layout, ("vertex", names, rows), ("face", CORNERS, [[f] for f in faces])))


def write_obj(path, faces, vertices=VERTICES, normals=NORMALS):
    """Faces of corners that are (vertex, normal), each from 0, or a normal of None."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.float64(vertices).tolist()]
    lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in np.float64(normals).tolist()]
    for face in faces:
        corners = (f"{v + 1}" if n is None else f"{v + 1}//{n + 1}" for v, n in face)
        lines.append("f " + " ".join(corners))
    path.write_text("\n".join(lines) + "\n")


def kinds(store):
    return {stream.kind: stream.count for stream in store.streams}


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply(tmp_path, layout, caplog):
    caplog.set_level(logging.INFO, "bfrt.formats")
    path = tmp_path / "a.ply"
    write_ply(path, layout)
    store = convert(path, smooth=True)
    assert shapes_of(store) == patches_of(TRIANGLES) and kinds(store) == {Kind.PATCH: 3}
    assert not store.streams[0].wide and caplog.messages == []
    flat = convert(path)
    assert kinds(flat) == {Kind.TRIANGLE: 3}
    assert caplog.messages == [f"{path}: {THERE}"]


def test_ply_with_colors_and_by_a_normal(tmp_path):
    path = tmp_path / "a.ply"
    write_ply(path, more=[("q", "float", np.arange(6.0))])
    for name, values in (("q", np.arange(6.0)), ("nx", NORMALS[:, 0]), ("x", VERTICES[:, 0])):
        found = [
            [each.color for each in objects_of(convert(path, smooth=smooth, color_by=name))]
            for smooth in (True, False)
        ]
        assert found[0] == found[1] and len(set(found[0])) > 1, (name, values)


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
@pytest.mark.parametrize("name", ["normals", "Vertex_Normals"])
@pytest.mark.parametrize("faces", ["faces", "triangles"])
def test_arrays(tmp_path, suffix, name, faces):
    path = tmp_path / f"a{suffix}"
    heat = np.arange(6.0)
    arrays = {"m/vertices": VERTICES, f"m/{faces}": TRIANGLES, f"m/{name}": NORMALS, "m/heat": heat}
    if suffix == ".npz":
        np.savez(path, **arrays)
    else:
        h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")
        with h5py.File(path, "w") as made:
            for key, array in arrays.items():
                made[key] = array
    store = convert(path, smooth=True, color_by="heat")
    assert shapes_of(store) == patches_of(TRIANGLES)
    assert len({each.color for each in objects_of(store)}) > 1
    for positions in ("m", "/m/"):
        assert kinds(convert(path, positions=positions)) == {Kind.TRIANGLE: 3}


def test_normals_of_another_number_of_vertices(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, vertices=VERTICES, faces=TRIANGLES, normals=NORMALS[:4])
    said = failure(path, smooth=True)
    assert said == "normals: found float32 of shape (4, 3), expected numbers of shape (6, 3)"


def test_obj(tmp_path, caplog):
    """A corner's normal has a number of its own, and a face that lacks one is flat."""
    caplog.set_level(logging.INFO, "bfrt.formats")
    path = tmp_path / "a.obj"
    faces = [[(0, 3), (1, 2), (5, 1)], [(5, 0), (3, None), (0, 1)], [(2, 5), (5, 5), (1, 5)]]
    write_obj(path, faces)
    store = convert(path, smooth=True)
    assert kinds(store) == {Kind.TRIANGLE: 1, Kind.PATCH: 2} and caplog.messages == []
    rows, own = VERTICES.astype("f8").tolist(), NORMALS.astype("f8").tolist()
    right = [tuple(tuple(rows[v]) for v, _ in faces[k]) + tuple(tuple(own[n]) for _, n in faces[k])
             for k in (0, 2)]  # fmt: skip
    found = shapes_of(store)
    assert found[1:] == right and found[0] == tuple(tuple(rows[v]) for v, _ in faces[1])
    assert kinds(convert(path)) == {Kind.TRIANGLE: 3}
    assert caplog.messages == [f"{path}: {THERE}"]


def test_forms_of_a_corner(tmp_path):
    path = tmp_path / "a.obj"
    head = "v 0 0 0\nv 1 0 0\nvn 0 0 1\nv 0 1 0\nvt 0 0\nvn 0 1 0\n"
    corners = ["f 1//1 2//1 3//2", "f 1/1/1 2/1/1 3/1/2", "f -3//-2 -2//-2 -1//-1",
               "f +1/1/+1 2//1 3/1/-1", "f 1//1\\\n2//1 3//2 # one"]  # fmt: skip
    for text in corners:
        path.write_text(f"{head}{text}\n")
        found = shapes_of(convert(path, smooth=True))
        assert found == [((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1), (0, 1, 0))]


def test_faces_of_more_corners_become_patches(tmp_path):
    path = tmp_path / "a.ply"
    write_ply(path, faces=FACES)
    store = convert(path, smooth=True)
    assert kinds(store) == {Kind.PATCH: sum(len(face) - 2 for face in FACES)}
    found = shapes_of(store)
    assert [shape[:3] for shape in found] == shapes_of(convert(path, triangulate=True))
    pairs = zip(VERTICES.astype("f8").tolist(), NORMALS.astype("f8").tolist(), strict=True)
    where = {tuple(row): tuple(own) for row, own in pairs}
    for shape in found:
        assert shape[3:] == tuple(where[corner] for corner in shape[:3])


def test_a_normal_of_zeros_is_none(tmp_path):
    path = tmp_path / "a.ply"
    normals = NORMALS.copy()
    normals[2] = 0
    write_ply(path, faces=TRIANGLES, normals=normals)
    store = convert(path, smooth=True)
    assert kinds(store) == {Kind.TRIANGLE: 1, Kind.PATCH: 2}
    write_ply(path, faces=FACES, normals=normals)
    store = convert(path, smooth=True, skip_invalid=True)
    assert kinds(store)[Kind.POLYGON] == 2 and kinds(store)[Kind.PATCH] == 2


@examples(40)
@given(
    seed=st.integers(0, 1 << 20),
    n=st.integers(3, 30),
    count=st.integers(1, 20),
    room=st.sampled_from([200, 700, 1 << 20]),
    chunk=st.sampled_from([64, 200, 1 << 20]),
)
def test_as_a_naive_reader(tmp_path_factory, seed, n, count, room, chunk):
    """OBJ, whose normals are joined on disk or in memory."""
    rng = np.random.default_rng(seed)
    vertices, normals = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    faces = [[(v, None if rng.random() < 0.1 else int(rng.integers(n))) for v in
              rng.choice(n, 3, replace=False).tolist()] for _ in range(count)]  # fmt: skip
    path = tmp_path_factory.mktemp("normals") / "a.obj"
    write_obj(path, faces, vertices, normals)
    flat, smooth = [], []
    for face in faces:
        shape = tuple(tuple(vertices[v].tolist()) for v, _ in face)
        if any(k is None for _, k in face):
            flat.append(shape)
        else:
            smooth.append(shape + tuple(tuple(normals[k].tolist()) for _, k in face))
    with pytest.MonkeyPatch.context() as patch:
        small_room(patch, room)
        patch.setattr(source_module, "CHUNK_BYTES", chunk)
        store = convert(path, smooth=True)
    assert shapes_of(store) == flat + smooth


@pytest.mark.parametrize("room", [150, 1 << 20])
def test_ply_joined_on_disk_and_in_memory(tmp_path, monkeypatch, room):
    path = tmp_path / "a.ply"
    write_ply(path, "binary_little_endian")
    small_room(monkeypatch, room)
    assert shapes_of(convert(path, smooth=True)) == patches_of(TRIANGLES)


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(("corner", "said"), [
    ("3//9", "face 0: found normal 9, expected 0 to 2"),
    ("3//0", "line 6: found '3//0', expected a normal's number from 1, or from -1 back"),
    ("3//-3", "line 6: found '3//-3', expected a normal's number from 1, or from -1 back"),
    ("3//", "line 6: found '3//', expected a vertex's number, as 7"),
    ("3//x", "line 6: found '3//x', expected a vertex's number, as 7"),
    ("3/1/2/4", "line 6: found '3/1/2/4', expected a vertex's number, as 7"),
    ("3//99999999999999999999", "face 0: found normal "),
])  # fmt: skip
def test_an_obj_corner_of_no_normal(tmp_path, corner, said):
    path = tmp_path / "a.obj"
    head = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 0 1\n"
    path.write_text(f"{head}f 1//1 2//2 {corner}\n")
    assert failure(path, smooth=True).startswith(said)
    assert convert(path).objects == 1


@pytest.mark.parametrize("line", ["vn 0 0", "vn 0 x 1", "vn"])
def test_an_obj_normal_of_no_numbers(tmp_path, line):
    path = tmp_path / "a.obj"
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1//1 2//1 3//1\n")
    assert failure(path, smooth=True).startswith("line 4: found ")


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_normal_that_is_not_finite(tmp_path, bad):
    path = tmp_path / "a.ply"
    normals = NORMALS.copy()
    normals[2, 1] = bad
    write_ply(path, "binary_little_endian", normals=normals)
    assert failure(path, smooth=True).startswith("face 2: found ")
    assert convert(path, smooth=True, skip_invalid=True).objects == 2
    assert convert(path).objects == 3


def test_smooth_without_normals(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    said = failure(path, SettingError, smooth=True)
    assert said == "found smooth=True, expected none for .obj files of this content"
    said = failure(path, SettingError, smooth=True, polygons=True)
    assert said == "smooth, polygons: found both, expected one of them or none"


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_a_file_cut_anywhere(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    if suffix == ".ply":
        write_ply(path, "binary_little_endian")
    else:
        write_obj(path, [[(v, v) for v in face] for face in TRIANGLES])
    data = path.read_bytes()
    for cut in range(0, len(data), 7):
        path.write_bytes(data[:cut])
        outcome(path, smooth=True)


# --- SceneWriter.mesh ----------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("smooth", [False, True])
def test_a_mesh_of_arrays(tmp_path, dtype, smooth, monkeypatch):
    monkeypatch.setattr("bfrt.store.shape_writer.FACES_AT_ONCE", 2)
    vertices, normals = VERTICES.astype(dtype), NORMALS.astype(dtype)
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        red = writer.material(bfrt.Material((1, 0, 0)))
        blue = writer.material(bfrt.Material((0, 0, 1)))
        own = normals if smooth else None
        writer.mesh(vertices, np.uint32(TRIANGLES), own, materials=[red, blue, red])
    store = bfrt.open(tmp_path / "a.bfrt").store
    right = patches_of(TRIANGLES) if smooth else [s[:3] for s in patches_of(TRIANGLES)]
    assert shapes_of(store) == right
    assert [each.color for each in objects_of(store)] == [(1, 0, 0), (0, 0, 1), (1, 0, 0)]


@pytest.mark.parametrize(("faces", "normals", "said"), [
    ([[0, 1, 6]], None, r"faces: found \[0, 1, 6\] in face 0, expected 0 to 5"),
    ([[0, 1, 2], [0, -1, 2]], None, r"faces: found \[0, -1, 2\] in face 1, expected 0 to 5"),
    ([[0, 1]], None, r"faces: found int64 of shape \(1, 2\), expected whole numbers"),
    ([[0.0, 1.0, 2.0]], None, r"faces: found float64 of shape \(1, 3\), expected whole numbers"),
    ([[0, 1, 2]], NORMALS[:2], "normals: found 2 rows, expected 6, as many as vertices"),
    ([[0, 1, 2]], NORMALS * np.nan, "patch"),
])  # fmt: skip
def test_a_mesh_that_is_none(tmp_path, faces, normals, said):
    with (
        pytest.raises(SceneError, match=said),
        bfrt.SceneWriter(tmp_path / "a.bfrt") as writer,
    ):
        writer.mesh(VERTICES, faces, normals)
    assert list(tmp_path.iterdir()) == []


def test_a_smooth_mesh_has_the_normals_of_its_corners(tmp_path):
    """Between corners they are weighed by barycentric coordinates, as Mitsuba does."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "f4")
    normals = np.array([[0, 0, 1], [1, 0, 1], [0, 2, 1]], "f4")
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.mesh(corners, [[0, 1, 2]], normals)
    weights = np.array([[0.5, 0.25, 0.25], [0.2, 0.7, 0.1]])
    origins = weights @ corners + [0, 0, 1]
    scene = bfrt.open(tmp_path / "a.bfrt")
    camera = bfrt.Camera(tuple(origins[0]), tuple(origins[0] - [0, 0, 1]), (0, 1, 0),
                         angle=1e-4, resolution=(1, 1))  # fmt: skip
    own = weights[0] @ normals
    found = scene.render(camera=camera).channels
    n = np.array([found[f"N.{axis}"].item() for axis in "XYZ"])
    assert np.allclose(n, own / np.linalg.norm(own), atol=1e-5)


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-8-sig"])
def test_an_obj_of_another_encoding(tmp_path, encoding):
    path = tmp_path / "a.obj"
    write_obj(path, [[(v, v) for v in face] for face in TRIANGLES])
    right = shapes_of(convert(path, smooth=True))
    mark = "" if encoding.endswith("sig") else "\ufeff"
    path.write_bytes((mark + path.read_text()).encode(encoding))
    assert shapes_of(convert(path, smooth=True)) == right
    assert len(right) == 3
