"""What is read of a .npz file, by the names of its arrays; and broken zips."""

from __future__ import annotations

import io
import itertools
import tracemalloc
import zipfile

import numpy as np
import pytest
from array_files import CENTERS, FACES, MASS, RADII, RNG, SAVES, TRIANGLES, colors
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, expected, failure, objects_of, outcome, shapes_of, spheres
from properties import examples

from bfrt.errors import SceneError, SettingError
from bfrt.formats import arrays as arrays_module
from bfrt.formats import naming
from bfrt.records import Kind

# --- .npz ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("name", [*naming.CENTERS, "Coordinates", "snap/POS"])
def test_points_by_their_name(npz, save, name, small_blocks):
    other = {"a string": np.array("x"), "objects": np.array([None]), "number": np.float64(1)}
    order = {"fortran": np.asfortranarray(np.ones((3, 30))), "flat": np.ones(7)}
    save(npz, **{name: CENTERS}, **other, **order)
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("name", ["radii", "radius", "Radii"])
def test_radii_by_their_name(npz, save, name, small_blocks):
    save(npz, positions=CENTERS, **{name: RADII}, size=RADII * 2)
    assert shapes_of(convert(npz)) == spheres(CENTERS, RADII)
    assert shapes_of(convert(npz, radius="size")) == spheres(CENTERS, RADII * 2)
    assert shapes_of(convert(npz, radius=3)) == spheres(CENTERS, 3)


def test_spheres_with_their_radii(npz):
    np.savez(npz, spheres=np.column_stack([CENTERS, RADII]), mass=MASS)
    assert shapes_of(convert(npz)) == spheres(CENTERS, RADII)
    assert len(set(colors(convert(npz, color_by="mass")))) == 20


def test_positions_by_a_setting(npz):
    np.savez(npz, a=CENTERS, b=CENTERS + 1, vertices=CENTERS, faces=FACES)
    assert shapes_of(convert(npz, positions="b", radius=1)) == spheres(CENTERS + 1, 1)
    assert shapes_of(convert(npz, positions="vertices", radius=1)) == spheres(CENTERS, 1)
    assert failure(npz, SettingError, positions="c", radius=1) == (
        "found no array 'c' for positions, expected one of a (20, 3) float32, "
        "b (20, 3) float32, vertices (20, 3) float32, faces (12, 3) int64"
    )


def test_several_that_may_be_positions(npz):
    np.savez(npz, pos=CENTERS, points=CENTERS, mass=MASS)
    assert failure(npz, radius=1).startswith(
        "found pos (20, 3) float32, points (20, 3) float32, expected one array named as"
    )
    assert shapes_of(convert(npz, positions="pos", radius=1)) == spheres(CENTERS, 1)
    np.savez(npz, pos=CENTERS, points=np.array(["a", "b"]), xyz=MASS)
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


def test_none_that_may_be_positions(npz):
    np.savez(npz, **{f"a{i}": MASS for i in range(20)})
    first = ", ".join(f"a{i} (20,) float64" for i in range(8))
    assert failure(npz).startswith(f"found {first}, ..., expected one array named as one of")
    np.savez(npz, **{f"{i}" * 300: MASS for i in range(9)})
    assert failure(npz).startswith(f"found {'0' * 60}... (20,) float64, {'1' * 60}... (20,) float")
    np.savez(npz)
    assert failure(npz).startswith("found no arrays, expected one")


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">i4", ">u8"])
def test_meshes(npz, dtype, small_blocks):
    np.savez_compressed(npz, vertices=CENTERS, faces=FACES.astype(dtype), points=CENTERS)
    assert shapes_of(convert(npz)) == expected(CENTERS, FACES.tolist())


def test_meshes_of_squares(npz):
    faces = [[0, 1, 2, 3], [4, 5, 6, 7]]
    np.savez(npz, vertices=CENTERS, faces=faces)
    assert shapes_of(convert(npz, polygons=True)) == expected(CENTERS, faces)
    assert [s.kind for s in convert(npz, triangulate=True).streams] == [Kind.TRIANGLE]


def test_meshes_painted_by_vertices_or_faces(npz, small_blocks):
    paint = {"colormap": "gray", "color_range": (0, 20)}
    np.savez(npz, vertices=CENTERS, faces=FACES, v=MASS, f=np.arange(12), flag=MASS > 9)
    of_faces = [color[0] for color in colors(convert(npz, color_by="f", **paint))]
    assert of_faces == sorted(of_faces) and len(set(of_faces)) == 12
    of_vertices = [color[0] for color in colors(convert(npz, color_by="v", **paint))]
    means = FACES.mean(axis=1)
    for a, b in itertools.combinations(range(12), 2):
        assert (means[a] <= means[b]) == (of_vertices[a] <= of_vertices[b]) or means[a] == means[b]
    assert convert(npz, color_by="flag").objects == 12


@pytest.mark.parametrize("index", [20, -1, 2**31 - 1, 2**63, 2**64 - 1])
def test_indices_out_of_range(npz, index, small_blocks):
    faces = FACES.astype(np.int64 if index < 2**63 else np.uint64)
    faces[7, 1] = index
    np.savez(npz, vertices=CENTERS, faces=faces)
    shown = min(index, 2**63 - 1)
    assert failure(npz) == f"face 7: found vertex {shown}, expected 0 to 19"


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (CENTERS[:, :2], FACES, "vertices: found float32 of shape (20, 2), expected (n, 3)"),
        (CENTERS, FACES.astype("f4"), "faces: found float32 of shape (12, 3), expected (n, 3)"),
        (CENTERS, FACES[:, :2], "faces: found int64 of shape (12, 2), expected"),
        (CENTERS, FACES[0], "faces: found int64 of shape (3,), expected"),
        (CENTERS.astype("U4"), FACES, "vertices: found <U4 of shape (20, 3), expected numbers"),
    ],
)
def test_meshes_of_other_shapes(npz, vertices, faces, words):
    np.savez(npz, vertices=vertices, faces=faces)
    assert failure(npz).startswith(words)


@pytest.mark.parametrize("dtype", ["u1", "u2", ">u2", "f4", "f8"])
def test_colors_of_the_files_own(npz, dtype, small_blocks):
    full = {"u1": 255, "u2": 65535, ">u2": 65535}.get(dtype, 1)
    rgb = (np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 1, 1]]) * full).astype(dtype)
    np.savez(npz, centers=CENTERS[:4], colors=rgb)
    assert colors(convert(npz, radius=1, color_by="rgb")) == [
        tuple(map(float, row)) for row in (rgb / full).tolist()
    ]
    np.savez(npz, vertices=CENTERS[:4], faces=FACES[:4] % 4, rgb=rgb)
    assert len(colors(convert(npz, color_by="rgb"))) == 4
    np.savez(npz, triangles=TRIANGLES[:4], color=rgb)
    assert colors(convert(npz, color_by="rgb"))[0] == (1, 0, 0)


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize(
    ("arrays", "asked"),
    [
        ({"positions": CENTERS, "radii": RADII, "mass": MASS}, {"color_by": "mass"}),
        ({"vertices": CENTERS, "faces": FACES, "mass": MASS}, {"color_by": "mass"}),
        ({"vertices": CENTERS, "faces": FACES, "heat": MASS[:12]}, {"color_by": "heat"}),
        ({"triangles": TRIANGLES, "heat": MASS[:9]}, {"color_by": "heat"}),
    ],
)
def test_blocks_of_any_size_make_the_same_store(npz, save, arrays, asked, monkeypatch):
    save(npz, **arrays)
    whole = convert(npz, **asked).checksum
    for size in (3, 19):
        monkeypatch.setattr(arrays_module, "POINTS_AT_ONCE", size)
        assert convert(npz, **asked).checksum == whole
    monkeypatch.undo()
    monkeypatch.setattr(arrays_module, "BLOCK_BYTES", 50)
    assert convert(npz, **asked).checksum == whole


def test_colors_are_the_same_for_blocks_of_any_size(npz, monkeypatch):
    np.savez(npz, centers=CENTERS, rgb=RNG.random((20, 3)))
    whole = objects_of(convert(npz, radius=1, color_by="rgb"))
    monkeypatch.setattr(arrays_module, "POINTS_AT_ONCE", 3)
    assert objects_of(convert(npz, radius=1, color_by="rgb")) == whole


def test_faces_of_many_corners_come_in_smaller_blocks(npz):
    """A face of a thousand corners takes what many of three take."""
    corners = np.tile(np.arange(1000), (4000, 1))
    vertices = np.column_stack([np.cos(corners[0]), np.sin(corners[0]), np.zeros(1000)])
    np.savez(npz, vertices=vertices.astype("f4"), faces=corners.astype("u2"))
    tracemalloc.start()
    try:
        assert convert(npz).objects == 4000
        assert tracemalloc.get_traced_memory()[1] < 700 << 20
    finally:
        tracemalloc.stop()


# --- broken zips ---------------------------------------------------------------------------------


def patched(data, local, central, value):
    """A zip with bytes of every local header and of every one in its directory replaced."""
    data = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", local), (b"PK\x01\x02", central)):
        at = data.find(mark)
        while at >= 0:
            data[at + offset : at + offset + len(value)] = value
            at = data.find(mark, at + 4)
    return bytes(data)


@pytest.mark.parametrize(
    ("local", "central", "value", "words"),
    [
        (6, 8, b"\x01\x00", "encrypted"),
        (6, 8, b"\x20\x00", "patched"),
        (8, 10, b"\x63\x00", "compression method"),
        (8, 10, b"\x0c\x00", "expected"),  # bzip2, which this is not
        (8, 10, b"\x0e\x00", "expected"),  # nor LZMA
    ],
)
def test_zips_that_cannot_be_read(npz, local, central, value, words):
    np.savez_compressed(npz, centers=CENTERS)
    npz.write_bytes(patched(npz.read_bytes(), local, central, value))
    assert words in failure(npz, radius=1)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_zips_of_other_compressions(npz, method):
    with zipfile.ZipFile(npz, "w", method) as archive:
        buffer = io.BytesIO()
        np.save(buffer, CENTERS)
        archive.writestr("centers.npy", buffer.getvalue())
        archive.writestr("notes.txt", "not an array")
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


@pytest.mark.parametrize("save", SAVES)
def test_a_zip_cut_at_any_byte(npz, save):
    save(npz, centers=CENTERS, radii=RADII)
    data = npz.read_bytes()
    for size in range(0, len(data), 23):
        npz.write_bytes(data[:size])
        failure(npz)


@pytest.mark.parametrize("save", SAVES)
def test_a_flipped_bit_of_the_data_is_noticed_or_changes_nothing(npz, save):
    save(npz, centers=CENTERS, radii=RADII)
    data = npz.read_bytes()
    good = convert(npz).checksum
    with zipfile.ZipFile(npz) as archive:
        info = archive.getinfo("radii.npy")
    last = data.find(b"PK\x01\x02")
    noticed = 0
    for place in range(last - info.compress_size, last, 11):
        bad = bytearray(data)
        bad[place] ^= 1 << place % 8
        npz.write_bytes(bad)
        try:
            assert convert(npz).checksum == good  # the bits behind a stream's end
        except SceneError:
            noticed += 1
    assert noticed >= info.compress_size // 11 - 1


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from(SAVES),
)
@examples(40)
@pytest.mark.filterwarnings("ignore:Reading", "ignore:Duplicate")
def test_flipped_bytes_of_zips(tmp_path_factory, flips, save):
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    save(path, vertices=CENTERS, faces=FACES, heat=MASS)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * len(data))] = value
    path.write_bytes(data)
    outcome(path, color_by="heat")


def test_what_is_no_zip(npz):
    for data in (b"", b"PK", b"PK\x05\x06" + bytes(18), bytes(1000)):
        npz.write_bytes(data)
        failure(npz)


def test_a_broken_array_that_nobody_needs(npz):
    with zipfile.ZipFile(npz, "w") as archive:
        for name, array in (("centers", CENTERS), ("broken", MASS)):
            buffer = io.BytesIO()
            np.save(buffer, array)
            data = buffer.getvalue()
            archive.writestr(f"{name}.npy", data if name == "centers" else data[:90])
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)
    assert failure(npz, radius=1, color_by="broken").startswith("broken: found 'EOF")
