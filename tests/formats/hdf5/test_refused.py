"""HDF5 files that are broken or not finite, that the system refuses, or not asked right."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import numpy as np
import pytest
from failing import refuse_native_reads
from hdf5_files import CENTERS, MASS, snapshot, virtual, write
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, outcome, shapes_of, spheres

from bfrt.errors import SettingError, ShortReadError, StreamError
from bfrt.formats.object_writer import ObjectWriter

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")


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


@pytest.mark.parametrize("libver", [None, pytest.param("latest", marks=pytest.mark.slow)])
@pytest.mark.parametrize("layout", ["contiguous", "gzip"])
def test_a_file_cut_anywhere(file, layout, libver):
    write(file, snapshot(), layout, libver)
    data = file.read_bytes()
    for size in range(0, len(data), max(1, len(data) // 12)):
        file.write_bytes(data[:size])
        failure(file, radius=1, color_by="Masses")


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from(["contiguous", "gzip"]),
    st.sampled_from([None, "latest"]),
)
# The HDF5 library itself dies of a file in many thousands, and the tests with it: each run has the
# same files.
@settings(max_examples=20, derandomize=True)
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
