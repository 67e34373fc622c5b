"""Esri grids: what GDAL reads as other heights without a word."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import convert, failure, shapes_of
from raster_files import in_this_process, rasterio, triangles, write

import bfrt
from bfrt.errors import SceneError
from bfrt.formats import source as source_module

HEADER = """ncols 2
nrows 3
xllcorner 10
yllcorner 20
cellsize 5
NODATA_value -9999
"""
PLACE = rasterio.Affine(5, 0, 10, 0, -5, 35)


def grid(folder, rows, header=HEADER):
    file = folder / "a.asc"
    file.write_bytes((header + rows).encode())
    return file


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("1 2\n3 4\n5\n", "found 5 heights, expected 6, 3 rows of 2: the file is truncated or its"),
        ("1 2\n3 4\n5 6\n7", "found 7 heights, expected 6, 3 rows of 2: the file is truncated or"),
        ("", "found "),
        ("1 2\n3 x\n5 6\n", "line 8: found 'x', expected a height"),
        ("1 2\r\n\r\n3 4 5 --\r\n", "line 9: found '--', expected a height"),
        ("1 2\n3 4\n5 0x6\n", "line 9: found '0x6', expected a height"),
        ("1 2\n3 4\n5 # 6\n", "found 5 heights, expected 6"),
        ("1 2\n3 4\n5 nan\n", "row 2, column 1: found nan, expected a finite height"),
        ("1 2\n3 4\n5 1e40\n", "row 2, column 1: found 1e+40, expected a finite height"),
    ],
)
@pytest.mark.parametrize("size", [64, 1 << 20])
def test_what_is_no_height(tmp_path, rows, said, size, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    with in_this_process():
        assert failure(grid(tmp_path, rows), SceneError).startswith(said)


@pytest.mark.parametrize("size", [64, 1 << 20])
def test_heights_are_as_the_text_has_them(tmp_path, size, monkeypatch):
    """Whole numbers beyond 32 bits, decimals behind many whole ones, in lines of any length."""
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    heights = np.full((200, 300), 123456.0)
    heights[-1] = 1.75
    heights[0, 0] = 3e9
    heights[1, 1] = -9999
    rows = " ".join(f"{z:.10g}" for z in heights.ravel())
    header = HEADER.replace("ncols 2", "ncols 300").replace("nrows 3", "nrows 200")
    place = rasterio.Affine(5, 0, 10, 0, -5, 1020)
    with in_this_process():
        file = grid(tmp_path, rows, header)
        assert shapes_of(convert(file, order="given")) == triangles(
            heights, heights != -9999, place
        )


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_headers_and_commas(tmp_path, end):
    """In any order and case, of centers, and with a decimal comma, which GDAL reads as well."""
    header = "NROWS 3\nncols 2\nXLLCENTER 12.5\nyllcenter 22.5\ndx 5\ndy 5\n"
    rows = "1,5 2\n\n3 4 5\n -6e0\n\n"
    file = grid(tmp_path, rows.replace("\n", end), header.replace("\n", end))
    with in_this_process():
        heights = np.array([[1.5, 2], [3, 4], [5, -6]])
        assert shapes_of(convert(file)) == triangles(heights, np.ones((3, 2), bool), PLACE)


def test_no_data_of_float32_is_found_among_float64(tmp_path):
    """As GDAL itself writes the least number of float32, which stands for no data in many files."""
    least = np.finfo("f4").min
    heights = np.array([[0.1, 2, 3], [4, 5, 6], [7, 8, least]], "f4")
    write(tmp_path / "a.asc", heights, PLACE, driver="AAIGrid", nodata=float(least))
    with in_this_process():
        there = heights != least
        assert shapes_of(convert(tmp_path / "a.asc")) == triangles(heights, there, PLACE)


def test_a_viewshed_refuses_it_too(tmp_path):
    file = grid(tmp_path, "1 2\n3 4\n5\n")
    with pytest.raises(SceneError, match="found 5 heights, expected 6"):
        bfrt.viewshed(file, tmp_path / "seen.tif", [(15, 27)], height=2)
    assert [each.name for each in tmp_path.iterdir()] == ["a.asc"]
