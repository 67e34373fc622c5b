"""The documentation's examples run, and the pictures beside them are what they make."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

import bfrt

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = sorted((ROOT / "docs" / "examples").glob("*.py"))
#: Those that make one picture of their own name.
EXAMPLES = [script for script in SCRIPTS if script.stem != "gallery"]
PICTURES = sorted((ROOT / "docs" / "pictures").glob("*.png"))
SHOWN = 512
SIZE = 64


def pixels(path):
    """The codes of a PNG as bfrt writes it, (height, width, 3)."""
    data, at, parts = path.read_bytes(), 8, {}
    while at < len(data):
        size, name = struct.unpack_from(">I4s", data, at)
        parts[name] = parts.get(name, b"") + data[at + 8 : at + 8 + size]
        at += 12 + size
    width, height = struct.unpack_from(">II", parts[b"IHDR"])
    raw = np.frombuffer(zlib.decompress(parts[b"IDAT"]), np.uint8)
    lines = raw.reshape(height, 1 + 3 * width)
    assert (lines[:, 0] == 1).all(), "only the filter Sub is read here"
    return np.cumsum(lines[:, 1:].reshape(height, width, 3), axis=1, dtype=np.uint8)


def run(script, *arguments, folder):
    """Run an example as a reader would, with this bfrt."""
    paths = [str(Path(bfrt.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    subprocess.run(
        [sys.executable, str(script), *map(str, arguments)],
        check=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
        timeout=300,
    )


def test_there_are_examples():
    assert [script.stem for script in SCRIPTS] == [
        "balls",
        "cluster",
        "gallery",
        "layouts",
        "light",
        "mesh",
        "mount",
        "particles",
        "rings",
        "scan",
        "sight",
        "smooth",
        "snapshot",
        "turntable",
        "viewshed",
        "visibility",
    ]


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda script: script.stem)
def test_an_example_makes_the_picture_that_is_shown(script, tmp_path):
    if script.stem == "cluster":
        pytest.importorskip("distributed", reason="needs dask and distributed")
    if script.stem in ("sight", "viewshed"):
        pytest.importorskip("rasterio", reason="rasterio is not installed: bfrt[raster]")
    if script.stem == "viewshed" and shutil.which("gdal_viewshed") is None:
        pytest.skip("gdal_viewshed is not installed")
    run(script, tmp_path, SIZE, folder=ROOT)
    is_shown(tmp_path / f"{script.stem}.png", SHOWN)


def is_shown(path, side):
    """A picture is that of its name in the pages, which is `side` pixels wide."""
    made = pixels(path).astype(float)
    assert made.shape == (SIZE, SIZE, 3)
    assert made.std(axis=(0, 1)).min() > 10.0
    shown = pixels(ROOT / "docs" / "pictures" / path.name).astype(float)
    assert shown.shape == (side, side, 3)
    block = side // SIZE
    small = shown.reshape(SIZE, block, SIZE, block, 3).mean(axis=(1, 3))
    # Four rays a pixel of the small one against many: detail differs, the picture does not.
    assert np.abs(made - small).mean() < 15.0
    assert np.corrcoef(made.ravel(), small.ravel())[0, 1] > 0.9


def test_the_gallery(tmp_path):
    run(ROOT / "docs" / "examples" / "gallery.py", tmp_path, SIZE, folder=ROOT)
    for name in bfrt.spd.NAMES:
        is_shown(tmp_path / f"spd-{name}.png", 320)


def test_without_arguments_the_picture_lies_here(tmp_path):
    run(ROOT / "docs" / "examples" / "balls.py", folder=tmp_path)
    assert pixels(tmp_path / "balls.png").shape == (SHOWN, SHOWN, 3)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_is_short(script):
    assert len(script.read_text().splitlines()) < 60


@pytest.mark.parametrize("path", PICTURES, ids=lambda path: path.stem)
def test_a_shown_picture_is_small(path):
    assert path.stat().st_size < 400_000
