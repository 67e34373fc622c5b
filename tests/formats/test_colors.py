"""Maps of numbers to colors, and colors of a file's own."""

from __future__ import annotations

import importlib.util
import math
import sys

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import NO_VALUE, Painter
from bfrt.formats.ranges import ends_of, numbers_at, value_range
from bfrt.formats.reading import End, Reading
from bfrt.image.color_scale import ColorScale
from bfrt.image.colormaps import STEPS, colormap, cubehelix, linear

HAS_MATPLOTLIB = importlib.util.find_spec("matplotlib") is not None


class Palette:
    """A sink that numbers materials."""

    def __init__(self):
        self.materials = []

    def material(self, material):
        if material not in self.materials:
            self.materials.append(material)
        return self.materials.index(material)

    def colors(self, indices):
        return np.array([self.materials[i].color for i in indices.tolist()]).reshape(-1, 3)


def paint(values, blocks=None, **asked):
    """Colors of values, as light."""
    palette = Palette()
    values = np.asarray(values)
    painter = Painter(palette, Reading(**asked), blocks or (lambda: [values]), "file")
    indices = painter.paint(values)
    assert indices.dtype == np.uint32
    return palette.colors(indices)


# --- maps ----------------------------------------------------------------------------------------


def green(t, start=0.5, rotations=-1.5, hue=1.0, gamma=1.0):
    """Equations 1 and 2 of Green 2011, a number at a time."""
    angle = 2 * math.pi * (start / 3 + rotations * t + 1)
    a = hue * t**gamma * (1 - t**gamma) / 2
    c, s = math.cos(angle), math.sin(angle)
    return [
        t**gamma + a * (-0.14861 * c + 1.78277 * s),
        t**gamma + a * (-0.29227 * c - 0.90649 * s),
        t**gamma + a * (1.97294 * c + 0.0 * s),
    ]


def test_cubehelix_is_greens():
    t = np.linspace(0, 1, 501)
    right = np.clip([green(x) for x in t.tolist()], 0, 1)
    np.testing.assert_allclose(cubehelix(t), right, atol=1e-14)


def test_cubehelix_goes_from_black_to_white_and_brightens():
    t = np.linspace(0, 1, 2001)
    colors = cubehelix(t)
    assert colors[0].tolist() == [0, 0, 0]
    assert colors[-1].tolist() == [1, 1, 1]
    assert (np.diff(colors @ [0.30, 0.59, 0.11]) > 0).all()  # the paper's perceived intensity


def test_maps():
    gray = colormap("gray")
    assert gray.shape == (STEPS, 3)
    assert (gray == np.linspace(0, 1, STEPS)[:, None]).all()
    helix = colormap("cubehelix")
    np.testing.assert_allclose(helix[0], green(0.15), atol=1e-12)
    np.testing.assert_allclose(helix[-1], green(0.85), atol=1e-12)
    assert helix.shape == (STEPS, 3)
    assert (helix >= 0).all()
    assert (helix <= 1).all()


@pytest.mark.skipif(not HAS_MATPLOTLIB, reason="matplotlib is not installed")
def test_matplotlibs_maps():
    import matplotlib

    steps = np.linspace(0, 1, STEPS)
    np.testing.assert_array_equal(colormap("magma"), matplotlib.colormaps["magma"](steps)[:, :3])
    ours, right = colormap("viridis"), matplotlib.colormaps["viridis"](steps)[:, :3]
    np.testing.assert_allclose(ours, right, atol=0.5001 / 65535)
    with pytest.raises(SettingError, match="'nope', expected viridis, cubehelix, gray or matplotl"):
        colormap("nope")


def test_maps_without_matplotlib(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # as if there were none
    with pytest.raises(SettingError) as caught:
        colormap("magma")
    assert str(caught.value) == (
        "colormap: found 'magma', expected viridis, cubehelix, gray, or matplotlib for more maps"
    )
    assert len(colormap("cubehelix")) == len(colormap("gray")) == len(colormap("viridis")) == STEPS


def test_viridis_brightens_evenly():
    """It is from dark blue to yellow, and no step of its light is far from the mean (CIE L*)."""
    light = linear(colormap("viridis")) @ [0.2126, 0.7152, 0.0722]
    lightness = 116 * np.cbrt(light) - 16
    steps = np.diff(lightness)
    assert (steps > 0).all() and steps.max() < 2.5 * steps.mean()
    first, last = colormap("viridis")[[0, -1]] * 255
    assert np.rint([first, last]).tolist() == [[68, 1, 84], [253, 231, 37]]


def test_srgb_as_light():
    values = np.linspace(0, 1, 300)
    light = linear(values)
    back = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(back, values, atol=2e-5)
    assert (light[0], light[-1]) == (0, 1)
    assert (np.diff(light) > 0).all()


# --- numbers -------------------------------------------------------------------------------------


@examples(80)
@example(values=[-1.0], ends=(0.0, 2.2250738585e-313), dtype=np.float32)
@given(
    values=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40),
    ends=st.one_of(st.none(), st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))),
    dtype=st.sampled_from([np.float32, np.float64]),
)
def test_steps_of_numbers(values, ends, dtype):
    values = np.array(values, dtype)
    asked = None if ends is None else (min(ends), max(ends))
    lo, hi = asked or (values.min().item(), values.max().item())
    shades = paint(values, color_by="x", colormap="gray", color_range=asked)
    table = linear(colormap("gray"))
    for value, shade in zip(values.tolist(), shades, strict=True):
        place = (value - lo) / (hi - lo) * STEPS if hi > lo else 0.0
        place = min(max(place, -1.0), 2.0 * STEPS)  # infinite where the range is almost nothing
        steps = [min(max(math.floor(place * (1 + e)), 0), STEPS - 1) for e in (-1e-14, 1e-14)]
        assert any((shade == table[step]).all() for step in steps)


def test_ends_and_beyond():
    values = [-math.inf, -5.0, 0.0, 0.999 / STEPS, 1.001 / STEPS, 0.9999, 1.0, 7.0, math.inf]
    table = linear(colormap("viridis"))
    right = table[[0, 0, 0, 0, 1, STEPS - 1, STEPS - 1, STEPS - 1, STEPS - 1]]
    np.testing.assert_array_equal(paint(values, color_by="x", color_range=(0, 1)), right)


def test_what_has_no_number_is_gray():
    shades = paint([0.0, math.nan, 1.0], color_by="x")
    assert shades[1].tolist() == list(NO_VALUE) == [0.5] * 3
    assert shades[0].tolist() == linear(colormap("viridis"))[0].tolist()


def test_a_span_of_almost_nothing():
    shades = paint([0.0, 5e-324, math.nan, 1e-310], color_by="x", colormap="gray")
    assert shades[0].tolist() == [0] * 3
    assert shades[2].tolist() == list(NO_VALUE)
    assert shades[3].tolist() == [1] * 3


def test_one_number_only():
    for number in (0.0, 3.5, -1e300):
        shades = paint([number, math.nan, number], color_by="x", colormap="gray")
        assert shades.tolist() == [[0, 0, 0], [0.5] * 3, [0, 0, 0]]


def test_whole_numbers():
    shades = paint(np.array([0, 1, 255], np.uint8), color_by="x", colormap="gray")
    np.testing.assert_array_equal(shades, linear(colormap("gray"))[[0, 1, 255]])


def test_a_range_takes_all_blocks():
    blocks = [np.array([3.0, np.nan]), np.array([]), np.array([-np.inf, -7.0]), np.array([np.inf])]
    assert value_range(blocks, "file") == (-7, 3)
    assert value_range([np.array([5], np.int64)], "file") == (5, 5)
    for nothing in ([], [np.array([])], [np.array([np.nan]), np.array([np.inf, -np.inf])]):
        with pytest.raises(
            SceneError, match=r"^file: found no finite number to color by, expected"
        ):
            value_range(nothing, "file")


def test_a_range_that_is_given_is_not_looked_for():
    def never():
        raise AssertionError

    assert len(paint([1.0], blocks=never, color_by="x", color_range=(0, 1))) == 1


def test_a_map_takes_few_materials():
    palette = Palette()
    painter = Painter(palette, Reading(color_by="x", color_range=(0, 1)), list, "file")
    painter.paint(np.linspace(-1, 2, 10_000))
    assert len(palette.materials) == STEPS + 1
    assert {material[1:] for material in palette.materials} == {(1.0, 0.0, 1.0, 0.0, 1.0)}


# --- ranks, and ratios ---------------------------------------------------------------------------


def at(values, *percents, parts=3, log=False):
    blocks = np.array_split(np.asarray(values), parts)
    ranks = [End.of(f"{percent}%").rank for percent in percents]
    return numbers_at(lambda: iter(blocks), ranks, "file", log=log)


FLOATS = {np.float64: st.floats(allow_nan=True), np.float32: st.floats(width=32)}


@examples(150)
@given(
    data=st.data(),
    dtype=st.sampled_from([np.float64, np.float32, np.int64, np.uint8]),
    percents=st.lists(st.integers(0, 1000), min_size=1, max_size=2),
)
def test_a_percentile_is_that_of_all_numbers_in_order(data, dtype, percents):
    """Whatever they are, and however they come in blocks."""
    whole = np.issubdtype(dtype, np.integer)
    info = np.iinfo(dtype) if whole else None
    one = st.integers(info.min, info.max) if whole else FLOATS[dtype]
    values = np.array(data.draw(st.lists(one, min_size=1, max_size=50)), dtype)
    kept = np.sort(values[np.isfinite(values)].astype(np.float64))
    found_by = [n / 10 for n in percents]
    if not len(kept):
        with pytest.raises(SceneError, match="found no finite number to color by"):
            at(values, *found_by)
        return
    places = [max(0, -(-n * len(kept) // 1000) - 1) for n in percents]
    for parts in (1, 4):
        assert at(values, *found_by, parts=parts) == [kept[place] for place in places]


def test_ends_by_rank():
    values = np.random.default_rng(2).permutation(np.arange(-50, 151).astype(np.float32))
    passes = []

    def blocks():
        passes.append(1)
        return iter(np.array_split(values, 7))

    def ends(*asked, log=False):
        return ends_of(blocks, tuple(map(End.of, asked)), "file", log=log)

    assert ends("2%", "98%") == (-46, 146)
    assert ends("0%", "100%") == (-50, 150)
    assert ends(-7, "50%") == (-7, 50)
    assert ends("50%", 1e3, log=True) == (75, 1000)  # of those above 0
    assert ends(" 12.5 ", "100%") == (12.5, 150)
    assert len(passes) <= 3 * 5  # float32 has few bits
    del passes[:]
    assert ends(3, 4) == (3, 4) and passes == []
    with pytest.raises(
        SettingError, match=r"^color_range: found 200 to 50 in file, expected the le"
    ):
        ends(200, "50%")
    with pytest.raises(
        SettingError, match="found 0 to 50 in file, expected the lesser first, above"
    ):
        ends(0, 50, log=True)


def test_the_memory_of_a_rank_does_not_grow():
    """A million numbers, a thousand at a time."""
    import tracemalloc

    def blocks():
        for seed in range(1000):
            yield np.random.default_rng(seed).random(1000)

    tracemalloc.start()
    (middle,) = numbers_at(blocks, [End.of("50%").rank], "file", log=False)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert abs(middle - 0.5) < 0.002
    assert peak < 4 << 20


@examples(150)
@given(
    ends=st.tuples(st.floats(1e-300, 1e300), st.floats(1e-300, 1e300)),
    values=st.lists(st.floats(1e-305, 1e305), min_size=2, max_size=30),
)
def test_steps_of_ratios(ends, values):
    """As logarithms have them, but for rounding; a greater number has no lesser step."""
    lo, hi = min(ends), max(ends)
    numbers = np.sort(values)
    steps = ColorScale("x", "gray", lo, hi, log=True).steps(numbers)
    assert (np.diff(steps) >= 0).all() and steps.min() >= 0 and steps.max() < STEPS
    span = math.log(hi) - math.log(lo)
    for number, step in zip(numbers.tolist(), steps.tolist(), strict=True):
        if span < 1e-9:
            continue
        place = (math.log(number) - math.log(lo)) / span * STEPS
        slack = 1e-9 + 1e-11 / span
        possible = [min(max(math.floor(place + e), 0), STEPS - 1) for e in (-slack, slack)]
        assert possible[0] <= step <= possible[1]


def test_ratios_of_numbers():
    values = [-1.0, 0.0, 1.0, 10.0, 100.0, 1e4, 5e4, math.nan, math.inf]
    found = paint(values, color_by="x", color_log=True, color_range=(1, 1e4), colormap="gray")
    gray = [*linear(colormap("gray"))[:, 0].tolist(), NO_VALUE[0]]
    steps = [gray.index(shade) for shade in found[:, 0].tolist()]
    assert steps == [STEPS, STEPS, 0, 64, 128, 255, 255, STEPS, 255]
    ones = paint([0.0, 1e-3, 10.0, -5.0], color_by="x", color_log=True, colormap="gray")
    assert ones[:, 0].tolist() == [0.5, 0.0, 1.0, 0.5]  # the least above 0 is the first
    with pytest.raises(SceneError, match=r"^file: found no finite number above 0 to color by"):
        paint([0.0, -1.0], color_by="x", color_log=True)


def test_the_widest_ratio_there_is():
    scale = ColorScale("x", "gray", 5e-324, 1.7e308, log=True)
    borders = scale.borders()
    assert np.isfinite(borders).all() and (np.diff(borders) > 0).all()
    assert scale.steps(np.array([5e-324, 1.7e308])).tolist() == [0, STEPS - 1]
    assert ColorScale("x", "gray", 3.0, 3.0, log=True).steps(np.array([2.0, 3.0])).tolist() == [
        0,
        255,
    ]


# --- colors --------------------------------------------------------------------------------------


@examples(60)
@given(
    colors=st.lists(
        st.tuples(*[st.one_of(st.floats(0, 1), st.sampled_from([0.0, 1.0, 2.0, -1.0]))] * 3),
        min_size=1, max_size=20,
    )
)  # fmt: skip
def test_colors_are_rounded_to_5_6_5(colors):
    found = paint(np.array(colors), color_by="rgb")
    for color, shade in zip(colors, found, strict=True):
        parts = [min(max(part, 0.0), 1.0) for part in color]
        rounded = [
            round(part * most) / most for part, most in zip(parts, (31, 63, 31), strict=True)
        ]
        np.testing.assert_allclose(shade, linear(np.array(rounded)), atol=1e-12)


def test_all_colors_of_8_bits():
    """Each part is off by half a step at the most, and the ends are exact."""
    values = np.arange(256) / 255
    for channel, most in ((0, 31), (1, 63), (2, 31)):
        colors = np.zeros((256, 3))
        colors[:, channel] = values
        found = paint(colors, color_by="rgb")[:, channel]
        right = np.rint(values * most) / most
        np.testing.assert_allclose(found, linear(right))
        assert np.abs(right - values).max() <= 0.5 / most + 1e-12
        assert (found[0], found[-1]) == (0, 1)


def test_colors_are_given_once():
    palette = Palette()
    painter = Painter(palette, Reading(color_by="rgb"), list, "file")
    colors = np.random.default_rng(1).integers(0, 3, (500, 3)) / 2
    first, again = painter.paint(colors), painter.paint(colors[::-1].copy())
    assert (first == again[::-1]).all()
    assert len(palette.materials) == 27


def test_colors_that_are_none():
    found = paint(np.array([[np.nan, 1.0, np.inf], [-np.inf, 0.0, 0.0]]), color_by="rgb")
    assert found.tolist() == [[0, 1, 1], [0, 0, 0]]


@pytest.mark.parametrize(
    "asked", [{"colormap": "gray"}, {"color_range": (0, 1)}, {"color_log": True}]
)
def test_a_map_for_colors(asked):
    with pytest.raises(SettingError, match=r"^color_by: found rgb with a map, expected rgb alone$"):
        paint(np.zeros((1, 3)), color_by="rgb", **asked)


@pytest.mark.parametrize(
    "bad",
    [(1, 0), (0, math.nan), (math.nan, 0), (-math.inf, 0), (0, math.inf), (1,), (1, 2, 3), "ab", 5,
     ("x", 1), ("5%", "2%"), ("-1%", "50%"), (0, "101%"), ("x%", 1), ("%", 1), ("nan%", 1)],
)  # fmt: skip
def test_ranges_that_are_none(bad):
    with pytest.raises(SettingError, match=r"^color_range: found .*, expected two finite numbers"):
        Reading(color_by="x", color_range=bad)
