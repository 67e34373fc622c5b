"""What is read of a raster: heights in are triangles out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, shapes_of
from properties import examples
from raster_files import CRS, HEIGHTS, UTM, in_this_process, rasterio, triangles, write

import bfrt
from bfrt.cli import main
from bfrt.errors import BudgetError, SceneError, SettingError
from bfrt.formats.raster import cells
from bfrt.formats.room import need_of

Affine = rasterio.Affine
ALL = np.ones(HEIGHTS.shape, bool)

#: North-up, south-up, mirrored, rotated, sheared, and without rows and columns in their place.
TRANSFORMS = [
    UTM,
    Affine(10, 0, 500_000, 0, 10, 5_400_000),
    Affine(-10, 0, 500_000, 0, -10, 5_400_000),
    Affine.translation(500_000, 5_400_000) @ Affine.rotation(33) @ Affine.scale(2.5, -2.5),
    Affine.translation(-70, 30) @ Affine.shear(20, 5) @ Affine.scale(0.125, 3),
    Affine(0, 10, 500_000, -10, 0, 5_400_000),
    Affine(0, 10, 500_000, 10, 0, 5_400_000),
]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.tif"


def test_a_raster_by_its_process(file):
    store = convert(write(file))
    assert shapes_of(store) == triangles(HEIGHTS, ALL, UTM)
    assert store.crs == CRS
    assert store.origin == (500_045.0, 5_399_965.0, 0.0)
    assert not store.streams[0].wide


@given(
    st.sampled_from(TRANSFORMS),
    st.integers(2, 9),
    st.integers(2, 9),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["float32", "float64", "int16", "uint8", "int32"]),
    st.sampled_from([1, 3, 1 << 15]),
)
@examples(60)
def test_cells_with_corners(tmp_path_factory, transform, rows, columns, seed, dtype, at_once):
    rng = np.random.default_rng(seed)
    heights = rng.integers(0, 250, (rows, columns)).astype(dtype)
    there = rng.random((rows, columns)) < 0.9
    heights[~there] = 255
    path = write(tmp_path_factory.mktemp("a") / "a.tif", heights, transform, nodata=255)
    with in_this_process() as patch:
        patch.setattr(cells, "CELLS_AT_ONCE", at_once)
        assert shapes_of(convert(path)) == triangles(heights, there, transform)


@pytest.mark.parametrize("transform", TRANSFORMS)
def test_normals_look_up(file, transform):
    with in_this_process():
        scene = bfrt.convert(write(file, transform=transform), file.with_suffix(".bfrt"))
    x, y = transform @ (4.2, 3.3)
    hit = scene.cast_rays([[x, y, 1e5]], [[0, 0, -1]])
    assert hit["primitive_normals"][0, 2] > 0


LAYOUTS = [
    {},
    {"compress": "deflate", "predictor": 3},
    {"compress": "lzw", "blockysize": 1},
    {"compress": "zstd", "blockysize": 5},
    {"tiled": True, "blockxsize": 16, "blockysize": 32},
    {"tiled": True, "blockxsize": 32, "blockysize": 16, "compress": "lzw"},
    {"BIGTIFF": "YES", "ENDIANNESS": "BIG"},
    {"driver": "COG", "compress": "deflate", "overviews": "none"},
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
@pytest.mark.parametrize("room", [8, 1 << 10])
def test_tilings_and_compressions(file, layout, room):
    """The triangles are the same, however many rows are read at once."""
    heights = np.arange(45 * 70, dtype=np.float32).reshape(45, 70) % 997
    write(file, heights, **layout)
    with in_this_process() as patch:
        if room < 1 << 10:  # a few rows
            patch.setattr("bfrt.formats.raster.child.BLOCK_COPIES", 0)
            rooms = [room * 40 * 70]
            patch.setattr("bfrt.conversion.writing.rooms_for", lambda *_: rooms)
        there = np.ones(heights.shape, bool)
        assert shapes_of(convert(file)) == triangles(heights, there, UTM)


def test_bands_of_one_file(file):
    bands = np.stack([HEIGHTS, HEIGHTS + 7])
    for interleave in ("pixel", "band"):
        write(file, bands, interleave=interleave)
        with in_this_process():
            assert shapes_of(convert(file)) == triangles(bands[0], ALL, UTM)
            assert shapes_of(convert(file, band=2)) == triangles(bands[1], ALL, UTM)
            said = failure(file, SettingError, band=3)
        assert said == "found band=3, expected 1 to 2, as the file has"
    for band in (0, -1, True, 1.0, "a"):
        with pytest.raises(SettingError, match=r"band: found .*, expected a whole number from 1"):
            convert(file, band=band)


def test_scales_of_the_file_and_of_the_call(file):
    write(file, HEIGHTS.astype(np.int16))
    with rasterio.open(file, "r+") as raster:
        raster.scales, raster.offsets = (0.5,), (-3.0,)
    with in_this_process():
        true = HEIGHTS.astype(np.int16) * 0.5 - 3
        assert shapes_of(convert(file)) == triangles(true, ALL, UTM)
        assert shapes_of(convert(file, height_scale=-4)) == triangles(true * -4, ALL, UTM)
    for scale in (0, np.nan, np.inf, "a"):
        with pytest.raises(SettingError, match="height_scale: found"):
            convert(file, height_scale=scale)


def test_masks_of_all_kinds(file):
    there = np.ones(HEIGHTS.shape, bool)
    there[2, 3] = there[6, 8] = False
    right = triangles(HEIGHTS, there, UTM)
    with in_this_process():
        for fill in (-9999.0, float("nan"), float(np.finfo("f4").min)):
            assert shapes_of(convert(write(file, np.where(there, HEIGHTS, fill).astype("f4"),
                                           nodata=fill))) == right  # fmt: skip
        with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
            write(file)
            with rasterio.open(file, "r+") as raster:
                raster.write_mask(there)
        assert shapes_of(convert(file)) == right
        alpha = np.stack([HEIGHTS.astype("u2"), there.astype("u2") * 65535])
        write(file, alpha, ALPHA="YES")
        whole = triangles(HEIGHTS.astype("u2"), there, UTM)
        assert shapes_of(convert(file)) == whole


def test_walls_around_what_is_missing(file):
    """From below nothing comes in: a ray from under the ground at the border meets a wall."""
    there = ALL.copy()
    there[3, 4] = False
    write(file, np.where(there, HEIGHTS + 5, 0).astype("f4"), nodata=0)
    with in_this_process():
        plain, walled = convert(file), convert(file, floor=2.0)
    found = np.array(shapes_of(bfrt.convert(file, file.with_suffix(".bfrt"), floor=2.0).store))
    assert walled.objects - plain.objects == 2 * 8
    walls = found[(np.ptp(found[:, :, :2], axis=1) == 0).any(axis=1)]
    assert len(walls) == 16 and (walls[..., 2].min(axis=1) == 2).all()
    scene = bfrt.open(file.with_suffix(".bfrt"))
    x, y = UTM @ (4.5, 3.5)
    for way in ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0.7, 0.7, 0)):
        assert scene.occluded([[x, y, 3.0]], [way], t_max=21.0)["occluded"].all()
    with in_this_process():
        assert "floor: found nan" in failure_of_setting(file, floor=np.nan)


def failure_of_setting(file, **settings):
    with pytest.raises(SettingError) as caught:
        convert(file, **settings)
    return str(caught.value)


def test_float64_is_stored_where_it_is_asked_for(file):
    with in_this_process():
        store = convert(write(file, HEIGHTS.astype("f8") + 1e-9), dtype="float64")
    assert store.streams[0].wide
    assert np.ptp([p[2] for each in shapes_of(store) for p in each] - HEIGHTS[0, 0]) > 0
    assert {p[2] for each in shapes_of(store) for p in each} <= set(
        (HEIGHTS.astype("f8") + 1e-9).ravel()
    )


def test_colors_by_height(file):
    with in_this_process():
        found = objects_of(convert(write(file), color_by="z", colormap="gray"))
        shade = [each.color[0] for each in found]
        mean = [np.mean([p[2] for p in each.shape]) for each in found]
        assert (np.diff(np.array(shade)[np.argsort(mean, kind="stable")]) >= 0).all()
        assert "found color_by='quality'" in failure(file, SettingError, color_by="quality")


def test_a_lowered_raster_hides_what_one_lowered_elsewhere_hides(file):
    """The difference is linear, which `bend_of` says."""
    radius, part = 6378137.0, 0.8
    wide = Affine(9000.0, 0, 0, 0, -9000.0, 0)
    with in_this_process():
        found = np.array(shapes_of(convert(write(file, HEIGHTS, wide), curvature=part)))
        flat = np.array(shapes_of(convert(file)))
    x, y = wide @ (4.5, 3.5)
    far = (flat[..., 0] - x) ** 2 + (flat[..., 1] - y) ** 2
    assert np.allclose(found[..., 2], flat[..., 2] - part * far / (2 * radius), atol=1e-3)
    assert np.ptp(found[..., 2] - flat[..., 2]) > 50


# --- reference systems ---------------------------------------------------------------------------

DEGREES = Affine(0.001, 0, 11.0, 0, -0.001, 47.0)


def test_degrees_are_refused_with_what_to_do(file):
    write(file, transform=DEGREES, crs="EPSG:4326")
    with in_this_process():
        said = failure(file, SettingError)
        assert said.startswith("found a reference system in degrees, EPSG:4326, expected one in")
        assert "gdalwarp -t_srs EPSG:32632" in said and "--height-scale" in said
        store = convert(file, height_scale=1 / 111_320)
        assert shapes_of(store) == triangles(HEIGHTS.astype("f8") / 111_320, ALL, DEGREES)
        assert store.crs == "EPSG:4326"
        assert "in degrees" in failure(file, SettingError, height_scale=1.0, curvature=1.0)


def test_a_system_without_a_number_is_kept_as_wkt(file):
    with in_this_process():
        store = convert(write(file, crs="+proj=aea +lat_1=29.5 +lat_2=45.5 +lon_0=-96"))
        assert store.crs.startswith("PROJCS[")
        assert convert(write(file, crs=None)).crs == ""


def test_two_systems_do_not_make_one_scene(file, tmp_path):
    other = write(tmp_path / "b.tif", crs="EPSG:32633")
    with in_this_process(), pytest.raises(SceneError) as caught:
        bfrt.convert([write(file), other], tmp_path / "c.bfrt")
    assert str(caught.value) == (
        f"{other}: crs: found EPSG:32633, expected EPSG:32632, as of what was before: reproject "
        "one of them"
    )


def test_a_raster_that_lies_nowhere(file, caplog):
    write(file, transform=None, crs=None)
    with in_this_process():
        found = shapes_of(convert(file))
    assert found == triangles(HEIGHTS, ALL, Affine.identity())
    said = "found no transform: x and y count pixels, from the first one"
    assert [record.getMessage() for record in caplog.records] == [f"{file}: {said}"]


def test_info_tells_the_system(file, capsys):
    with in_this_process():
        convert(write(file))
    assert main(["info", str(file.with_suffix(".bfrt"))]) == 0
    assert "crs: EPSG:32632\n" in capsys.readouterr().out


def test_a_checkpoint_keeps_the_system(file, tmp_path):
    stores = [tmp_path / "c.bfrt", tmp_path / "d.bfrt"]
    with in_this_process():
        bfrt.convert(write(file), stores[0], checkpoint=tmp_path / "kept", every=0)
        bfrt.convert(file, stores[1])
    headers = [(store / "scene.json").read_bytes() for store in stores]
    assert headers[0] == headers[1]


# --- memory --------------------------------------------------------------------------------------


def test_blocks_larger_than_memory_are_refused(tmp_path):
    file = write(
        tmp_path / "a.tif", np.zeros((2000, 3000), "f4"), compress="deflate", blockysize=2000
    )
    least = need_of(str(file)).least
    with in_this_process():
        said = failure(file, BudgetError, memory=least)
    assert said.startswith("found blocks of 2000 x 3000 float32 and rows of 3000, expected smaller")
    enough = said.split("memory=")[1].split()[0]
    with in_this_process():
        assert convert(file, memory=enough).objects == 2 * 1999 * 2999


def test_the_commands_options(file, tmp_path):
    write(file, np.stack([HEIGHTS, HEIGHTS]))
    out = tmp_path / "o.bfrt"
    words = ["--band", "2", "--height-scale", "2", "--curvature", "1", "--quiet"]
    with in_this_process():
        assert main(["convert", str(file), "-o", str(out), *words]) == 0
    assert bfrt.open(out).bounds.hi[2] == pytest.approx(HEIGHTS.max() * 2)
