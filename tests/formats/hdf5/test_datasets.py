"""What is read of an HDF5 file: datasets of any layout in are objects out."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hdf5_files import CENTERS, LAYOUTS, MASS, RADII, RNG, snapshot, write
from meshes import convert, expected, failure, objects_of, shades, shapes_of, spheres

from bfrt.errors import SettingError
from bfrt.formats import arrays as arrays_module

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
def test_a_snapshot(tmp_path, layout, suffix, small_blocks):
    path = tmp_path / f"a{suffix}"
    write(path, snapshot(), layout)
    asked = {"radius": 0.5, "color_by": "Masses", "colormap": "gray"}
    for positions in (None, "PartType0/Coordinates", "/PartType0/Coordinates"):
        store = convert(path, positions=positions, **asked)
        assert shapes_of(store) == spheres(CENTERS, 0.5)
        assert shades(store) == sorted(shades(store))
        found = shades(store)
        assert len(set(found)) == 20
    for color_by in ("PartType0/Masses", "/PartType0/Masses"):
        assert shades(convert(path, **{**asked, "color_by": color_by})) == found


def test_columns_are_looked_for_beside_the_positions(file):
    """Not beside what comes first in the file, and not in another group of the same names."""
    others = {"Aaa/Masses": MASS[::-1], "Masses": np.zeros(20), "PartType1/Masses": MASS[:7]}
    write(file, snapshot(**{**others, "PartType0/Radius": RADII, "radius": RADII[:3]}))
    store = convert(file, color_by="Masses", colormap="gray")
    assert shapes_of(store) == spheres(CENTERS, RADII)
    assert shades(store) == sorted(shades(store)) and shades(store)[0] < shades(store)[-1]
    assert shapes_of(convert(file, radius="Masses")) == spheres(CENTERS, MASS)


@pytest.mark.parametrize("name", ["coordinates", "COORDINATES", "a/b/Positions", "xyz", "Pos"])
@pytest.mark.parametrize("dtype", ["f4", "f8", "f2", ">f4", "i4"])
def test_one_dataset_of_positions_is_found(file, name, dtype, small_blocks):
    rows = (CENTERS * 100).astype(dtype)
    write(file, {name: rows, "b": MASS})
    store = convert(file, radius=1)
    assert shapes_of(store) == spheres(rows, 1)
    assert store.streams[0].wide == (dtype in ("f8", "i4"))


def test_several_are_refused_and_listed(file):
    write(file, snapshot(**{"PartType1/Coordinates": CENTERS + 1}))
    found = ", ".join(f"PartType{k}/Coordinates (20, 3) float32" for k in (0, 1))
    words = f"found {found}, expected one array named as one of"
    assert failure(file, radius=1).startswith(words)
    store = convert(file, radius=1, positions="PartType1/Coordinates")
    assert shapes_of(store) == spheres(CENTERS + 1, 1)


def test_none_is_refused_and_what_is_there_listed(file):
    write(file, {"a/Masses": MASS, "b": CENTERS})
    there = "a/Masses (20,) float64, b (20, 3) float32"
    said = failure(file, radius=1)
    assert said.startswith(f"found {there}, expected one array named as")
    assert said.endswith(", or x, y and z, or vertices and faces, or positions= with its name")
    said = failure(file, SettingError, positions="c", radius=1)
    assert said == f"found no array 'c' for positions, expected one of {there}"
    write(file, {})
    assert failure(file, radius=1).startswith("found no arrays, expected one")


def test_datasets_of_other_kinds_are_in_nobodys_way(file):
    kinds = {
        "names": ["a", "bc"],
        "points": ["x", "y"],
        "fixed": np.array([b"ab", b"c"]),
        "compound": np.zeros(3, [("a", "f4"), ("b", "S3")]),
        "sub/pos": np.zeros(20, [("x", "f4"), ("y", "f4")]),
        "scalar": 3.0,
        "complex": np.zeros(4, "c8"),
        "flags": MASS > 3,
        "empty": np.zeros((0, 3)),
    }
    write(file, snapshot(**kinds))
    with h5py.File(file, "a") as made:
        made["nothing"] = h5py.Empty("f4")
        made["reference"] = np.array([made["names"].ref], h5py.ref_dtype)
        made["enum"] = np.zeros(2, h5py.enum_dtype({"A": 0}))
        made["ragged"] = np.array([np.ones(2), np.ones(3)], object).astype(h5py.vlen_dtype("f4"))
        made["linked"] = h5py.SoftLink("/PartType0/nowhere")
        made["PartType0"].attrs["text"] = "x"
        made["type"] = np.dtype("f4")
    assert shapes_of(convert(file, radius=1, color_by="Masses")) == spheres(CENTERS, 1)


def test_meshes(file, small_blocks):
    faces = RNG.integers(0, 20, (12, 3)).astype(np.uint32)
    write(file, {"vertices": CENTERS, "faces": faces, "heat": MASS[:12], "points": CENTERS}, "gzip")
    assert shapes_of(convert(file, color_by="heat")) == expected(CENTERS, faces.tolist())


def test_triangles_and_spheres(file, small_blocks):
    triangles = RNG.normal(size=(9, 3, 3)).astype(np.float32)
    write(file, {"triangles": triangles, "heat": MASS[:9]}, "chunked")
    store = convert(file, color_by="heat")
    assert shapes_of(store) == [tuple(map(tuple, each)) for each in triangles.tolist()]
    write(file, {"balls/spheres": np.column_stack([CENTERS, RADII])})
    assert shapes_of(convert(file)) == spheres(CENTERS, RADII)


def test_colors_of_the_files_own(file):
    red, blue = np.tile([255, 0, 0], (20, 1)), np.tile([0, 0, 255], (20, 1))
    write(file, snapshot(**{"PartType0/Colors": red.astype("u1"), "PartType1/Colors": blue}))
    store = convert(file, radius=1, color_by="rgb")
    assert {each.color for each in objects_of(store)} == {(1, 0, 0)}


def test_blocks_and_layouts_make_the_same_store(file, monkeypatch):
    found = set()
    for layout, size in itertools.product(LAYOUTS, (3, 7, 100)):
        monkeypatch.setattr(arrays_module, "POINTS_AT_ONCE", size)
        write(file, snapshot(), layout, "latest" if size == 7 else None)
        found.add(convert(file, radius=1, color_by="Masses").checksum)
    assert len(found) == 1


def test_map_coordinates_keep_centimeters(file):
    rows = np.array([[500_000.0, 5_400_000.0, 300.0], [500_000.05, 5_400_000.0, 300.0]])
    write(file, {"Coordinates": rows})
    store = convert(file, radius=0.01)
    assert shapes_of(store) == spheres(rows, 0.01)
    assert np.linalg.norm(np.subtract(store.origin, rows[0])) < 1


def test_progress_counts_bytes(file):
    write(file, snapshot())
    done = []
    convert(file, radius=1, progress=done.append, order="given")
    assert done[-1] == max(done) == file.stat().st_size


# --- other layouts -------------------------------------------------------------------------------


@pytest.mark.parametrize("names", ["xyz", "XYZ"])
def test_positions_in_three_datasets(file, names, small_blocks):
    """As openPMD has them, with columns beside the folder that they are in."""
    columns = dict(zip(names, CENTERS.T, strict=True))
    e = "data/0/particles/e"
    write(
        file,
        {
            **{f"{e}/position/{name}": column for name, column in columns.items()},
            **{f"{e}/momentum/{name}": MASS for name in names},
            **{f"data/0/fields/E/{name}": np.zeros((2, 3, 4)) for name in names},
            f"{e}/weighting": MASS,
            f"{e}/radius": RADII,
        },
        "gzip",
    )
    for positions in (None, f"{e}/position", f"/{e}/position/"):
        store = convert(file, positions=positions, color_by="weighting", colormap="gray")
        assert shapes_of(store) == spheres(CENTERS, RADII)
        assert shades(store) == sorted(shades(store)) and len(set(shades(store))) == 20


def test_three_datasets_of_any_group(file):
    write(file, {"a/x": MASS, "a/y": MASS, "a/z": MASS, "b": MASS})
    assert shapes_of(convert(file, radius=1)) == spheres(np.tile(MASS[:, None], 3), 1)
    write(file, {f"{group}/{axis}": MASS for group in "ab" for axis in "xyz"})
    assert failure(file, radius=1).startswith("found a/x (20,) float64, a/y (20,) float64, a/z")
    assert convert(file, radius=1, positions="b").objects == 20


def test_the_last_frame(file, small_blocks):
    """As H5MD has them: each in a group of its name."""
    frames = np.stack([CENTERS + 2, CENTERS + 1, CENTERS])
    values = {"position": frames, "mass": np.stack([MASS * 0, MASS * 0, MASS]),
              "radius": np.stack([RADII + 1, RADII + 1, RADII])}  # fmt: skip
    write(file, {f"particles/all/{name}/value": array for name, array in values.items()}, "gzip")
    name = "particles/all/position/value"
    for positions in (None, name, "particles/all/position"):
        store = convert(file, positions=positions, color_by="mass", colormap="gray")
        assert shapes_of(store) == spheres(CENTERS, RADII)
        assert shades(store) == sorted(shades(store)) and len(set(shades(store))) == 20
    write(file, {name: frames[:0]})
    said = f"{name}: found no frames, expected one or more"
    assert failure(file, radius=1) == said


def test_meshes_in_a_group(file):
    faces = RNG.integers(0, 20, (12, 3))
    write(file, {"a/Mesh/Vertices": CENTERS, "a/Mesh/Faces": faces, "a/Mesh/heat": MASS[:12]})
    store = convert(file, color_by="heat")
    assert shapes_of(store) == expected(CENTERS, faces.tolist()) and len(set(shades(store))) > 6
    write(file, {f"{group}/{name}": data for group in "ab" for name, data in
                 (("vertices", CENTERS), ("faces", faces))})  # fmt: skip
    said = failure(file)
    assert said.startswith("found a/vertices (20, 3) float32, a/faces (12, 3) int64, b/vertices")
    assert said.endswith("one mesh, or positions= with the name of points or of one's group")
    for positions in ("b", "/b/"):
        asked = convert(file, positions=positions)
        assert shapes_of(asked) == expected(CENTERS, faces.tolist())
    assert convert(file, positions="b/vertices", radius=1).objects == 20


def test_compound_datasets(file, small_blocks):
    rows = np.zeros(20, [("X", "f4"), ("Y", "f4"), ("Z", "f4"), ("m", "f8"), ("r", "u1"),
                         ("g", "u1"), ("b", "u1")])  # fmt: skip
    for name, column in zip("XYZ", CENTERS.T, strict=True):
        rows[name] = column
    rows["m"], rows["g"] = MASS, 255
    write(file, {"step/cloud": rows, "step/log": np.zeros(3, [("t", "f8"), ("text", "S4")])})
    for positions in (None, "step/cloud"):
        store = convert(file, positions=positions, radius="m", color_by="rgb")
        assert shapes_of(store) == spheres(CENTERS, MASS)
        assert {each.color for each in objects_of(store)} == {(0, 1, 0)}
    assert "step/log/t (3,) float64" in failure(file, SettingError, radius="no")


# --- compression ---------------------------------------------------------------------------------


def test_a_filter_that_is_missing_is_named(file):
    with h5py.File(file, "w") as made:
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((10, 3))
        plist.set_filter(32099, h5py.h5z.FLAG_OPTIONAL)
        kind, space = h5py.h5t.py_create(np.dtype("f4")), h5py.h5s.create_simple((20, 3))
        made_id = h5py.h5d.create(made.id, b"pos", kind, space, plist)
        for first in (0, 10):
            h5py.Dataset(made_id).id.write_direct_chunk((first, 0), CENTERS[:10].tobytes())
    said = failure(file, radius=1)
    assert said.startswith("pos: found rows compressed by filter 32099 (no name), expected one")
