"""HDF5 files as h5py writes them: datasets in are objects out, and broken ones are told of."""

from __future__ import annotations

import errno
import itertools
import subprocess
import sys

import numpy as np
import pytest
from failing import alone, refuse_reads
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, expected, failure, objects_of, outcome, shapes_of

from bfrt.errors import SettingError, StreamError
from bfrt.formats import arrays as arrays_module

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")

RNG = np.random.default_rng(6)
CENTERS = RNG.normal(size=(20, 3)).astype(np.float32)
RADII = RNG.uniform(0.1, 1, 20).astype(np.float32)
MASS = np.arange(20.0)

#: How datasets are laid out.
LAYOUTS = {
    "contiguous": {},
    "chunked": {"chunks": True},
    "small chunks": {"chunks": (3,)},
    "gzip": {"chunks": (7,), "compression": "gzip", "shuffle": True, "fletcher32": True},
}


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.h5"


def write(path, datasets, layout="contiguous", libver=None):
    """A file of datasets by their names."""
    how = LAYOUTS[layout]
    with h5py.File(path, "w", libver=libver) as made:
        for name, data in datasets.items():
            array = np.asarray(data)
            own = dict(how) if array.ndim and array.dtype.kind in "fiu" else {}
            if isinstance(own.get("chunks"), tuple):
                own["chunks"] = (min(*own["chunks"], len(array)), *array.shape[1:])
            made.create_dataset(name, data=data, **own)


def snapshot(**more):
    """Datasets as simulations name them."""
    return {"PartType0/Coordinates": CENTERS, "PartType0/Masses": MASS, **more}


def spheres(centers, radii):
    rows = np.column_stack([centers, np.broadcast_to(radii, len(centers))])
    return [(tuple(row),) for row in rows.astype(np.float64).tolist()]


def shades(store):
    return [each.color[0] for each in objects_of(store)]


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
        assert len(set(shades(store))) == 20
    for color_by in ("PartType0/Masses", "/PartType0/Masses"):
        assert shades(convert(path, **{**asked, "color_by": color_by})) == shades(store)


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
    words = "found PartType0/Coordinates, PartType1/Coordinates, expected one array named as one of"
    assert failure(file, radius=1).startswith(words)
    store = convert(file, radius=1, positions="PartType1/Coordinates")
    assert shapes_of(store) == spheres(CENTERS + 1, 1)


def test_none_is_refused_and_what_is_there_listed(file):
    write(file, {"a/Masses": MASS, "b": CENTERS})
    assert failure(file, radius=1).startswith("found a/Masses, b, expected one array named as")
    said = failure(file, SettingError, positions="c", radius=1)
    assert said == "found no array 'c' for positions, expected one of a/Masses, b"
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
        monkeypatch.setattr(arrays_module, "BLOCK", size)
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
    convert(file, radius=1, progress=done.append)
    assert done[-1] == max(done) == file.stat().st_size


# --- what is not finite --------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite(file, bad, small_blocks, caplog):
    rows = CENTERS.copy()
    rows[7, 1] = rows[8, 0] = bad
    write(file, {"Coordinates": rows}, "gzip")
    assert failure(file, radius=1).startswith("point 7: found ")
    store = convert(file, radius=1, skip_invalid=True)
    assert shapes_of(store) == spheres(np.delete(rows, [7, 8], axis=0), 1)
    assert caplog.messages == [f"{file}: 2 objects that are not finite were dropped"]


# --- broken files --------------------------------------------------------------------------------


@pytest.mark.parametrize("libver", [None, "latest"])
@pytest.mark.parametrize("layout", ["contiguous", "gzip"])
def test_a_file_cut_anywhere(file, layout, libver):
    write(file, snapshot(), layout, libver)
    data = file.read_bytes()
    for size in range(0, len(data), max(1, len(data) // 40)):
        file.write_bytes(data[:size])
        failure(file, radius=1, color_by="Masses")


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from(["contiguous", "gzip"]),
    st.sampled_from([None, "latest"]),
)
@settings(max_examples=50)
def test_flipped_bytes(tmp_path_factory, flips, layout, libver):
    path = tmp_path_factory.mktemp("h5") / "a.h5"
    write(path, snapshot(names=["a", "bc"]), layout, libver)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * len(data))] = value
    path.write_bytes(data)
    outcome(path, radius=1, color_by="Masses")


ERRORS_THAT_ARE_KEPT = """
import ctypes
import sys
import bfrt
for path in sys.argv[1:]:
    try:
        bfrt.convert(path, path + ".bfrt", radius=1)
    except bfrt.SceneError as error:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(error))  # for longer than Python is there
    else:
        sys.exit("converted")
"""


def test_the_process_ends_well_after_broken_files(tmp_path):
    """HDF5, which closes what is open then, must have nothing of Python's."""
    whole = tmp_path / "a.h5"
    write(whole, snapshot(), "gzip")
    data = whole.read_bytes()
    cuts = [tmp_path / f"{size}.h5" for size in (10, 100, 1000, len(data) - 1)]
    for cut in cuts:
        cut.write_bytes(data[: int(cut.stem)])
    child = [sys.executable, "-c", ERRORS_THAT_ARE_KEPT, *map(str, cuts)]
    ended = subprocess.run(child, cwd=tmp_path, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_a_flipped_byte_of_a_row_that_is_checked(file, small_blocks):
    write(file, {"Coordinates": CENTERS}, "gzip")
    with h5py.File(file) as made:
        place = made["Coordinates"].id.get_chunk_info(1).byte_offset
    data = bytearray(file.read_bytes())
    data[place + 20] ^= 255
    file.write_bytes(data)
    said = failure(file, radius=1)
    assert said.startswith("Coordinates: row 6: found ")
    assert said.endswith(", expected rows that can be read")


def test_names_that_are_no_text(file):
    with h5py.File(file, "w") as made:
        made["Coordinates"] = CENTERS
        made[b"M\xff"] = MASS
        made["two\nlines"] = MASS
    assert convert(file, radius=1).objects == 20
    failure(file, SettingError, radius=1, color_by="none")
    assert convert(file, radius=1, color_by="two\nlines").objects == 20


def test_what_is_no_hdf5(file):
    for data in (b"", b"\x89HDF\r\n\x1a\n", b"text", bytes(5000)):
        file.write_bytes(data)
        assert failure(file, radius=1).endswith(", expected an HDF5 file")


# --- the system ----------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["contiguous", "gzip"])
def test_a_read_that_is_refused(file, layout, monkeypatch):
    write(file, snapshot(), layout)
    reads = refuse_reads(
        monkeypatch, file, lambda: convert(file, radius=1, color_by="Masses"), lambda: alone(file)
    )
    assert reads > 10


def test_no_such_file(file):
    with pytest.raises(StreamError) as caught:
        convert(file)
    assert caught.value.errno == errno.ENOENT


def test_without_h5py(file, monkeypatch):
    write(file, snapshot())
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(SettingError) as caught:
        convert(file, radius=1)
    assert str(caught.value) == f"{file}: HDF5 needs h5py: install bfrt[hdf5]"
    assert [path.name for path in file.parent.iterdir()] == [file.name]


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": None}, "found points without a radius, expected radius="),
        ({"triangulate": True}, "found triangulate=True, expected none for .h5 files"),
        ({"radius": "no"}, "found no array 'no' for radius, expected one of PartType0/Coordinates"),
        ({"color_by": "no"}, "found no array 'no' for color_by, expected one of PartType0/Coor"),
        ({"color_by": "flat"}, "flat: found float64 of shape (7,), expected numbers of shape (20,"),
        ({"radius": "flat"}, "flat: found float64 of shape (7,), expected numbers of shape (20,)"),
        ({"color_by": "names"}, "names: found object of shape (2,), expected numbers"),
        ({"color_by": "rgb"}, "expected one array of colors (n, 3), named as one of colors, rgb"),
        ({"color_range": (0, 1)}, "found without color_by, expected with it only"),
    ],
)
def test_settings_that_do_not_fit(file, asked, words):
    write(file, snapshot(flat=np.ones(7), names=["a", "b"]))
    assert words in failure(file, SettingError, **{"radius": 1, **asked})
