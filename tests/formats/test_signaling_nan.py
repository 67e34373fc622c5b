"""A NaN of float32 that signals, anywhere in a file: refused or dropped, without a warning."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from meshes import convert, failure
from pcd_files import pcd

SIGNALING = np.array([0x7FA00000], np.uint32).view(np.float32)[0]

NAMES = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2")


def put(column):
    """Make the second number one that signals, bit for bit."""
    column.view(np.uint32).reshape(len(column), -1)[1, 0] = SIGNALING.view(np.uint32)


def columns(name):
    """Points with a number beside, one of which signals."""
    made = {each: np.arange(5, dtype="f4") + 1 for each in ("x", "y", "z", "m")}
    put(made[name])
    return made


def a_pcd(path, name):
    made = np.zeros(5, [(each, "<f4") for each in "xyzm"])
    for each, column in columns(name).items():
        made[each].view(np.uint32)[:] = column.view(np.uint32)
    path.write_bytes(pcd(made, "binary"))


def a_npz(path, name):
    np.savez(path, **columns(name))


def a_npy(path, name):
    made = np.zeros(5, [(each, "<f4") for each in "xyzm"])
    for each, column in columns(name).items():
        made[each].view(np.uint32)[:] = column.view(np.uint32)
    np.save(path, made)


def a_ply(path, name):
    made = np.zeros((5, len(NAMES)), "<f4")
    at = NAMES.index("opacity" if name == "m" else name)
    made[:] = np.arange(50).reshape(5, -1) / 50
    made.view(np.uint32)[1, at] = SIGNALING.view(np.uint32)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 5\n"
    head += "".join(f"property float {each}\n" for each in NAMES)
    path.write_bytes(head.encode() + b"end_header\n" + made.tobytes())


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("name", ["x", "m"])
@pytest.mark.parametrize("make", [a_pcd, a_npz, a_npy, a_ply], ids=lambda make: make.__name__)
def test_points(tmp_path, make, name):
    path = tmp_path / f"a.{make.__name__.removeprefix('a_')}"
    make(path, name)
    paint = "opacity" if make is a_ply else "m"
    for dtype in ("float32", "float64"):
        if name == "x":
            assert failure(path, radius=1, dtype=dtype).startswith("point 1: found nan ")
        store = convert(path, radius=1, color_by=paint, skip_invalid=True, dtype=dtype)
        assert store.objects == (4 if name == "x" else 5)
    if name == "m":
        if make is a_ply:
            assert failure(path, opacity=0.5).startswith("vertex 1: found an opacity of nan")
        else:
            assert failure(path, radius="m").startswith("point 1: found 2 2 2 nan")


def test_a_mesh_beside_a_wider_column(tmp_path):
    path = tmp_path / "a.npz"
    vertices = np.arange(12, dtype="f4").reshape(4, 3) ** 2
    put(vertices)
    np.savez(path, vertices=vertices, faces=np.array([[0, 2, 3], [0, 1, 2]]), m=np.arange(4.0))
    assert failure(path, color_by="m").startswith("face 1: found ")
    colors = np.ones((4, 3), "f4")
    put(colors)
    vertices = np.arange(12, dtype="f4").reshape(4, 3) ** 2
    np.savez(path, vertices=vertices, faces=np.array([[0, 2, 3], [0, 1, 2]]), colors=colors)
    assert convert(path, color_by="rgb").objects == 2


def test_a_raster(tmp_path):
    raster_files = pytest.importorskip("raster_files")
    heights = raster_files.HEIGHTS.astype("f4")
    put(heights)
    path = raster_files.write(tmp_path / "a.tif", heights)
    with raster_files.in_this_process():
        assert failure(path).startswith("row 1, column 0: found nan, expected a finite height")
        assert convert(path, skip_invalid=True).objects


def test_an_openpmd(tmp_path):
    layout_files = pytest.importorskip("layout_files")
    rows = np.ones((5, 3), "f4")
    put(rows)
    own = layout_files.species_of(rows, 0.5, np.ones((5, 3)), 1.0)
    path = layout_files.openpmd(tmp_path / "a.h5", {0: {"e": own}})
    assert failure(path, radius=1).startswith("point 1: found nan ")
