"""What ``bfrt info`` says of points of text, PCD, LAMMPS, E57, splats, OFF and rasters."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from pcd_files import pcd
from ply_files import ply

import bfrt
from bfrt.cli import main
from bfrt.conversion.contents import FORMATS, describe_file
from bfrt.conversion.sources import READERS
from bfrt.errors import SceneError

TYPED = "--color-by {0}, --radius {0}"
DUMP = (
    "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n0 1\n0 1\n0 1\n"
    "ITEM: ATOMS id xs ys zs heat\n1 0 0 0 5\n2 .5 .5 .5 6\n"
)


def told(path):
    """What is told: for each name its shape, type and use."""
    return {row["name"]: tuple(row.values())[1:] for row in describe_file(str(path))["contents"]}


def test_every_format_tells():
    assert set(FORMATS) == set(READERS.values())


@pytest.mark.parametrize("suffix", ["xyz", "csv", "txt", "pts", "asc", "xyz.gz"])
def test_points_of_text(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    text = b"x,y,z,heat,r,g,b\n1,2,3,4,5,6,7\n"
    path.write_bytes(gzip.compress(text) if suffix.endswith("gz") else text)
    assert describe_file(str(path))["format"] == "points of text"
    assert told(path) == {
        "x": ((), "text", "points, --color-by x"), "y": ((), "text", "points, --color-by y"),
        "z": ((), "text", "points, --color-by z"), "heat": ((), "text", TYPED.format("heat")),
        **dict.fromkeys("rgb", ((), "text", "--color-by rgb")),
    }  # fmt: skip
    for option in ("heat", "rgb"):
        made = ["convert", str(path), "-o", str(tmp_path / f"{option}.bfrt"), "--radius", "1"]
        assert main([*made, "--color-by", option]) == 0


def test_a_count_before_points_of_text(tmp_path):
    path = tmp_path / "a.pts"
    path.write_text("2\n1 2 3 4\n1 2 3 5\n")
    assert told(path)["intensity"] == ((2,), "text", TYPED.format("intensity"))


def test_an_esri_grid_is_a_raster(tmp_path):
    pytest.importorskip("rasterio", reason="rasterio is not installed: bfrt[raster]")
    path = tmp_path / "a.asc"
    path.write_text("ncols 2\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n5 6\n")
    (row,) = told(path).values()
    assert row[0] == (3, 2) and row[2] == "triangles: --band N, --color-by z"


@pytest.mark.parametrize("layout", ["ascii", "binary", "binary_compressed"])
def test_pcd(tmp_path, layout):
    path = tmp_path / "a.pcd"
    dtype = [(name, "<f4") for name in ("x", "y", "z", "rgb")] + [("normal", "<f4", 3), ("i", "u1")]
    path.write_bytes(pcd(np.zeros(5, dtype), layout))
    found = told(path)
    assert found["x"] == ((5,), "float32", "points, --color-by x")
    assert found["normal"] == ((5, 3), "float32", "")
    assert found["i"] == ((5,), "uint8", TYPED.format("i"))
    assert found["red"] == ((5,), "8 bits", "--color-by rgb")


@pytest.mark.parametrize("suffix", ["dump", "lammpstrj", "dump.gz"])
def test_lammps(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    data = (DUMP + DUMP).encode()
    path.write_bytes(gzip.compress(data) if suffix.endswith("gz") else data)
    found = told(path)
    assert found["frames"][2] == "of which follows the first: --frame N"
    assert found["x"] == ((2,), "text", "points, --color-by x")
    assert found["heat"] == ((2,), "text", TYPED.format("heat"))


def test_e57(tmp_path):
    pytest.importorskip("pye57", reason="pye57 is not installed: bfrt[e57]")
    import e57_files

    path = tmp_path / "a.e57"
    e57_files.write(path, [e57_files.scan(7), e57_files.scan(4, 1)])
    found = told(path)
    assert found["x"] == ((11,), "float64", "points, --color-by x")
    assert found["red"][2] == "--color-by rgb"


def test_splats(tmp_path):
    path = tmp_path / "a.ply"
    names = [
        "x",
        "y",
        "z",
        "f_dc_0",
        "f_dc_1",
        "f_dc_2",
        "opacity",
        "scale_0",
        "scale_1",
        "scale_2",
    ]
    path.write_bytes(ply("ascii", ("vertex", [(n, "float") for n in names], [[0] * 10])))
    found = told(path)
    assert found["vertex f_dc_0"] == ((1,), "f4", "--color-by rgb")
    assert found["vertex opacity"][2].startswith("--opacity T, --color-by opacity")


def test_off(tmp_path):
    path = tmp_path / "a.off"
    path.write_text("COFF\n3 1 0\n0 0 0 9 9 9\n1 0 0 9 9 9\n0 1 0 9 9 9\n3 0 1 2\n")
    vertices = ((3,), "text", "vertices, --color-by rgb")
    assert told(path) == {"vertices": vertices, "faces": ((1,), "text", "faces")}
    path.write_text("OFF\n1 0 0\n0 0 0\n")
    assert told(path) == {"vertices": ((1,), "text", "points")}
    assert main(["convert", str(path), "-o", str(tmp_path / "a.bfrt"), "--radius", "1"]) == 0
    assert bfrt.open(tmp_path / "a.bfrt").objects == 1


@pytest.mark.parametrize("name", ["a.xyz", "a.pcd", "a.dump", "a.off"])
def test_what_is_none_is_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"junk\n" * 9)
    with pytest.raises(SceneError) as caught:
        describe_file(str(path))
    assert str(caught.value).startswith(str(path))
