"""Rasters that are broken, end GDAL, or are none."""

from __future__ import annotations

import contextlib
import signal
import socket
import sys
import threading
import warnings
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, outcome, shapes_of
from properties import examples
from raster_files import HEIGHTS, UTM, in_this_process, rasterio, triangles, write

from bfrt.errors import BfrtError, BudgetError, SceneError, SettingError, StreamError
from bfrt.formats.raster.suffixes import DRIVERS
from bfrt.formats.remote import process

ALL = np.ones(HEIGHTS.shape, bool)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.tif"


def directory_last(path):
    """The header is behind the heights, and what it refers to behind that."""
    with rasterio.open(path, "r+") as raster:
        raster.crs = rasterio.CRS.from_epsg(25833)
        raster.update_tags(about="a" * 99)


@pytest.mark.parametrize("step", [7, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("last", [False, True])
def test_a_file_cut_at_every_byte(file, last, step):
    """GDAL passes over what it cannot read of a header, and a raster would lie somewhere else."""
    write(file, nodata=-1.0)
    if last:
        directory_last(file)
    data = file.read_bytes()
    with in_this_process():
        for size in range(0, len(data), step):
            file.write_bytes(data[:size])
            failure(file, SceneError)
        file.write_bytes(data)
        assert shapes_of(convert(file)) == triangles(HEIGHTS, ALL, UTM)


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from([{}, {"compress": "deflate"}, {"tiled": True, "blockxsize": 16,
                                                   "blockysize": 16, "compress": "lzw"}]),
)  # fmt: skip
@examples(60)
def test_flipped_bytes(tmp_path_factory, flips, layout):
    path = write(tmp_path_factory.mktemp("a") / "a.tif", **layout)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * len(data))] = value
    path.write_bytes(data)
    with in_this_process(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        outcome(path)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39])
def test_heights_that_are_none(file, value):
    heights = HEIGHTS.astype("f8")
    heights[4, 6] = value
    write(file, heights)
    with in_this_process():
        assert failure(file) == (
            f"row 4, column 6: found {value:g}, expected a finite height, or that the file says of "
            "it that it is no data"
        )
        there = ALL.copy()
        there[4, 6] = False
        assert shapes_of(convert(file, skip_invalid=True)) == triangles(HEIGHTS, there, UTM)


@pytest.mark.parametrize(
    ("transform", "words"),
    [
        ((1, 1, 5, 1, 1, 5), "expected one that has cells of some area"),
        ((np.nan, 0, 5, 0, -1, 5), "expected"),
        ((1e300, 0, 5, 0, -1e300, 5), "at places that float32 has"),
    ],
)
def test_transforms_without_cells(file, transform, words):
    write(file, transform=rasterio.Affine(*transform))
    with in_this_process():
        assert words in failure(file)


@pytest.mark.parametrize("shape", [(1, 5), (5, 1), (1, 1)])
def test_rasters_without_cells(file, shape):
    write(file, np.zeros(shape, "f4"))
    with in_this_process():
        assert failure(file) == (
            f"found {shape[1]} x {shape[0]} heights, expected 2 x 2 or more: cells are between four"
        )


def test_numbers_that_are_no_heights(file):
    write(file, HEIGHTS.astype("c8"))
    with in_this_process():
        assert failure(file) == "found complex64 numbers, expected real ones as heights"


def test_points_on_the_ground_are_no_transform(file):
    point = rasterio.control.GroundControlPoint
    gcps = [point(0, 0, 1, 2), point(0, 9, 3, 4), point(7, 0, 5, 6)]
    write(file, transform=None, crs=None)
    with rasterio.open(file, "r+") as raster:
        raster.gcps = (gcps, rasterio.CRS.from_epsg(32632))
    with in_this_process():
        assert "make it by gdalwarp" in failure(file)


@pytest.mark.parametrize("suffix", DRIVERS)
@pytest.mark.parametrize("data", [b"", b"II*\0", bytes(5000), b"<VRTDataset>", b"ncols 5\nnrows 9"])
def test_what_is_no_raster(tmp_path, suffix, data):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(data)
    with in_this_process():
        failure(path, SceneError)


#: A raster that is another file's.
VRT = (
    '<VRTDataset rasterXSize="{side}" rasterYSize="{side}"><GeoTransform>500000, 10, 0, 5400000, 0,'
    ' -10</GeoTransform><VRTRasterBand dataType="{kind}" band="1"><SimpleSource><SourceFilename '
    'relativeToVRT="{relative}">{name}</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
    "</VRTRasterBand></VRTDataset>"
)


def test_a_name_does_not_hide_what_a_file_is(tmp_path):
    """A file that names others is one only where its own name says so."""
    write(tmp_path / "b.tif")
    text = VRT.format(name="b.tif", side=7, kind="Float32", relative=1)
    for name in ("a.tif", "a.vrt"):
        (tmp_path / name).write_text(text)
    with in_this_process():
        failure(tmp_path / "a.tif", SceneError)
        square = HEIGHTS[:, :7]
        assert shapes_of(convert(tmp_path / "a.vrt")) == triangles(square, ALL[:, :7], UTM)
        (tmp_path / "b.tif").unlink()
        assert "b.tif" in failure(tmp_path / "a.vrt", SceneError)


def asked_of(server, asked):
    """Notes what a server is asked for, and says nothing."""
    with contextlib.suppress(OSError):  # it is closed
        while True:
            connection, _ = server.accept()
            asked.append(connection.recv(100))
            connection.close()


@pytest.mark.parametrize(
    "before", ["/vsicurl/http:", "http:", "WMS:http:", "/vsizip//vsicurl/http:"]
)
@pytest.mark.parametrize("spared", [False, True])
def test_nothing_is_read_from_a_network(tmp_path, before, spared, monkeypatch):
    """By the process itself, even where the environment spares a place its proxy."""
    if spared:
        monkeypatch.setenv("no_proxy", "*")
    asked = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=asked_of, args=(server, asked), daemon=True).start()
        name = f"{before}//127.0.0.1:{server.getsockname()[1]}/b.tif"
        (tmp_path / "a.vrt").write_text(VRT.format(name=name, side=9, kind="Float32", relative=0))
        failure(tmp_path / "a.vrt", SceneError)
        server.shutdown(socket.SHUT_RDWR)
    assert not asked


CRASH = """
import json, os, sys
sys.path[:] = sys.argv[3:]
from bfrt.formats.raster import child
def crash(server, *words):
    os.kill(os.getpid(), {signal})
child.Server.{verb} = crash
child.main(*json.loads(sys.argv[1]))
"""


@pytest.mark.parametrize("verb", ["facts", "rows", "there"])
def test_what_ends_gdal_is_one_sentence(file, verb, monkeypatch):
    write(file)
    number = int(signal.SIGSEGV)
    monkeypatch.setattr(process, "SERVE", CRASH.format(verb=verb, signal=number))
    said = failure(file)
    assert (
        said == f"found what ends GDAL itself (status -{number}), expected a raster that is whole"
    )


def test_a_file_of_large_blocks_in_a_file_that_names_it(tmp_path):
    """What a file names says how large its blocks are, and only GDAL knows: it gets no more."""
    write(tmp_path / "b.tif", np.zeros((9000, 9000), "f8"), compress="deflate", blockysize=9000)
    text = VRT.format(name="b.tif", side=9000, kind="Float64", relative=1)
    (tmp_path / "a.vrt").write_text(text)
    failure(tmp_path / "a.vrt", BudgetError, memory="256MiB")


def test_no_such_file(file):
    failure(file, StreamError)


def test_without_rasterio(file):
    write(file)
    with mock.patch.dict(sys.modules, {"rasterio": None}):
        assert failure(file, SettingError) == "found no rasterio, expected it: install bfrt[raster]"


def test_settings_of_others_are_refused(file):
    write(file)
    with in_this_process():
        for other in ({"radius": 1.0}, {"triangulate": True}, {"positions": "a"}):
            assert failure(file, BfrtError, **other).startswith("found ")
