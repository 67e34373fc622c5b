"""What is read of a LAS or LAZ file: scans in are spheres out."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from las_files import COLORED, COUNT, FORMATS, POINTS_AT, SCALES_AT, SUFFIXES, UTM, places, write
from meshes import convert, failure, objects_of, shades, shapes_of, spheres

from bfrt.errors import SettingError
from bfrt.formats import las as las_module
from bfrt.formats import laz as laz_module
from bfrt.formats.colors import linear

laspy = pytest.importorskip("laspy", reason="laspy is not installed: bfrt[las]")


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
    convert(file, radius=1, progress=done.append, order="given")
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
        ({"color_by": "intensity", "colormap": "no"}, "colormap: found 'no', expected viridis"),
    ],
)
def test_settings_that_do_not_fit(file, asked, words):
    write(file, 1)
    assert words in failure(file, SettingError, **{"radius": 1, **asked})
