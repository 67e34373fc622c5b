"""LAS and LAZ files that are broken, or that the system refuses."""

from __future__ import annotations

import errno
import struct
import subprocess
import sys
import time

import pytest
from failing import alone, refuse_reads
from hypothesis import given
from hypothesis import strategies as st
from las_files import COUNT, LENGTH_AT, POINTS_AT, RECORDS_AT, SCALES_AT, SUFFIXES, places, write
from meshes import convert, failure, outcome, shapes_of, spheres
from properties import examples

from bfrt.errors import BfrtError, SceneError, SettingError, ShortReadError, StreamError
from bfrt.formats.laz import asking
from bfrt.formats.source import Source

# --- broken files --------------------------------------------------------------------------------


@pytest.mark.parametrize("form", [3, 7])
def test_a_file_cut_anywhere(file, form):
    write(file, form)
    data = file.read_bytes()
    for size in range(0, len(data), 41):
        file.write_bytes(data[:size])
        failure(file, BfrtError, radius=1)


def test_a_scan_that_is_cut_between_points(tmp_path):
    file = tmp_path / "a.las"
    write(file)
    data = file.read_bytes()
    (begin,) = struct.unpack_from("<I", data, POINTS_AT)
    size = (len(data) - begin) // COUNT
    file.write_bytes(data[: begin + 4 * size])
    said = failure(file, radius=1)
    assert said.startswith(f"found 4 points, expected {COUNT}: the file is truncated or its count")


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from(SUFFIXES),
    st.sampled_from([1, 3, 7]),
    st.booleans(),
)
@examples(70)
def test_flipped_bytes(tmp_path_factory, flips, suffix, form, in_header):
    path = tmp_path_factory.mktemp("las") / f"a{suffix}"
    write(path, form)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * (400 if in_header else len(data)))] = value
    path.write_bytes(data)
    outcome(path, radius=1, color_by="intensity")


@pytest.mark.parametrize("place", [POINTS_AT, RECORDS_AT])
def test_more_records_than_fit(file, place):
    """laspy would make them all of nothing, for hours."""
    write(file)
    data = bytearray(file.read_bytes())
    struct.pack_into("<I", data, place, 0xFFFF_FFF0)
    file.write_bytes(data)
    begin = time.monotonic()
    assert failure(file, radius=1).startswith("byte 94: found a header of 227 bytes and ")
    assert time.monotonic() - begin < 5


@pytest.mark.parametrize("scale", [1e308, -1e308])
def test_scales_beyond_all_numbers_are_one_sentence(file, scale, recwarn):
    write(file)
    data = bytearray(file.read_bytes())
    struct.pack_into("<d", data, SCALES_AT, scale)
    file.write_bytes(data)
    assert "inf" in failure(file, radius=1)
    assert not recwarn.list


def test_points_of_many_bytes_are_read_a_few_at_a_time(tmp_path):
    """A record's length is two bytes of the header: with it a block of points would take 1 GB."""
    file = tmp_path / "a.las"
    write(file)
    data = bytearray(file.read_bytes())
    struct.pack_into("<HI", data, LENGTH_AT, 0xFFF0, 1 << 30)
    file.write_bytes(data)
    code = (
        "import resource, bfrt, sys\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try:\n"
        "    bfrt.convert(sys.argv[1], 'a.bfrt', radius=1, memory='512MiB')\n"
        "except bfrt.BfrtError:\n"
        "    pass\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    work = [sys.executable, "-c", code, file]
    ended = subprocess.run(work, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert int(ended.stdout) < 200 << 10


def chunks_of(laz):
    """A file's bytes, and where its table of chunks and its record of LASzip begin."""
    data = bytearray(laz.read_bytes())
    (begin,) = struct.unpack_from("<I", data, POINTS_AT)
    (table,) = struct.unpack_from("<q", data, begin)
    return data, begin, table, data.index(b"laszip encoded") + 52


@pytest.mark.parametrize("count", [COUNT + 1, 1 << 29, (1 << 31) - 1, -1])
def test_more_chunks_than_points(laz, count):
    """lazrs would ask for memory for them, and end the process when it gets none."""
    write(laz, 7)
    data, _, table, _ = chunks_of(laz)
    struct.pack_into("<i", data, table + 4, count)
    laz.write_bytes(data)
    size = 36
    most = min(COUNT, len(data) // size)
    assert (
        failure(laz, radius=1) == f"byte {table + 4}: found {count} chunks, expected at most {most}"
    )


ITEMS = [(34, 77, "is unknown"), (36, 1, "found 1 bytes for LASzip's item"),
         (36, 255, "bytes for LASzip's item"), (38, 9, "version: 9 is not supported")]  # fmt: skip


@pytest.mark.parametrize("form", [3, 7])
@pytest.mark.parametrize(("place", "byte", "words"), ITEMS)
def test_what_lazrs_does_not_know_is_one_sentence(laz, form, place, byte, words, capfd):
    """lazrs would write of its surprise to standard error, behind everyone's back."""
    write(laz, form)
    data, _, _, record = chunks_of(laz)
    data[record + place] = byte
    laz.write_bytes(data)
    said = failure(laz, radius=1)
    assert words in said
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("size", [1, 7, COUNT - 1])
def test_fewer_chunks_than_their_size_asks_for(laz, size, capfd):
    write(laz)
    data, _, table, record = chunks_of(laz)
    struct.pack_into("<I", data, record + 12, size)
    laz.write_bytes(data)
    said = f"found 1 chunks of {size} points for {COUNT}, expected {-(-COUNT // size)}"
    assert failure(laz, radius=1) == f"byte {table + 4}: {said}"
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("size", [1 << 20, 1 << 30, (1 << 32) - 2])
def test_chunks_of_more_points_than_memory_holds(laz, size):
    """They are decompressed in parts, for lazrs would ask for memory for a whole one."""
    scan = write(laz)
    data, _, _, record = chunks_of(laz)
    at = data.index(struct.pack("<I", 50_000), record - 20)
    struct.pack_into("<I", data, at, size)
    laz.write_bytes(data)
    assert shapes_of(convert(laz, radius=1)) == spheres(places(scan), 1)


@pytest.mark.parametrize(("form", "layers"), [(6, 9), (7, 10), (8, 11)])
@pytest.mark.parametrize("extra", [[], [("mass", "f4")]])
def test_layers_of_more_bytes_than_their_chunk(laz, form, layers, extra):
    """lazrs would fill memory for them with zeros: 4 GB for each layer."""
    scan = write(laz, form, extra=extra)
    assert shapes_of(convert(laz, radius=1)) == spheres(places(scan), 1)
    data, begin, _, _ = chunks_of(laz)
    sizes = begin + 8 + scan.point_format.size + 4
    for layer in range(layers + 4 * len(extra)):
        changed = bytearray(data)
        struct.pack_into("<I", changed, sizes + 4 * layer, 2_000_000_000)
        laz.write_bytes(changed)
        said = failure(laz, radius=1)
        assert said.startswith(f"byte {begin + 8}: found layers of 20000")


@pytest.mark.parametrize("table", [0, -5, -(1 << 62), 1 << 40, (1 << 63) - 1])
def test_a_table_of_chunks_that_is_nowhere(laz, table):
    write(laz)
    data, begin, _, _ = chunks_of(laz)
    struct.pack_into("<q", data, begin, table)
    laz.write_bytes(data)
    failure(laz, BfrtError, radius=1)


def test_what_is_no_las(file):
    for data in (b"", b"LASF", b"LASF" + bytes(90), bytes(1000), b"LASF" + bytes(1000)):
        file.write_bytes(data)
        failure(file, SceneError if len(data) > 104 else ShortReadError, radius=1)


class Panic(BaseException):
    """What lazrs raises where it is surprised: it is no Exception."""


def test_a_panic_is_an_error_and_an_interrupt_is_not(file):
    write(file)
    with Source(file) as source:
        said = "point 3: found 'mid > len', expected 9 points"
        with pytest.raises(SceneError, match=said), asking(source, "9 points", "point 3: "):
            raise Panic("mid > len")
        for error in (KeyboardInterrupt, SystemExit):
            with pytest.raises(error), asking(source, "points"):
                raise error


# --- the system ----------------------------------------------------------------------------------


def test_a_read_that_is_refused(file, small_blocks, monkeypatch):
    write(file)
    reads = refuse_reads(
        monkeypatch,
        file,
        lambda: convert(file, radius=1, color_by="intensity"),
        lambda: alone(file),
    )
    assert reads > 5


def test_no_such_file(file):
    with pytest.raises(StreamError) as caught:
        convert(file)
    assert caught.value.errno == errno.ENOENT


@pytest.mark.parametrize("name", ["laspy", "lazrs"])
def test_without_laspy(file, name, monkeypatch):
    write(file)
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(SettingError) as caught:
        convert(file, radius=1)
    assert str(caught.value) == f"{file}: LAS needs laspy and lazrs: install bfrt[las]"
    assert [path.name for path in file.parent.iterdir()] == [file.name]
