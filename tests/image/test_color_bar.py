"""A color bar beside a picture, and what a store keeps for it."""

from __future__ import annotations

import importlib.util
import json
import math
import sys

import numpy as np
import pytest

import bfrt
from bfrt.cli import main
from bfrt.errors import SettingError, StoreError
from bfrt.image.color_bar import labels_of
from bfrt.image.color_scale import ColorScale
from bfrt.image.colormaps import colormap
from bfrt.image.picture import Image
from bfrt.image.png import encode_srgb
from bfrt.store.header import header_text

SCALE = ColorScale("heat", "viridis", -2.0, 7.0)
needs_matplotlib = pytest.mark.skipif(
    importlib.util.find_spec("matplotlib") is None,
    reason="matplotlib is not installed: bfrt[colormaps]",
)


def plain(height, width):
    rng = np.random.default_rng(1)
    return Image({name: rng.random((height, width), np.float32) for name in "RGBA"})


def codes_of(path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed: bfrt[animation]")
    with pillow.open(path) as file:
        return np.asarray(file.convert("RGB"))


@needs_matplotlib
@pytest.mark.parametrize("log", [False, True])
def test_a_bar_is_beside_the_picture(tmp_path, log):
    image = plain(200, 30)
    scale = SCALE._replace(lo=0.5, log=log)
    image.save(tmp_path / "a.png", color_bar=scale)
    codes = codes_of(tmp_path / "a.png")
    np.testing.assert_array_equal(codes[:, :30], encode_srgb(image.rgb))
    bar = codes[:, 30:]
    assert bar.shape == (200, 120, 3) and (bar[:, -1] == 255).all()
    middle = bar[30:180, 20]  # the colors, from the greatest down
    order = [np.abs(colormap("viridis") * 255 - color).sum(axis=1).argmin() for color in middle]
    assert order[0] > 200 > 60 > order[-1] and (np.diff(order) <= 0).all()
    assert (bar[:, 40:] < 100).any()  # numbers
    image.save(tmp_path / "b.png", color_bar=scale)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@needs_matplotlib
@pytest.mark.parametrize("name", ["$x^", "a name of very many letters indeed", ""])
@pytest.mark.parametrize("ends", [(3.0, 3.0), (0.0, 0.0), (1e-300, 1e300), (-5.0, 1e-9)])
def test_any_name_and_any_range(tmp_path, name, ends):
    log = ends[0] > 0
    plain(64, 3).save(tmp_path / "a.png", color_bar=ColorScale(name, "gray", *ends, log=log))
    assert codes_of(tmp_path / "a.png").shape == (64, 123, 3)


def test_the_numbers_of_a_bar():
    assert labels_of(SCALE) == ["-2", "0.25", "2.5", "4.75", "7"]
    assert labels_of(SCALE._replace(lo=1.0, hi=1e8, log=True)) == [
        "1",
        "100",
        "1e+04",
        "1e+06",
        "1e+08",
    ]


@needs_matplotlib
def test_what_has_no_bar(tmp_path):
    with pytest.raises(
        SettingError, match=r"found color_bar for \.exr, expected it only for \.png"
    ):
        plain(80, 3).save(tmp_path / "a.exr", color_bar=SCALE)
    with pytest.raises(SettingError, match="color_bar: found 63 rows, expected 64 or more"):
        plain(63, 3).save(tmp_path / "a.png", color_bar=SCALE)
    for wrong, fault in (
        ((SCALE,), r"color_bar: found tuple, expected a ColorScale, as scene\.colors\[0\]"),
        ("mass", "color_bar: found str, expected a ColorScale"),
        (SCALE._replace(lo=SCALE.hi + 1.0), "color_bar: found a range from .*, the lesser first"),
        (SCALE._replace(lo=math.nan), "color_bar: found a range from nan to .*, expected finite"),
        (SCALE._replace(log=True, lo=-1.0), "color_bar: found a range from -1.0 .*, above 0"),
    ):
        with pytest.raises(SettingError, match=fault):
            plain(80, 3).save(tmp_path / "a.png", color_bar=wrong)
    assert not list(tmp_path.iterdir())
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SettingError) as caught:
        plain(80, 3).save(tmp_path / "a.png", color_bar=SCALE)
    assert str(caught.value) == (
        f"{tmp_path}/a.png: a color bar needs matplotlib: pip install bfrt[colormaps]"
    )


@pytest.fixture
def points(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("x,y,z,heat\n0,0,0,1\n1,0,0,10\n0,1,0,100\n0,0,1,-5\n")
    return path


def test_a_store_keeps_what_its_colors_say(points, tmp_path):
    asked = {"radius": 0.5, "color_by": "heat"}
    scene = bfrt.convert(points, tmp_path / "a.bfrt", **asked)
    assert scene.colors == (ColorScale("heat", "viridis", -5.0, 100.0, False),)
    ranks = {"color_range": ("50%", "100%"), "color_log": True, "colormap": "gray"}
    scene = bfrt.convert(points, tmp_path / "b.bfrt", **asked, **ranks)
    assert scene.colors == (ColorScale("heat", "gray", 10.0, 100.0, True),)
    several = bfrt.convert([points, points], tmp_path / "c.bfrt", **asked)
    assert len(several.colors) == 1
    shards = bfrt.convert([points, points], tmp_path / "d.bfrts", **asked)
    assert shards.colors == several.colors
    none = bfrt.convert(points, tmp_path / "e.bfrt", radius=0.5)
    assert none.colors == ()
    assert "colors" not in json.loads((none.path / "scene.json").read_text())


@pytest.mark.parametrize(
    "change", [{"lo": "x"}, {"lo": 101.0}, {"log": True}, {"name": 3}, {"more": 1}]
)
def test_a_header_whose_colors_are_none(points, tmp_path, change):
    scene = bfrt.convert(points, tmp_path / "a.bfrt", radius=0.5, color_by="heat")
    header = json.loads((scene.path / "scene.json").read_text())
    header["colors"][0].update(change)
    (scene.path / "scene.json").write_text(header_text(header))
    with pytest.raises(StoreError, match="colors"):
        bfrt.open(scene.path)


@needs_matplotlib
def test_a_bar_on_the_command_line(points, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = ["--resolution", "70", "80", "--memory", "160MiB", "--quiet"]
    made = [*small, "--radius", "0.5", "--color-by", "heat", "--log", "--color-range", "0%", "98%"]
    files = ["-o", "a.png", "-o", "a.exr", "--color-bar"]
    assert main(["render", str(points), *made, *files]) == 0
    assert codes_of(tmp_path / "a.png").shape == (80, 190, 3)
    turn = ["-o", "b{}.png", "--turntable", "2", "--color-bar"]
    assert main(["render", str(points), *made, *turn]) == 0
    assert codes_of(tmp_path / "b1.png").shape == (80, 190, 3)
    for asked, fault in (
        (["-o", "c.png", "--radius", "0.5"], "--color-bar: found 0 ranges of numbers"),
        (["-o", "c.exr", "--radius", "0.5"], "--color-bar: found no -o FILE.png, expected one"),
        (
            ["-o", "c.png", "--radius", "0.5", "--color-by", "heat", "--resolution", "9", "63"],
            "color_bar: found 63 rows, expected 64 or more",
        ),
    ):
        assert main(["render", str(points), *small, *asked, "--color-bar"]) == 2
        assert fault in capsys.readouterr().err
    assert not list(tmp_path.glob("c.*"))
