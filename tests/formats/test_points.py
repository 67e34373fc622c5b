"""Points that become spheres, whatever file they are from: radii, colors, and what is dropped."""

from __future__ import annotations

import logging
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import NO_VALUE
from bfrt.formats.object_writer import ObjectWriter
from bfrt.formats.points import PointBlock, write_points
from bfrt.formats.reading import Reading
from bfrt.formats.spacing import SAMPLE, spacing_of
from bfrt.image.colormaps import STEPS, colormap, cubehelix, linear
from bfrt.records import Kind

RNG = np.random.default_rng(8)
CENTERS = RNG.normal(size=(20, 3)).astype(np.float32)


class Sink:
    """Keeps spheres and their colors."""

    def __init__(self):
        self.palette = {}
        self.records = []
        self.materials = []

    def material(self, material):
        return self.palette.setdefault(material.color, len(self.palette))

    def color_scale(self, scale):
        self.scale = scale

    def append(self, kind, records, materials):
        assert kind is Kind.SPHERE
        assert records.shape == (len(materials), 4) and len(materials)
        assert records.flags.c_contiguous and materials.dtype == np.uint32
        self.records.append(records)
        self.materials += materials.tolist()

    @property
    def colors(self):
        names = list(self.palette)
        return [names[index] for index in self.materials]


class Given:
    """Points of arrays, in blocks of any size."""

    name = "points"

    def __init__(self, centers, radii=None, values=None, block=7):
        self.arrays = [None if a is None else np.asarray(a) for a in (centers, radii, values)]
        self.painted = values is not None
        self.block = block

    def blocks(self):
        for first in range(0, len(self.arrays[0]), self.block):
            part = slice(first, first + self.block)
            yield PointBlock(*(None if a is None else a[part] for a in self.arrays))

    def numbers(self):
        return (block.values for block in self.blocks())


def written(points, **asked):
    """The spheres, (n, 4), and the sink that took them."""
    sink = Sink()
    writer = ObjectWriter(sink, points.name, Reading(**asked))
    write_points(points, writer)
    writer.report()
    records = np.concatenate(sink.records) if sink.records else np.empty((0, 4))
    return records, sink


def painted(values, **asked):
    """The colors of points with these values."""
    values = np.asarray(values)
    return written(Given(np.zeros((len(values), 3)), None, values), radius=1, **asked)[1].colors


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("block", [1, 7, 100])
def test_spheres_are_of_the_positions_type(dtype, block):
    centers, radii = CENTERS.astype(dtype), np.arange(20)
    records, _ = written(Given(centers, radii, block=block))
    assert records.dtype == dtype
    assert np.array_equal(records, np.column_stack([centers, radii]))
    for radius in (2, 0.5, np.float32(0.5), np.int64(2)):
        records, _ = written(Given(centers, block=block), radius=radius)
        assert records.dtype == dtype
        assert (records[:, 3] == radius).all()


def without_radius(centers):
    """What is said of points without a radius."""
    with pytest.raises(SettingError) as caught:
        written(Given(centers))
    said = "points: found points without a radius, expected radius= (--radius on the command line)"
    assert str(caught.value).startswith(said)
    return str(caught.value).removeprefix(said)


def test_points_without_a_radius():
    said = without_radius(CENTERS)
    spacing = spacing_of(lambda: iter([CENTERS])).distance
    assert said == f", as auto, which takes their spacing: {spacing:.3g}"
    for rows in (np.ones((5, 3)), CENTERS[:1], np.full((3, 3), np.nan)):
        assert without_radius(rows) == ""
        with pytest.raises(SettingError, match="found no two points that are apart, expected a"):
            written(Given(rows), radius="auto")
    assert len(written(Given(CENTERS[:0]))[0]) == 0


def test_radii_by_type_of_points_without_one():
    said = "found radius='1=2,2=3' for points without a type, expected a number, the name"
    with pytest.raises(SettingError, match=said):
        written(Given(CENTERS), radius="1=2,2=3")


def nearest(rows):
    """The median of the distances to the nearest that is elsewhere, of all points."""
    apart = np.linalg.norm(rows[:, None] - rows, axis=2)
    apart[apart == 0] = np.inf
    least = apart.min(axis=1)
    least = least[np.isfinite(least)]
    return np.median(least) if len(least) else 0.0


@pytest.mark.parametrize("dtype", ["f4", "f8"])
@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_the_spacing_of_a_net(axes, scale, dtype, caplog):
    """Of a line, a surface and a volume: spheres of it touch."""
    caplog.set_level(logging.INFO)
    steps = np.linspace(0, 4, 101 if axes == 1 else 21)
    net = np.stack(np.meshgrid(*[steps] * axes), axis=-1).reshape(-1, axes)
    rows = np.zeros((len(net), 3))
    rows[:, :axes] = net * scale
    rows = np.vstack([rows, np.full(3, np.nan), rows[:9]]).astype(dtype)
    records, _ = written(Given(rows, block=99), radius="auto", skip_invalid=True)
    assert len(records) == len(rows) - 1
    assert records[:, 3] == pytest.approx((steps[1] - steps[0]) * scale, rel=1e-4)
    assert f"radius {records[0, 3]:.3g}, the median distance of" in caplog.messages[0]


@given(st.integers(2, SAMPLE), st.integers(1, 300), st.integers(0, 99))
def test_the_spacing_of_few_points_is_exact(count, block, seed):
    rows = np.random.default_rng(seed).normal((5e5, 5e6, 300), 1, (count, 3))
    rows[count // 2 :: 3] = rows[0]
    blocks = [rows[first : first + block] for first in range(0, count, block)]
    found = spacing_of(lambda: iter(blocks))
    assert found.distance == pytest.approx(nearest(rows), rel=1e-6)
    assert found.sample == (count if found.distance else 0)


def test_the_spacing_of_many_points():
    """A sample of them is near; of clusters too, whose bounds say nothing of it."""
    random = np.random.default_rng(3)
    clusters = random.uniform(0, 1e4, (20, 3))
    rows = (clusters[:, None] + random.normal(size=(20, 200, 3))).reshape(-1, 3)
    found = spacing_of(lambda: iter(np.array_split(rows, 7)))
    assert found == spacing_of(lambda: iter(np.array_split(rows, 3)))
    assert found.sample == SAMPLE
    assert found.distance == pytest.approx(nearest(rows), rel=0.15)


@given(
    st.lists(st.sampled_from([0.0, 1.0, np.nan, np.inf, -np.inf, 1e39]), min_size=1, max_size=30),
    st.integers(1, 9),
)
def test_what_is_not_finite_is_refused_or_dropped(numbers, block):
    rows = np.zeros((len(numbers), 3))
    rows[:, 1] = numbers
    good = np.abs(rows[:, 1]) < 1e38
    points = Given(rows, np.arange(len(rows)), np.arange(len(rows)), block)
    records, sink = written(points, skip_invalid=True, color_by="v", color_range=(0, 255))
    assert np.array_equal(records[:, 3], np.flatnonzero(good))
    assert sink.materials == np.flatnonzero(good).tolist()  # each keeps its own color
    if not good.all():
        bad = int(np.argmin(good))
        most = ", up to 3.4e+38" if numbers[bad] == 1e39 else ""
        said = f"^points: point {bad}: found 0 .* 0 {bad}, expected finite numbers{most}$"
        with pytest.raises(SceneError, match=said.replace("+", r"\+")):
            written(points)


def test_dropped_ones_are_counted_and_told(caplog):
    rows = CENTERS.copy()
    rows[[3, 4, 19]] = np.nan
    assert len(written(Given(rows), radius=1, skip_invalid=True)[0]) == 17
    assert caplog.messages == ["points: 3 invalid objects were dropped"]
    caplog.clear()
    written(Given(CENTERS), radius=1, skip_invalid=True)
    assert caplog.messages == []


# --- colors --------------------------------------------------------------------------------------


def test_a_map_goes_from_the_least_to_the_greatest():
    values = RNG.permutation(np.linspace(-3, 7, 60))
    shades = np.array(painted(values, color_by="v", colormap="gray"))[:, 0]
    assert (np.diff(shades[np.argsort(values)]) >= 0).all()
    assert shades[values.argmin()] == 0 and shades[values.argmax()] == 1
    exact = linear(np.rint((values + 3) / 10 * 255) / 255)
    assert np.abs(shades - exact).max() < 0.02


def test_a_range_clips():
    values = [-np.inf, -1, 0, 0.5, 1, 7, np.inf, np.nan]
    found = painted(values, color_by="v", colormap="gray", color_range=(0, 1))
    shades = [color[0] for color in found]
    assert shades[:3] == [0, 0, 0] and shades[4:7] == [1, 1, 1]
    assert 0 < shades[3] < 1
    assert found[7] == NO_VALUE


@pytest.mark.parametrize("values", [[5, 5, 5], [5, np.nan, np.inf]])
def test_one_number_is_the_first_color(values):
    assert painted(values, color_by="v", colormap="gray")[0] == (0, 0, 0)


@pytest.mark.parametrize("dtype", ["?", "u1", "i8", "u8", ">i2", "f2", "f4"])
def test_numbers_of_any_type(dtype):
    found = painted(np.array([0, 1, 1, 0]).astype(dtype), color_by="v", colormap="gray")
    assert [color[0] for color in found] == [0, 1, 1, 0]


def test_numbers_as_far_apart_as_there_are():
    assert len(painted([-1.7e308, 0, 1.7e308], color_by="v")) == 3


def test_nothing_to_color_by():
    with pytest.raises(SceneError, match=r"^points: found no finite number to color by, expected"):
        painted([np.nan, np.inf], color_by="v")
    found = painted([np.nan, np.inf], color_by="v", color_range=(0, 1))
    assert found[0] == NO_VALUE


@given(st.lists(st.tuples(*[st.floats(0, 1)] * 3), min_size=1, max_size=30))
def test_colors_of_the_files_own_are_near(rgb):
    found = np.array(painted(rgb, color_by="rgb"))
    rounded = np.rint(np.array(rgb) * [31, 63, 31]) / [31, 63, 31]
    assert np.abs(found - linear(rounded)).max() < 1e-12
    again = np.array(painted(rounded, color_by="rgb"))
    assert np.array_equal(found, again)


def test_colors_out_of_range():
    found = painted([[-1, 2, np.nan], [np.inf, -np.inf, 0.5]], color_by="rgb")
    assert found[0] == (0, 1, 0) and found[1][:2] == (1, 0)


def test_few_materials_for_many_colors():
    """Objects of any number have a material of two bytes."""
    sink = written(Given(np.zeros((5000, 3)), None, RNG.random((5000, 3)), 999), radius=1,
                   color_by="rgb")[1]  # fmt: skip
    assert len(sink.palette) <= 1 << 16
    assert len(painted(np.arange(5000), color_by="v")) == 5000
    sink = written(Given(np.zeros((5000, 3)), None, np.arange(5000)), radius=1, color_by="v")[1]
    assert len(sink.palette) == STEPS + 1


def test_maps_rise_in_luminance():
    for t in (np.linspace(0, 1, STEPS), np.linspace(0, 1, 7)):
        luminance = cubehelix(t) @ [0.30, 0.59, 0.11]
        assert (np.diff(luminance) > 0).all()
    assert cubehelix(np.array([0.0, 1.0])).tolist() == [[0, 0, 0], [1, 1, 1]]
    for name in ("gray", "cubehelix", "viridis"):
        colors = colormap(name)
        assert colors.shape == (STEPS, 3)
        assert (colors >= 0).all() and (colors <= 1).all()


def test_maps_of_matplotlib(monkeypatch):
    """Whether it is there or not."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(SettingError, match="or matplotlib for more maps"):
        painted([1, 2], color_by="v", colormap="magma")
    assert len(painted([1, 2], color_by="v", colormap="viridis")) == 2
    there = SimpleNamespace(colormaps={"mine": lambda t: np.stack([t, t, t * 0, t], axis=1)})
    monkeypatch.setitem(sys.modules, "matplotlib", there)
    assert painted([0, 1], color_by="v", colormap="mine") == [(0, 0, 0), (1, 1, 0)]
    with pytest.raises(SettingError, match="found 'other', expected viridis, cubehelix, gray or"):
        painted([1, 2], color_by="v", colormap="other")


@pytest.mark.parametrize("asked", [{"colormap": "gray"}, {"color_range": (0, 1)}])
def test_a_map_for_the_files_own_colors(asked):
    with pytest.raises(SettingError, match="found rgb with a map, expected rgb alone"):
        painted([[1, 1, 1]], color_by="rgb", **asked)
