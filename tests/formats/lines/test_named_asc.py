"""Files of the suffix .asc: points, or a grid, as they begin."""

import gzip

import pytest

from bfrt.conversion.sources import reader_of
from bfrt.formats.gzipped import suffix_of
from bfrt.formats.lines.reader import read_lines
from bfrt.formats.raster.reader import read_raster

GRID = b"ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n4 5 6\n"


@pytest.mark.parametrize(
    ("text", "reader"),
    [
        (GRID, read_raster),
        (GRID.upper(), read_raster),
        (b"\n  nrows 2\n", read_raster),
        (b"1 2 3\n4 5 6\n", read_lines),
        (b"# ncols\n1 2 3\n", read_lines),
        (b"x y z\n1 2 3\n", read_lines),
        (b"", read_lines),
    ],
)
def test_what_it_begins_with_tells(tmp_path, text, reader):
    path = tmp_path / "a.ASC"
    path.write_bytes(text)
    assert reader_of(str(path)) is reader


def test_packed_are_points(tmp_path):
    path = tmp_path / "a.asc.gz"
    path.write_bytes(gzip.compress(b"1 2 3\n"))
    assert reader_of(str(path)) is read_lines


def test_none_is_there(tmp_path):
    assert suffix_of(str(tmp_path / "a.asc")) == ".xyz"
