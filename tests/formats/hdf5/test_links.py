"""Links of an HDF5 file, and virtual datasets, whose data is in others."""

from __future__ import annotations

import errno
import os
import shutil

import numpy as np
import pytest
from hdf5_files import CENTERS, MASS, link, snapshot, virtual, write
from meshes import convert, failure, outcome, shades, shapes_of, spheres

from bfrt.errors import BfrtError, SettingError, ShortReadError, StreamError

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")


# --- links ---------------------------------------------------------------------------------------


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


@pytest.fixture
def raw(file, tmp_path_factory):
    """A file of rows and no more, which a dataset names."""
    raw = tmp_path_factory.mktemp("raw") / "secret"
    raw.write_bytes(bytes(7) + CENTERS.tobytes())
    with h5py.File(file, "w") as made:
        made.create_dataset("pos", (20, 3), "f4", external=[(str(raw), 7, 240)])
    return raw


@pytest.mark.usefixtures("raw")
def test_rows_kept_in_other_files_are_refused(file):
    """External storage would read any file as coordinates."""
    said = (
        "pos: found rows kept outside of HDF5 (external storage), expected them in HDF5 files, or "
        "external_storage=True"
    )
    assert failure(file, radius=1) == said
    assert failure(over(file), radius=1) == said


def over(file):
    """A virtual dataset over that of a file."""
    layout = h5py.VirtualLayout((20, 3), "f4")
    layout[:] = h5py.VirtualSource("a.h5", "pos", (20, 3))
    other = file.with_name("b.h5")
    with h5py.File(other, "w") as made:
        made.create_virtual_dataset("pos", layout)
    return other


@pytest.mark.usefixtures("raw")
def test_rows_kept_in_other_files_are_read_where_that_is_asked_for(file, small_blocks):
    for path in (file, over(file)):
        assert shapes_of(convert(path, radius=1, external_storage=True)) == spheres(CENTERS, 1)


def test_rows_kept_in_files_that_are_not_whole(file, raw):
    """HDF5 would read zeros, or wait."""
    os.truncate(raw, 200)
    said = f"{raw}: asked for 240 bytes at byte 7, found 193: the file is truncated"
    with pytest.raises(ShortReadError) as caught:
        convert(file, radius=1, external_storage=True)
    assert str(caught.value) == said
    raw.unlink()
    assert "No such file" in failure(file, BfrtError, radius=1, external_storage=True)
    os.mkfifo(raw)
    said = f"pos: found rows in {str(raw)!r}, which is no file, expected one"
    assert failure(file, radius=1, external_storage=True) == said


def test_other_formats_know_no_external_storage(tmp_path):
    np.save(tmp_path / "a.npy", CENTERS)
    said = failure(tmp_path / "a.npy", SettingError, radius=1, external_storage=True)
    assert said.startswith("found external_storage=True, expected none for .npy files")


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
