"""A raster's conversion takes what its budget says: in a cgroup, and in rows at once."""

from __future__ import annotations

import sys
import tracemalloc
from contextlib import closing

import numpy as np
import pytest
from capped import memory_cap
from memory_cap import run_in
from raster_files import in_this_process, write

from bfrt.formats.raster import reader
from bfrt.formats.raster.remote import RemoteRaster
from bfrt.formats.reading import Reading
from bfrt.formats.room import FEWEST, need_of
from bfrt.terrain.ground import ROWS_BYTES


def waves(rows, columns):
    j, i = np.meshgrid(np.arange(columns), np.arange(rows))
    return (100 + 40 * np.sin(j / 9) * np.cos(i / 13)).astype("f4")


#: What is made, by which command, and what that takes beside a conversion.
COMMANDS = {
    "o.bfrt": (["convert"], 0),
    "o.tif": (["viewshed", "--observer", "504005", "5396995"], ROWS_BYTES),
}


@pytest.mark.parametrize("made", COMMANDS)
def test_in_a_cgroup_of_the_least(tmp_path, made):
    layout = {"tiled": True, "blockxsize": 256, "blockysize": 256, "compress": "deflate"}
    file = write(tmp_path / "a.tif", waves(700, 900), **layout)
    (command, *options), beside = COMMANDS[made]
    least = need_of(str(file)).least + beside
    words = [command, str(file), "-o", made, *options, "--memory", str(least), "--quiet"]
    with memory_cap(least) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        ended = run_in(group, [sys.executable, "-m", "bfrt", *words], tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"a.tif", made}


@pytest.mark.parametrize("shape", [(3000, 700), (40, 52_500)])
def test_rows_at_once_are_those_that_fit(tmp_path, shape):
    """Whatever a file's blocks are: of one that is a strip, of wide rows."""
    file = str(write(tmp_path / "a.tif", waves(*shape), blockysize=shape[0]))
    with in_this_process():
        tracemalloc.start()
        with closing(RemoteRaster(file, 1, 0, FEWEST)) as raster:
            count = sum(
                len(triangles) for _, triangles in reader.Terrain(file, raster, Reading()).blocks()
            )
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert count == 2 * (shape[0] - 1) * (shape[1] - 1)
    assert peak < FEWEST + (16 << 20)
