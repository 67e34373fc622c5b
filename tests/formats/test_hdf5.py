"""HDF5 files as h5py writes them: datasets in are objects out, and broken ones are told of."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from failing import refuse_native_reads
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, expected, failure, objects_of, outcome, shapes_of

from bfrt.errors import SettingError, ShortReadError, StreamError
from bfrt.formats import arrays as arrays_module
from bfrt.formats import trial
from bfrt.formats.object_writer import ObjectWriter

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
    convert(file, radius=1, progress=done.append)
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
    assert said.endswith("expected one mesh, or positions= with the name of points")
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


# --- links ---------------------------------------------------------------------------------------


def link(path, **links):
    """Add links to a file: soft ones to a path, external ones to a file and a path."""
    with h5py.File(path, "a") as made:
        for name, to in links.items():
            made[name] = h5py.SoftLink(to) if isinstance(to, str) else h5py.ExternalLink(*to)


def test_soft_links(file):
    write(file, snapshot(**{"PartType1/Coordinates": CENTERS + 1}))
    link(file, Gas="/PartType0", here="Gas/Coordinates", again="/", Masses="/PartType1/Coordinates")
    for positions in ("Gas/Coordinates", "here", "again/again/Gas/Coordinates"):
        found = shapes_of(convert(file, radius=1, positions=positions))
        assert found == spheres(CENTERS, 1)
    asked = {"radius": 1, "positions": "Gas/Coordinates", "color_by": "Masses"}
    assert len(set(shades(convert(file, **asked)))) == 20


def test_external_links(file):
    """What only they lead to is found by itself too."""
    other = file.with_name("other.h5")
    write(other, snapshot())
    write(file, {"note": MASS})
    link(file, Gas=("other.h5", "/PartType0"), loop=("a.h5", "/"), there=("other.h5", "/"))
    link(other, back=("a.h5", "/"))
    for positions in (None, "Gas/Coordinates", "there/back/loop/there/PartType0/Coordinates"):
        store = convert(file, radius=1, positions=positions, color_by="Masses")
        assert shapes_of(store) == spheres(CENTERS, 1) and len(set(shades(store))) == 20


DANGLING = {
    "soft": ("/nowhere", "'/nowhere'"),
    "cycle": ("Coordinates", "'Coordinates'"),
    "file": (("no.h5", "/a"), "'/a' in the file 'no.h5'"),
    "path": (("other.h5", "/a"), "'/a' in the file 'other.h5'"),
    "text": (("text.h5", "/a"), "'/a' in the file 'text.h5'"),
    "itself": (("a.h5", "/Coordinates"), "'/Coordinates' in the file 'a.h5'"),
}


@pytest.mark.parametrize("kind", DANGLING)
def test_links_that_lead_nowhere(file, kind):
    to, told = DANGLING[kind]
    write(file, {"b": MASS})
    write(file.with_name("other.h5"), {"b": MASS})
    file.with_name("text.h5").write_text("no HDF5")
    link(file, Coordinates=to, **{"PartType0/Gas": to})
    for positions, name in ((None, "Coordinates"), ("PartType0/Gas/pos", "PartType0/Gas")):
        said = failure(file, radius=1, positions=positions)
        assert said == f"{name}: found a link to {told}, which leads nowhere, expected a dataset"
    write(file, snapshot())
    link(file, what=to)
    assert convert(file, radius=1).objects == 20  # it is in nobody's way
    assert ", what" in failure(file, SettingError, radius="no")


# --- virtual datasets ----------------------------------------------------------------------------


def virtual(path):
    """A dataset over two files of ten rows each; returns these."""
    parts = [path.with_name(f"part{k}.h5") for k in range(2)]
    layout = h5py.VirtualLayout((20, 3), "f4")
    for k, part in enumerate(parts):
        write(part, {"rows": CENTERS[10 * k : 10 * k + 10]})
        layout[10 * k : 10 * k + 10] = h5py.VirtualSource(part.name, "rows", (10, 3))
    with h5py.File(path, "w") as made:
        made.create_virtual_dataset("Coordinates", layout, fillvalue=0)
    return parts


def test_virtual_datasets(file, small_blocks):
    virtual(file)
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)


def test_virtual_datasets_are_found_from_anywhere(file, monkeypatch, tmp_path_factory):
    """By the file's own place, whatever the working folder, and where the variable says."""
    parts = virtual(file)
    monkeypatch.chdir(file.parent.parent)
    assert convert(file, radius=1).objects == 20
    monkeypatch.chdir("/")
    away = tmp_path_factory.mktemp("away")
    for part in parts:
        shutil.move(part, away / part.name)
    failure(file, radius=1)
    monkeypatch.setenv("HDF5_VDS_PREFIX", str(away))
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)
    monkeypatch.delenv("HDF5_VDS_PREFIX")
    monkeypatch.chdir(away)
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)


def test_virtual_datasets_over_virtual_ones(file, small_blocks):
    virtual(file.with_name("mid.h5"))
    layout = h5py.VirtualLayout((20, 3), "f4")
    layout[:] = h5py.VirtualSource("mid.h5", "Coordinates", (20, 3))
    with h5py.File(file, "w") as made:
        made.create_virtual_dataset("pos", layout)
        layout[:] = h5py.VirtualSource(".", "pos", (20, 3))
        made.create_virtual_dataset("again", layout)
    for positions in (None, "again"):
        found = shapes_of(convert(file, radius=1, positions=positions))
        assert found == spheres(CENTERS, 1)
    file.with_name("part1.h5").unlink()
    said = "found no dataset 'rows' in an HDF5 file 'part1.h5', expected one, which its rows are of"
    assert failure(file, radius=1) == f"pos: {said}"


@pytest.mark.parametrize("gone", ["file", "dataset", "text"])
def test_a_source_that_is_missing(file, gone):
    """HDF5 would read zeros."""
    part = virtual(file)[1]
    if gone == "dataset":
        write(part, {"other": MASS})
    elif gone == "text":
        part.write_text("no HDF5")
    else:
        part.unlink()
    said = failure(file, radius=1)
    assert said == (
        "Coordinates: found no dataset 'rows' in an HDF5 file 'part1.h5', expected one, which its "
        "rows are of"
    )


def test_a_source_of_fewer_rows(file):
    """Whether all of it is meant or some rows: HDF5 would read zeros for those."""
    part = virtual(file)[0]
    write(part, {"rows": CENTERS[:7]})
    failure(file, radius=1)
    layout = h5py.VirtualLayout((5, 3), "f4")
    layout[:] = h5py.VirtualSource(part.name, "rows", (10, 3))[4:9]
    with h5py.File(file, "w") as made:
        made.create_virtual_dataset("pos", layout)
    said = "pos: found 'rows' of shape (7, 3) in 'part0.h5', expected (9, 3) or more, which its"
    assert failure(file, radius=1).startswith(said)
    write(part, {"rows": CENTERS[:9]})
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS[4:9], 1)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is refused to this user")
def test_a_source_that_may_not_be_read(file):
    virtual(file)[1].chmod(0)
    with pytest.raises(StreamError) as caught:
        convert(file, radius=1)
    assert caught.value.errno == errno.EACCES


@pytest.mark.parametrize("length", [1, 2, 20])
def test_virtual_datasets_in_a_circle(file, length):
    """HDF5 would follow it until the stack ends."""
    files = [file, *(file.with_name(f"b{k}.h5") for k in range(1, length))]
    for k, path in enumerate(files):
        layout = h5py.VirtualLayout((20, 3), "f4")
        layout[:] = h5py.VirtualSource(files[(k + 1) % length].name, "pos", (20, 3))
        with h5py.File(path, "w") as made:
            made.create_virtual_dataset("pos", layout)
    assert failure(file, radius=1).startswith("pos: found a virtual dataset over itself, or over ")


def numbered_source(path, pattern, block=10):
    """A virtual dataset over as many datasets as there are, by h5py's lower floor."""
    plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    unlimited = h5py.h5s.UNLIMITED
    space = h5py.h5s.create_simple((0, 3), (unlimited, 3))
    space.select_hyperslab((0, 0), (unlimited, 1), (block, 1), (block, 3))
    source = h5py.h5s.create_simple((block, 3))
    plist.set_virtual(space, pattern, b"rows", source)
    with h5py.File(path, "w") as made:
        kind = h5py.h5t.py_create(np.dtype("f4"))
        h5py.h5d.create(made.id, b"pos", kind, h5py.h5s.create_simple((20, 3), (unlimited, 3)),
                        plist)  # fmt: skip


def test_sources_by_number(file, small_blocks):
    numbered_source(file, b"part%b.h5")
    parts = virtual(file.with_name("other.h5"))
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)
    parts[1].unlink()
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS[:10], 1)
    parts[0].unlink()
    said = "pos: found no dataset 'rows' in an HDF5 file 'part0.h5', expected one, which its rows"
    assert failure(file, radius=1).startswith(said)


def test_rows_kept_in_other_files_are_refused(file, tmp_path_factory):
    """External storage would read any file as coordinates."""
    raw = tmp_path_factory.mktemp("raw") / "secret"
    raw.write_bytes(CENTERS.tobytes())
    with h5py.File(file, "w") as made:
        made.create_dataset("pos", (20, 3), "f4", external=[(str(raw), 0, 240)])
    said = "pos: found rows kept outside of HDF5 (external storage), expected them in HDF5 files"
    assert failure(file, radius=1) == said
    layout = h5py.VirtualLayout((20, 3), "f4")
    layout[:] = h5py.VirtualSource("a.h5", "pos", (20, 3))
    other = file.with_name("b.h5")
    with h5py.File(other, "w") as made:
        made.create_virtual_dataset("pos", layout)
    assert failure(other, radius=1) == said


def damaged(path, seed):
    """Change a byte of what a virtual dataset is made of, or of any other of its file."""
    rng = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    heap = data.index(b"GCOL")
    place = rng.integers(heap, min(heap + 200, len(data))) if seed % 4 else rng.integers(len(data))
    data[place] = rng.integers(256)
    path.write_bytes(data)


@pytest.mark.parametrize("seed", range(12))
def test_flipped_bytes_of_virtual_datasets(file, seed):
    """HDF5 ends the process at some of them: another one, not this."""
    virtual(file)
    damaged(file, seed)
    outcome(file, radius=1)


def test_a_trial_takes_no_modules_of_the_working_folder(file, monkeypatch):
    """Such as sources of bfrt that are not built."""
    write(file, snapshot())
    (file.parent / "bfrt").mkdir()
    (file.parent / "bfrt" / "__init__.py").write_text("raise ImportError('not built')\n")
    monkeypatch.chdir(file.parent)
    trial.try_file(str(file))
    trial.try_file(file.name)


@pytest.mark.parametrize("way", ["itself", "link"])
def test_what_ends_hdf5_is_one_sentence(file, way, monkeypatch):
    """Wherever it is that leads to it."""
    monkeypatch.setattr(trial, "TRY", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)")
    virtual(file)
    if way == "link":
        file.rename(file.with_name("other.h5"))
        write(file, {"b": MASS})
        link(file, Coordinates=("other.h5", "/Coordinates"))
    said = "found what ends HDF5 itself (status -9), expected datasets that are whole"
    assert failure(file, radius=1) == said


@pytest.mark.parametrize("libver", [None, "latest"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_no_other_process_is_made_for_what_is_not_virtual(file, layout, libver, monkeypatch):
    monkeypatch.setattr(trial, "TRY", "raise SystemExit(1)")
    write(file, {**snapshot(names=["a", "b"]), "number": 3.0}, layout, libver)
    with h5py.File(file, "a") as made:
        for k in range(50):
            made["PartType0/Coordinates"].attrs[f"note {k}"] = "x" * 500
        made["soft"] = h5py.SoftLink("/PartType0")
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)


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


# --- what is not finite --------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite(file, bad, small_blocks, caplog):
    rows = CENTERS.copy()
    rows[7, 1] = rows[8, 0] = bad
    write(file, {"Coordinates": rows}, "gzip")
    assert failure(file, radius=1).startswith("point 7: found ")
    store = convert(file, radius=1, skip_invalid=True)
    assert shapes_of(store) == spheres(np.delete(rows, [7, 8], axis=0), 1)
    assert caplog.messages == [f"{file}: 2 invalid objects were dropped"]


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
def test_a_read_that_is_refused(file, layout, tmp_path_factory):
    write(file, snapshot(), layout)
    there = tmp_path_factory.mktemp("refusing")
    assert refuse_native_reads(there, file, file, radius=1, color_by="Masses") > 10


def test_a_read_of_a_source_that_is_refused(file, tmp_path_factory):
    """Also where it is HDF5 that follows the way to it."""
    parts = virtual(file)
    there = tmp_path_factory.mktemp("refusing")
    assert refuse_native_reads(there, file, parts[1], radius=1) > 5


def test_a_file_that_is_cut_while_it_is_read(file, monkeypatch, small_blocks):
    """HDF5 would read zeros."""
    write(file, {"Coordinates": CENTERS})
    size = file.stat().st_size

    def cut(writer, *given, kept=ObjectWriter.spheres):
        kept(writer, *given)
        os.truncate(file, size - 40)

    monkeypatch.setattr(ObjectWriter, "spheres", cut)
    said = f"asked for 40 bytes at byte {size - 40}, found 0: the file is truncated"
    assert failure(file, ShortReadError, radius=1) == said


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
