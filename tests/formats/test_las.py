"""LAS and LAZ files as laspy writes them: scans in are spheres out, and broken ones are told of."""

from __future__ import annotations

import errno
import struct
import sys
import time

import numpy as np
import pytest
from failing import alone, refuse_reads
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, outcome, shapes_of

from bfrt.errors import BfrtError, SceneError, SettingError, ShortReadError, StreamError
from bfrt.formats import las as las_module
from bfrt.formats import laz as laz_module
from bfrt.formats.colors import linear
from bfrt.formats.laz import asking
from bfrt.formats.source import Source

laspy = pytest.importorskip("laspy", reason="laspy is not installed: bfrt[las]")
lazrs = pytest.importorskip("lazrs", reason="lazrs is not installed: bfrt[las]")

RNG = np.random.default_rng(7)
COUNT = 30
UTM = np.array([500_000.0, 5_400_000.0, 300.0])
FORMATS = [0, 1, 2, 3, 6, 7, 8]
COLORED = {2, 3, 7, 8}
SUFFIXES = [".las", ".laz"]

#: Where a header has the number of its records, where points begin, and how they are scaled.
POINTS_AT, RECORDS_AT, SCALES_AT = 96, 100, 131


@pytest.fixture(params=SUFFIXES)
def file(request, tmp_path):
    return tmp_path / f"a{request.param}"


@pytest.fixture
def laz(tmp_path):
    return tmp_path / "a.laz"


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(las_module, "POINTS_AT_ONCE", 7)


def write(path, form=3, count=COUNT, offset=UTM, scale=0.001, extra=()):
    """A scan of some points; returns what laspy reads of it."""
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.scales, header.offsets = [scale] * 3, offset
    for name, kind in extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    scan = laspy.LasData(header)
    rng = np.random.default_rng(count)
    scan.x, scan.y, scan.z = (offset + rng.uniform(-50, 50, (count, 3))).T
    scan.intensity = np.arange(count) * 1000 % 65536
    scan.classification = np.arange(count) % 3
    if form in COLORED:
        scan.red, scan.green, scan.blue = rng.integers(0, 65536, (3, count))
    for name, kind in extra:
        scan[name] = rng.uniform(0.5, 2, (count, int(kind[0]))) if kind[0].isdigit() else (
            rng.uniform(0.5, 2, count)
        )  # fmt: skip
    scan.write(path)
    return laspy.read(path)


def places(scan):
    return np.stack([np.asarray(scan.x), np.asarray(scan.y), np.asarray(scan.z)], axis=1)


def spheres(centers, radii):
    rows = np.column_stack([centers, np.broadcast_to(radii, len(centers))])
    return [(tuple(row),) for row in rows.astype(np.float64).tolist()]


def shades(store):
    return [each.color[0] for each in objects_of(store)]


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMATS)
def test_points_of_every_format(file, form, small_blocks):
    scan = write(file, form)
    store = convert(file, radius=0.05)
    assert shapes_of(store) == spheres(places(scan), 0.05)
    assert store.streams[0].wide


@given(
    st.integers(0, 60),
    st.sampled_from([0.1, 0.01, 0.001, 1e-7]),
    st.sampled_from(SUFFIXES),
    st.integers(1, 70),
)
@settings(max_examples=20)
def test_round_trip(tmp_path_factory, count, scale, suffix, block):
    path = tmp_path_factory.mktemp("las") / f"a{suffix}"
    scan = write(path, 3, count, UTM, scale)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(las_module, "POINTS_AT_ONCE", block)
        assert shapes_of(convert(path, radius=1)) == spheres(places(scan), 1)


def test_map_coordinates_keep_centimeters(file):
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = [0.01] * 3, np.floor(UTM)
    scan = laspy.LasData(header)
    rows = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]]) + UTM
    scan.x, scan.y, scan.z = rows.T
    scan.write(file)
    store = convert(file, radius=0.01)
    found = np.array(shapes_of(store))[:, 0, :3]
    assert np.abs(found - rows).max() < 1e-6
    assert np.linalg.norm(np.subtract(store.origin, UTM)) < 1
    assert np.abs(np.diff(found[:2, 0]) - 0.05) < 1e-6


@pytest.mark.parametrize("name", ["intensity", "classification", "x", "z", "Z", "gps_time"])
def test_colors_by_a_dimension(file, name, small_blocks):
    scan = write(file)
    asked = {"radius": 1, "color_by": name, "colormap": "gray"}
    found = np.array(shades(convert(file, **asked)))
    values = np.asarray(scan[name], np.float64)
    order = np.argsort(values, kind="stable")
    assert (np.diff(found[order]) >= 0).all()
    assert found[order[-1]] > found[order[0]] or values.min() == values.max()
    given_range = {"color_range": (float(values.min()), float(values.max()))}
    assert np.array_equal(shades(convert(file, **asked, **given_range)), found)


@pytest.mark.parametrize("form", sorted(COLORED))
def test_colors_of_the_files_own(file, form, small_blocks):
    scan = write(file, form)
    found = np.array([each.color for each in objects_of(convert(file, radius=1, color_by="rgb"))])
    encoded = np.where(found <= 0.0031308, found * 12.92, 1.055 * found ** (1 / 2.4) - 0.055)
    rgb = np.stack([scan.red, scan.green, scan.blue], axis=1) / 65535
    assert np.abs(encoded - rgb).max() <= 0.5 / 31 + 1e-6


def test_radii_of_a_dimension(file, small_blocks):
    scan = write(file, 3, extra=[("size", "f4"), ("many", "3f4")])
    asked = {"radius": "size", "color_by": "intensity"}
    assert shapes_of(convert(file, **asked)) == spheres(places(scan), np.asarray(scan["size"]))
    for setting in ("radius", "color_by"):
        said = failure(file, SettingError, **{**asked, setting: "many"})
        assert said.startswith("found no dimension 'many', expected one of X, Y, Z, ")


def test_an_empty_scan(file):
    write(file, count=0)
    assert convert(file, radius=1).objects == 0


def test_blocks_and_threads_make_the_same_spheres(laz, monkeypatch):
    """Chunks that are larger than usual are decompressed in parts, and those are the same."""
    write(laz, count=200)
    whole = objects_of(convert(laz, radius=1, color_by="intensity"))
    monkeypatch.setattr(las_module, "POINTS_AT_ONCE", 33)
    for most in (laz_module.MOST_POINTS, 0):
        monkeypatch.setattr(laz_module, "MOST_POINTS", most)
        assert objects_of(convert(laz, radius=1, color_by="intensity")) == whole


def test_a_table_of_chunks_at_the_end(laz):
    """A writer that cannot go back says where the table is behind it."""
    scan = write(laz)
    data = bytearray(laz.read_bytes())
    (begin,) = struct.unpack_from("<I", data, POINTS_AT)
    table = data[begin : begin + 8]
    data[begin : begin + 8] = struct.pack("<q", -1)
    laz.write_bytes(data + table)
    assert shapes_of(convert(laz, radius=1)) == spheres(places(scan), 1)


def test_progress_counts_bytes(file):
    write(file)
    done = []
    convert(file, radius=1, progress=done.append)
    assert done[-1] == max(done) == file.stat().st_size


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_points_that_are_not_finite(file, bad, caplog):
    write(file)
    data = bytearray(file.read_bytes())
    data[SCALES_AT : SCALES_AT + 8] = struct.pack("<d", bad)
    file.write_bytes(data)
    assert failure(file, radius=1).startswith("point 0: found ")
    assert convert(file, radius=1, skip_invalid=True).objects == 0
    assert f"{COUNT} invalid objects were dropped" in caplog.text


def test_radii_that_are_not_finite(file, small_blocks):
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.add_extra_dim(laspy.ExtraBytesParams("size", "f8"))
    scan = laspy.LasData(header)
    scan.x = scan.y = scan.z = np.arange(20)
    scan["size"] = np.where(np.arange(20) == 11, np.nan, 1.0)
    scan.write(file)
    assert failure(file, radius="size") == "point 11: found 11 11 11 nan, expected finite numbers"
    assert convert(file, radius="size", skip_invalid=True).objects == 19


def test_colors_of_8_bits_in_fields_of_16(file, caplog, small_blocks):
    """As many writers have them, against the standard."""
    scan = write(file, 3)
    for name in ("red", "green", "blue"):
        scan[name] = np.arange(COUNT) * (255 // (COUNT - 1))
    scan.write(file)
    found = np.array([each.color for each in objects_of(convert(file, radius=1, color_by="rgb"))])
    exact = linear(np.rint(np.asarray(scan.red) / 255 * 31) / 31)
    assert np.abs(found[:, 0] - exact).max() < 1e-6
    greatest = int(np.asarray(scan.red).max())
    said = f"{file}: colors of 16 bits go to {greatest} only: taken as of 8 bits"
    assert caplog.messages == [said]
    scan.green[7] = 256
    scan.write(file)
    found = [each.color for each in objects_of(convert(file, radius=1, color_by="rgb"))]
    assert max(map(max, found)) < 0.01


# --- text ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["owner", "description", "data"])
@pytest.mark.parametrize("record", [("Größe", 7), ("LASF_Projection", 2112)])
def test_records_whose_text_is_not_unicode(file, place, record, caplog):
    """Nobody here needs them."""
    write(file, 3)
    scan = laspy.read(file)
    scan.header.vlrs.append(laspy.VLR("OWNER", record[1], "ABOUT", b"DATA"))
    scan.write(file)
    data = file.read_bytes()
    owner = record[0].encode("latin1" if place == "owner" else "ascii", "replace")
    changes = {b"OWNER": owner[:5] if record[1] == 7 else owner}
    changes |= {b"ABOUT": b"\xe4BOUT"} if place == "description" else {}
    changes |= {b"DATA": b"\xff\xfe\xe4\xf6"} if place == "data" else {}
    for old, new in changes.items():
        at = data.index(old)
        data = data[:at] + new + data[at + len(new) :]
    file.write_bytes(data)
    assert shapes_of(convert(file, radius=1)) == spheres(places(scan), 1)
    assert caplog.messages == []


def test_extra_bytes_whose_name_is_not_unicode(file):
    """They are found by what can be read of it."""
    scan = write(file, 3, extra=[("size", "f4")])
    data = file.read_bytes()
    at = data.index(b"size")
    file.write_bytes(data[:at] + b"s\xfcze" + data[at + 4 :])
    store = convert(file, radius="s?ze")
    assert shapes_of(store) == spheres(places(scan), np.asarray(scan["size"]))


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
@settings(max_examples=70)
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


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": None}, "found points without a radius, expected radius="),
        ({"triangulate": True}, "found triangulate=True, expected none for"),
        ({"positions": "x"}, "found positions='x', expected none for"),
        ({"radius": "no"}, "found no dimension 'no', expected one of X, Y, Z, "),
        ({"color_by": "no"}, "found no dimension 'no', expected one of X, Y, Z, "),
        ({"color_by": "rgb"}, "found no dimension 'red', expected one of X, Y, Z, "),
        ({"color_range": (0, 1)}, "found without color_by, expected with it only"),
        ({"color_by": "intensity", "colormap": "no"}, "colormap: found 'no', expected cubehelix"),
    ],
)
def test_settings_that_do_not_fit(file, asked, words):
    write(file, 1)
    assert words in failure(file, SettingError, **{"radius": 1, **asked})
