"""What is seen of a terrain, beside a profile along every line of sight."""

from __future__ import annotations

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import open_files
from raster_files import CRS, UTM, in_this_process, rasterio, write

import bfrt
from bfrt.cli import main
from bfrt.errors import (
    BfrtError,
    BudgetError,
    Cancelled,
    SceneError,
    SettingError,
    StreamError,
)
from bfrt.terrain import sheet, viewshed

Affine = rasterio.Affine
RADIUS = 6378137.0

TRANSFORMS = [
    UTM,
    Affine(10, 0, 500_000, 0, 10, 5_400_000),
    Affine.translation(500_000, 5_400_000) @ Affine.rotation(33) @ Affine.scale(10, -10),
]


class Written:
    """Stands for `RemoteFile`: the file is written here."""

    def __init__(self, path, about, library):
        assert library.module == sheet.__name__
        sheet.main(path, json.loads(json.dumps(about)))

    def close(self):
        pass


@pytest.fixture
def here(monkeypatch):
    with in_this_process():
        monkeypatch.setattr(viewshed, "RemoteFile", Written)
        monkeypatch.setattr(sheet, "serve", lambda begin: begin())
        yield


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.tif"


def seen_in(path):
    with rasterio.open(path) as raster:
        found = raster.read()
    assert set(np.unique(found)) <= {0, 255}
    return found == 255


def ground_at(heights, place):
    """The height of the two triangles of a cell, at a column and a row counted from middles."""
    j, i = (int(min(max(math.floor(x), 0), n - 2)) for x, n in zip(place, heights.shape[::-1],
                                                                 strict=True))  # fmt: skip
    u, v = place[0] - j, place[1] - i
    a, b, c, d = heights[i, j], heights[i, j + 1], heights[i + 1, j + 1], heights[i + 1, j]
    return a + u * (b - a) + v * (c - b) if u >= v else a + v * (d - a) + u * (c - d)


def edges_of(there):
    """All edges between corners that are there, by their columns and rows, (n, 2): those of whole
    cells' triangles, and the sides of all others, below which nothing passes."""
    rows, columns = there.shape
    found = []
    for i, j in np.argwhere(there).tolist():
        for di, dj in ((0, 1), (1, 0), (1, 1)):
            a, b = i + di, j + dj
            if a < rows and b < columns and there[i : a + 1, j : b + 1].all():
                found.append(((j, i), (b, a)))
    ends = np.array(found, float)
    return ends[:, 0], ends[:, 1]


def profile(heights, there, eye, target, z):
    """How high the terrain is above the line of sight at the most, where edges cross it.

    Parameters
    ----------
    eye, target : (2,) columns and rows
    z : the heights of both
    """
    p, q = edges_of(there)
    at = [heights[each[:, 1].astype(int), each[:, 0].astype(int)] for each in (p, q)]
    way, edge, off = np.subtract(target, eye), q - p, p - eye
    with np.errstate(all="ignore"):
        cross = way[0] * edge[:, 1] - way[1] * edge[:, 0]
        t = (off[:, 0] * edge[:, 1] - off[:, 1] * edge[:, 0]) / cross
        s = (off[:, 0] * way[1] - off[:, 1] * way[0]) / cross
    ok = (t > 0) & (t < 1 - 1e-6) & (s >= 0) & (s <= 1)
    above = at[0] + s * (at[1] - at[0]) - (z[0] + t * (z[1] - z[0]))
    return above[ok].max(initial=-np.inf)


def expected(heights, there, transform, observer, case):
    """What an observer sees, and where it is too near to tell."""
    height, target_height, bend = case
    eye = np.subtract(~transform @ observer, 0.5)
    j, i = np.meshgrid(np.arange(heights.shape[1]), np.arange(heights.shape[0]))
    x, y = transform @ (j + 0.5, i + 0.5)
    lowered = heights - bend * ((x - observer[0]) ** 2 + (y - observer[1]) ** 2)
    top = ground_at(lowered, eye) + height
    seen, near = np.zeros(heights.shape, bool), np.zeros(heights.shape, bool)
    for place in np.argwhere(there):
        row, column = place
        z = (top, lowered[row, column] + target_height)
        above = profile(lowered, there, eye, (column, row), z)
        seen[row, column], near[row, column] = above < 0, abs(above) < 1e-3
    return seen, near


@given(
    st.sampled_from(TRANSFORMS),
    st.integers(3, 8),
    st.integers(3, 8),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 3.0]),
    st.sampled_from([None, 0.0, 0.13]),
)
@settings(max_examples=30)
def test_beside_profiles(tmp_path_factory, transform, rows, columns, seed, lift, refraction):
    """With curvature each observer lowers the terrain from where it stands: one scene for all."""
    rng = np.random.default_rng(seed)
    size = 1.0 if refraction is None else 300.0
    transform = transform @ Affine.scale(size)
    heights = rng.uniform(0, 20 if refraction is None else 60, (rows, columns)).astype("f4")
    there = rng.random((rows, columns)) < 0.97
    there[:2, :2] = there[-2:, -2:] = True
    folder = tmp_path_factory.mktemp("a")
    write(folder / "a.tif", np.where(there, heights, -1).astype("f4"), transform, nodata=-1)
    near, far = rng.uniform(0.05, 0.95, (2, 2))  # in the first cell and in the last
    places = [near + 0.5, (columns - 0.5, rows - 0.5) - far]
    observers = np.array([transform @ place for place in places])
    case = {"height": [2.0, 9.0], "target_height": lift}
    if refraction is not None:
        case.update(curvature=True, refraction=refraction)
    with in_this_process() as patch:
        patch.setattr(viewshed, "RemoteFile", Written)
        patch.setattr(sheet, "serve", lambda begin: begin())
        counts = bfrt.viewshed(
            folder / "a.tif", folder / "v.tif", observers, memory=1 << 30, threads=1, **case
        )
    found = seen_in(folder / "v.tif")
    assert counts.tolist() == [np.count_nonzero(band) for band in found]
    bend = 0.0 if refraction is None else (1 - refraction) / (2 * RADIUS)
    for k, height in enumerate(case["height"]):
        seen, near = expected(
            heights.astype(float), there, transform, observers[k], (height, lift, bend)
        )
        assert near.mean() < 0.2
        assert (found[k] == seen)[~near].all()
        assert not found[k][~there].any()


def test_the_file_lies_where_the_raster_does(file, tmp_path):
    """By its processes."""
    heights = np.zeros((30, 20), "f4")
    heights[:, 10] = 50
    transform = TRANSFORMS[2]
    before = open_files()
    counts = bfrt.viewshed(write(file, heights, transform), tmp_path / "v.tif", transform @ (4, 9))
    with rasterio.open(tmp_path / "v.tif") as made:
        assert made.shape == (30, 20) and made.count == 1 and made.dtypes == ("uint8",)
        assert made.transform == transform and made.crs == CRS
        found = made.read(1)
    assert counts.tolist() == [np.count_nonzero(found)]
    assert (found[:, :11] == 255).all() and not found[:, 11:].any()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tif", "v.tif"]
    assert open_files() == before


def test_an_eye_over_a_wall_and_a_target_over_one(file, tmp_path, here):
    heights = np.zeros((9, 9), "f4")
    heights[:, 4] = 10
    write(file, heights)
    place = UTM @ (1.5, 4.5)
    for case, behind in (
        ({"height": 9}, False),
        ({"height": 30}, True),
        ({"height": 9, "target_height": 12}, True),
    ):
        bfrt.viewshed(file, tmp_path / "v.tif", place, **case)
        found = seen_in(tmp_path / "v.tif")[0]
        assert found[:, :5].all()
        assert found[4, 8] == behind


def test_nothing_is_seen_from_below(file, tmp_path, here):
    """A hill of which the half is missing: a line through there would come from inside of it."""
    heights = np.zeros((9, 15), "f4")
    heights[:, 5:11] = 40
    heights[:, 6:8] = -1
    write(file, heights, nodata=-1)
    bfrt.viewshed(file, tmp_path / "v.tif", UTM @ (9.4, 4.5), height=1)
    assert not seen_in(tmp_path / "v.tif")[0][:, :5].any()
    heights[:, :6] = -1
    bfrt.viewshed(write(file, heights, nodata=-1), tmp_path / "v.tif", UTM @ (13.5, 4.5), height=1)
    found = seen_in(tmp_path / "v.tif")[0]
    assert found[:, 11:].all() and found[:, 10].all() and not found[:, :10].any()


def test_flat_ground_is_seen_as_far_as_the_earth_lets_it(file, tmp_path, here):
    """The horizon of an eye at h is at sqrt(2 R h / (1 - k))."""
    side = 201
    write(file, np.zeros((side, side), "f4"), Affine(200, 0, 0, 0, -200, 0))
    place = np.array([side * 100, -side * 100], float)
    far = np.hypot(*np.meshgrid(*[(np.arange(side) - side // 2) * 200.0] * 2))
    assert bfrt.viewshed(file, tmp_path / "v.tif", place) == side**2
    for refraction in (0.0, 0.2):
        bfrt.viewshed(file, tmp_path / "v.tif", place, height=10, curvature=True,
                      refraction=refraction)  # fmt: skip
        horizon = math.sqrt(2 * RADIUS * 10 / (1 - refraction))
        found = seen_in(tmp_path / "v.tif")[0]
        assert found[far < horizon - 400].all()
        assert not found[far > horizon + 400].any()


def test_no_farther_than_asked(file, tmp_path, here):
    write(file, np.zeros((9, 9), "f4"))
    place = UTM @ (4.5, 4.5)
    assert bfrt.viewshed(file, tmp_path / "v.tif", place, max_distance=10.5) == 5
    found = seen_in(tmp_path / "v.tif")[0]
    assert found[4, 3:6].all() and found[3:6, 4].all() and found.sum() == 5


def test_degrees_with_a_scale(file, tmp_path, here):
    heights = np.zeros((9, 9), "f4")
    heights[:, 4] = 10
    grid = Affine(1e-4, 0, 11, 0, -1e-4, 47)
    write(file, heights, grid, "EPSG:4326")
    place = grid @ (1.5, 4.5)
    with pytest.raises(SettingError, match="in degrees"):
        bfrt.viewshed(file, tmp_path / "v.tif", place)
    for height, behind in ((9, False), (30, True)):
        bfrt.viewshed(file, tmp_path / "v.tif", place, height=height, height_scale=1 / 111_320)
        assert seen_in(tmp_path / "v.tif")[0][4, 8] == behind


def test_memory_and_rows_do_not_change_it(file, tmp_path, here, monkeypatch):
    rng = np.random.default_rng(5)
    write(file, rng.uniform(0, 30, (40, 50)).astype("f4"), tiled=True, blockxsize=16, blockysize=16)
    places = [UTM @ (7.3, 20.2), UTM @ (44.4, 33.1)]
    found = []
    for memory, pixels in (("230MiB", 1 << 16), ("1GiB", 70)):
        monkeypatch.setattr("bfrt.terrain.ground.PIXELS_AT_ONCE", pixels)
        bfrt.viewshed(file, tmp_path / "v.tif", places, memory=memory)
        found.append(seen_in(tmp_path / "v.tif"))
    assert np.array_equal(*found)
    assert 0.02 < found[0].mean() < 0.9


# --- what is refused -----------------------------------------------------------------------------

WRONG = [
    ({"observers": [(0, 0)]}, "observers: found no ground at 0 0, where observer 0 is"),
    ({"observers": [1, 2, 3]}, r"observers: found an array of shape \(3,\), expected \(n, 2\)"),
    ({"observers": []}, "observers: found an array of shape"),
    ({"observers": "a"}, "observers: found an array of shape"),
    ({"observers": [(np.nan, 0)]}, "observers: found a number that is not finite"),
    ({"height": 0}, "height: found 0, expected a finite number above 0"),
    ({"height": [1, 2]}, "height: found"),
    ({"height": np.nan}, "height: found nan"),
    ({"target_height": -1}, "target_height: found -1, expected a finite number of 0 or more"),
    ({"max_distance": 0}, "max_distance: found 0, expected a finite number above 0"),
    ({"refraction": 0.1}, "refraction: found without curvature"),
    ({"curvature": True, "refraction": "a"}, "refraction: found 'a', expected a finite number"),
    ({"band": 2}, "found band=2, expected 1 to 1"),
    ({"memory": "100MiB"}, "memory: found 100MiB, expected "),
    ({"out": "v.png"}, r"v.png: found suffix '.png', expected .tif, .tiff"),
    ({"raster": "a.ply"}, r"a.ply: found suffix '.ply', expected .tif, "),
    ({"scratch": "nowhere"}, "scratch: found nowhere, expected a folder"),
]


@pytest.mark.parametrize(("case", "words"), WRONG, ids=lambda value: str(value)[:40])
def test_what_is_refused(file, tmp_path, here, case, words):
    write(file)
    asked = {"raster": file, "out": tmp_path / "v.tif", "observers": UTM @ (4, 4), **case}
    with pytest.raises((SettingError, BudgetError), match=words):
        bfrt.viewshed(**asked)
    assert [path.name for path in tmp_path.iterdir()] == ["a.tif"]


def test_a_raster_is_not_replaced_by_what_is_seen_of_it(file, here):
    write(file)
    with pytest.raises(SettingError, match="found it twice"):
        bfrt.viewshed(file, file, UTM @ (4, 4))


def test_a_raster_without_ground(file, tmp_path, here):
    write(file, np.zeros((5, 5), "f4"), nodata=0)
    with pytest.raises(SettingError, match="found a raster without ground"):
        bfrt.viewshed(file, tmp_path / "v.tif", UTM @ (2, 2))
    assert [path.name for path in tmp_path.iterdir()] == ["a.tif"]


def test_a_raster_that_lies_nowhere_is_told_once(file, tmp_path, here, caplog):
    write(file, transform=None, crs=None)
    bfrt.viewshed(file, tmp_path / "v.tif", (3, 3))
    said = "found no transform: x and y count pixels, from the first one"
    assert [r.getMessage() for r in caplog.records if "transform" in r.getMessage()] == [
        f"{file}: {said}"
    ]


def test_a_broken_raster_leaves_what_there_was(file, tmp_path, here):
    write(file)
    bfrt.viewshed(file, tmp_path / "v.tif", UTM @ (4, 4))
    before = (tmp_path / "v.tif").read_bytes()
    file.write_bytes(file.read_bytes()[:400])
    with pytest.raises(SceneError):
        bfrt.viewshed(file, tmp_path / "v.tif", UTM @ (4, 4))
    assert (tmp_path / "v.tif").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("stage", ["reading", "looking"])
def test_it_can_be_cancelled(file, tmp_path, here, stage):
    write(file)
    with pytest.raises(Cancelled, match=f"while {stage}"):
        bfrt.viewshed(
            file, tmp_path / "v.tif", UTM @ (4, 4), progress=lambda done: done.stage != stage
        )
    assert [path.name for path in tmp_path.iterdir()] == ["a.tif"]


def test_a_file_that_cannot_be_written(file, tmp_path):
    """GDAL's process says so, and what is there is as before."""
    write(file)
    with pytest.raises((StreamError, BfrtError)) as caught:
        viewshed.RemoteFile(
            str(file), (str(tmp_path / "no" / "v.tif"), "v.tif", 1, (9, 7, [*UTM][:6], CRS)),
            viewshed.SHEET,
        )  # fmt: skip
    assert isinstance(caught.value, StreamError)
    assert str(caught.value).startswith("v.tif: writing at byte 0")


def test_the_command(file, tmp_path, here, capsys):
    write(file, np.zeros((9, 9), "f4"))
    x, y = UTM @ (4.5, 4.5)
    words = ["viewshed", str(file), "-o", str(tmp_path / "v.tif"), "--observer", str(x), str(y)]
    assert main([*words, "--observer", str(x + 10), str(y), "--height", "2", "--height", "3"]) == 0
    said = capsys.readouterr().out
    assert (
        said
        == f"{x:.12g} {y:.12g}: 81 pixels are seen\n{x + 10:.12g} {y:.12g}: 81 pixels are seen\n"
    )
    assert main([*words, "--curvature", "--refraction", "0.13", "--quiet"]) == 0
    assert main([*words, "--refraction", "0.13"]) == 2


@pytest.mark.skipif(shutil.which("gdal_viewshed") is None, reason="gdal_viewshed is not installed")
@pytest.mark.parametrize("curved", [False, True])
def test_nearly_what_gdal_finds(file, tmp_path, here, curved):
    """GDAL works out what has to be passed from pixel to pixel, not along lines: borders differ."""
    side, size = 120, 500.0 if curved else 10.0
    j, i = np.meshgrid(np.arange(side), np.arange(side))
    waves = np.sin(j / 9) * np.cos(i / 13) + 0.5 * np.sin((i + 2 * j) / 7)
    write(file, (waves * 40 + 100).astype("f4"), Affine(size, 0, 500_000, 0, -size, 5_400_000))
    x, y = 500_000 + size * 60.5, 5_400_000 - size * 50.5
    part = "0.85714" if curved else "0"
    words = ["-ox", x, "-oy", y, "-oz", 5, "-tz", 2, "-cc", part, file, tmp_path / "g.tif"]
    subprocess.run(["gdal_viewshed", "-q", *map(str, words)], check=True)
    bfrt.viewshed(file, tmp_path / "v.tif", (x, y), height=5, target_height=2, curvature=curved)
    ours, other = seen_in(tmp_path / "v.tif")[0], seen_in(tmp_path / "g.tif")[0]
    assert 0.05 < ours.mean() < 0.9
    assert (ours != other).mean() < 0.02
