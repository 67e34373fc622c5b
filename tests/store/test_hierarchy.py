"""A hierarchy is what sequential merging makes of the boxes, and never loses an object."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bfrt
from bfrt.errors import SceneError, SettingError
from bfrt.records import PARENT, Kind
from bfrt.store._hierarchy import Merger, quantise
from bfrt.store.extent import Bounds
from bfrt.store.hierarchy import Hierarchy, HierarchyWriter, parse_hierarchy
from bfrt.store.store import open_store
from bfrt.store.writer import StoreWriter


def random_boxes(rng, n):
    """Small boxes on a walk, a few large ones, and empty ones of degenerate objects."""
    center = np.cumsum(rng.normal(0, 0.1, (n, 3)), axis=0)
    half = 10.0 ** rng.uniform(-2, 0, (n, 1))
    boxes = np.hstack([center - half, center + half]).astype(np.float32)
    boxes[rng.random(n) < 0.1] = [np.inf] * 3 + [-np.inf] * 3
    return boxes


def area(lo, hi):
    x, y, z = np.maximum(hi - lo, 0.0)
    return 2 * (x * y + y * z + z * x)


def slow_merge(boxes, limit, least=1):
    """The paper's steps 1 and 2, word for word; of fewer than `least` boxes no box is complete."""
    made, now = [], None
    for index, box in enumerate(boxes.astype(np.float64)):
        both = (
            box
            if now is None
            else np.concatenate([np.minimum(now[:3], box[:3]), np.maximum(now[3:], box[3:])])
        )
        few = index - (made[-1][-1] if made else 0) < least
        if now is None or few or area(both[:3], both[3:]) <= limit:
            now = both
        else:
            made.append((*now, index))
            now = box
    if now is not None:
        made.append((*now, len(boxes)))
    return made


def merged(boxes, limit, cuts, most=1 << 62, least=1):
    merger, parts = Merger(limit, most, least), []
    for a, b in itertools.pairwise([0, *cuts, len(boxes)]):
        out = np.empty(b - a, PARENT)
        parts.append(out[: merger.merge(boxes[a:b], out)])
    last = np.empty(1, PARENT)
    parts.append(last[: merger.finish(last)])
    return np.concatenate(parts).tolist()


@given(seed=st.integers(0, 2**32), n=st.integers(0, 200), data=st.data())
def test_merging_is_the_papers(seed, n, data):
    rng = np.random.default_rng(seed)
    boxes, limit = random_boxes(rng, n), 10.0 ** rng.uniform(-3, 3)
    cuts = sorted(data.draw(st.lists(st.integers(0, n), max_size=5)))
    assert merged(boxes, limit, cuts) == slow_merge(boxes, limit)
    least = data.draw(st.integers(1, 12))
    few = merged(boxes, limit, cuts, least=least)
    assert few == slow_merge(boxes, limit, least)
    assert len(few) <= -(-n // least)


def test_a_parent_has_no_more_children_than_may_be():
    boxes = random_boxes(np.random.default_rng(5), 100)
    parents = merged(boxes, np.inf, [30], most=40)
    assert [parent[-1] for parent in parents] == [40, 80, 100]


def steps_of(parents):
    """A 255th of their sides, no less, in float32."""
    exact = (parents[:, 3:].astype(np.float64) - parents[:, :3]) / 255
    step = exact.astype(np.float32)
    return np.where(step < exact, np.nextafter(step, np.float32(np.inf)), step)


def sides_of(parents, codes):
    """What codes stand for, in float32: box = parent's low sides + steps, high sides - steps."""
    codes, step = codes.astype(np.float32), steps_of(parents)
    with np.errstate(over="ignore", invalid="ignore"):
        return parents[:, :3] + codes[:, :3] * step, parents[:, 3:] - codes[:, 3:] * step


@given(
    seed=st.integers(0, 2**32),
    n=st.integers(1, 300),
    scale=st.sampled_from([1e-44, 1e-30, 1.0, 1e30, 3e38]),
    far=st.sampled_from([0.0, 1.0, 1e4, 1e7]),
)
def test_quantised_boxes_are_no_smaller_and_less_than_two_steps_larger(seed, n, scale, far):
    rng = np.random.default_rng(seed)
    center = rng.uniform(-0.4, 0.4, (n, 3)) + far
    center[:, rng.random(3) < 0.2] = far  # some parents are flat
    half = rng.uniform(0, 0.1, (n, 1)) * (center != far)
    with np.errstate(over="ignore"):
        boxes = (np.hstack([center - half, center + half]) * scale).astype(np.float32)
    boxes = np.clip(boxes, -3.4e38, 3.4e38)
    boxes[rng.random(n) < 0.1] = [np.inf] * 3 + [-np.inf] * 3
    ends = np.unique(np.append(rng.integers(1, n + 1, 3), n))
    parents = np.zeros(len(ends), PARENT)
    for parent, begin, end in zip(parents, [0, *ends[:-1]], ends, strict=True):
        lo, hi = boxes[begin:end, :3].min(axis=0), boxes[begin:end, 3:].max(axis=0)
        parent["lox"], parent["loy"], parent["loz"] = lo
        parent["hix"], parent["hiy"], parent["hiz"] = hi
        parent["end"] = end
    codes = np.empty((n, 6), np.uint8)
    quantise(boxes, parents, 0, codes)
    around = parents.view("<f4").reshape(-1, 8)[:, :6]
    around = np.repeat(around, np.diff(ends, prepend=0), axis=0)
    whole = boxes[:, 0] <= boxes[:, 3]
    around, boxes, codes = around[whole], boxes[whole], codes[whole]
    lo, hi = sides_of(around, codes)
    assert (lo <= boxes[:, :3]).all() and (hi >= boxes[:, 3:]).all()
    wide, step = boxes.astype(np.float64), steps_of(around).astype(np.float64)
    rounding = np.abs(np.spacing(boxes)).astype(np.float64)
    assert (wide[:, :3] - lo <= 2.0 * step + rounding[:, :3]).all()
    assert (hi - wide[:, 3:] <= 2.0 * step + rounding[:, 3:]).all()


@given(seed=st.integers(0, 2**32), n=st.integers(1, 3000))
def test_every_level_holds_the_one_below(tmp_path_factory, seed, n):
    rng = np.random.default_rng(seed)
    boxes = random_boxes(rng, n)
    settings = Hierarchy(
        s=rng.uniform(0.5, 6),
        n=int(rng.integers(1, 500)),
        l=int(rng.integers(1, 5)),
        t=rng.random(),
    )
    whole = boxes[boxes[:, 0] <= boxes[:, 3]].astype(np.float64)
    bounds = Bounds(whole[:, :3].min(axis=0, initial=0), whole[:, 3:].max(axis=0, initial=0))
    folder = tmp_path_factory.mktemp("levels")
    writer = HierarchyWriter(folder, settings, bounds.surface, durable=False)
    writer.complete([boxes], n)
    levels = writer.levels
    below = boxes
    for number, level in enumerate(levels, 1):
        records = np.fromfile(folder / f"level{number}", PARENT)
        assert len(records) == level.count
        ends = records["end"]
        assert ends[-1] == len(below) and (np.diff(ends, prepend=0) > 0).all()
        ratio, last = settings.threshold(len(below), number)
        assert last == (number == len(levels))
        assert records.tolist() == slow_merge(below, ratio * bounds.surface)
        numbers = records.view("<f4").reshape(-1, 8)
        below = np.ascontiguousarray(numbers[:, :6])
    assert len(levels) <= settings.l


def test_threshold_is_a_cube_of_s_voxels():
    settings = Hierarchy(s=3.0)
    ratio, last = settings.threshold(27_000_000, 1)
    assert ratio == pytest.approx((3 / 300) ** 2, rel=1e-12) and not last
    assert settings.threshold(1000, 1) == settings.threshold(10**9, 4) == (1.0, True)


def test_settings_of_the_paper():
    assert Hierarchy() == Hierarchy(s=3.0, n=1000, l=4, t=1.0, bits=8)
    for name in bfrt.spd.NAMES:
        expected = 0.5 if name in ("balls", "gears", "tree") else 1.0
        assert bfrt.spd.scene(name, 2).hierarchy == Hierarchy(t=expected)


def test_settings_as_text():
    assert parse_hierarchy("s=2, t=0.25") == Hierarchy(s=2.0, t=0.25)
    assert parse_hierarchy("bits=0") == Hierarchy(bits=0)
    assert parse_hierarchy("n=5,l=2", Hierarchy(t=0.5)) == Hierarchy(n=5, l=2, t=0.5)
    for text in ("", "s", "s=x", "q=1", "n=1.5", "s=1;t=2"):
        with pytest.raises(SettingError, match="expected settings such as s=3"):
            parse_hierarchy(text)


@pytest.mark.parametrize(
    "wrong", [{"s": 0}, {"s": np.nan}, {"n": 0}, {"l": 0}, {"l": 9}, {"t": -1}, {"bits": 7}]
)
def test_settings_out_of_range(wrong):
    with pytest.raises(SettingError, match="hierarchy: found"):
        Hierarchy(**wrong)


def test_the_store_keeps_settings_levels_and_time(tmp_path):
    settings = Hierarchy(s=2.0, n=10, l=3, t=0.5)
    store = bfrt.spd.rings(3).write(tmp_path / "a.bfrt", hierarchy=settings).store
    other = bfrt.spd.rings(3).write(tmp_path / "b.bfrt").store
    assert store.hierarchy == settings and store.hierarchy_seconds > 0
    assert store.checksum == other.checksum  # the scene is the same
    levels = {s.kind: s.levels for s in store.streams}
    assert len(levels[Kind.SPHERE]) > 1 and levels[Kind.POLYGON] == (1,)
    assert levels[Kind.SPHERE][0] < 420
    for stream in store.streams:
        assert set(stream.levels) and stream.path("level1").stat().st_size == 32 * stream.levels[0]
    converted = bfrt.convert("spd:rings:3", tmp_path / "c.bfrt", hierarchy=settings)
    assert converted.store.hierarchy == settings


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_boxes_of_spheres_are_worked_out_again(tmp_path, dtype):
    rng = np.random.default_rng(3)
    centers = rng.uniform(-1, 1, (500, 3)).astype(dtype)
    with StoreWriter(tmp_path / "a.bfrt", hierarchy=Hierarchy(n=1, s=1.0), order="given") as writer:
        writer.spheres(centers, np.full(500, 0.01, dtype))
    (stream,) = open_store(tmp_path / "a.bfrt").streams
    records = np.fromfile(stream.path("level1"), PARENT)
    moved = centers - np.array(open_store(tmp_path / "a.bfrt").origin)
    for begin, record in zip([0, *records["end"][:-1]], records, strict=True):
        part = moved[begin : record["end"]]
        lo = [record[name] for name in ("lox", "loy", "loz")]
        hi = [record[name] for name in ("hix", "hiy", "hiz")]
        np.testing.assert_allclose(lo, part.min(axis=0) - 0.01, atol=1e-6)
        np.testing.assert_allclose(hi, part.max(axis=0) + 0.01, atol=1e-6)


def test_a_first_level_as_the_objects_come_is_that_of_a_second_pass(tmp_path):
    rng = np.random.default_rng(4)
    for name in ("a", "b"):
        rng = np.random.default_rng(4)
        with StoreWriter(tmp_path / name, hierarchy=Hierarchy(n=10, s=2.0)) as writer:
            if name == "b":
                surface = open_store(tmp_path / "a").groups[0].grid_bounds.surface
                writer.expect({Kind.SPHERE: 900, Kind.TRIANGLE: 600}, surface)
            for _ in range(3):
                writer.spheres(rng.random((300, 3)), np.full(300, 0.01))
                writer.triangles(rng.random((200, 3, 3)))
    one, other = open_store(tmp_path / "a"), open_store(tmp_path / "b")
    assert one.checksum == other.checksum
    for mine, its in zip(one.streams, other.streams, strict=True):
        assert mine.levels == its.levels and len(mine.levels) > 1
        for number in range(1, len(mine.levels) + 1):
            level = f"level{number}"
            assert mine.path(level).read_bytes() == its.path(level).read_bytes()


@pytest.mark.parametrize("count", [2, 4])
def test_other_counts_than_were_announced_are_refused(tmp_path, count):
    with (
        pytest.raises(SceneError, match=f"sphere: found 3 objects, expected {count} as announced"),
        StoreWriter(tmp_path / "a") as writer,
    ):
        writer.expect({Kind.SPHERE: count}, 1.0)
        writer.spheres(np.zeros((3, 3)), 1.0)
    assert not list(tmp_path.iterdir())


def test_counts_are_announced_before_the_first_object(tmp_path):
    with (
        pytest.raises(SettingError, match="expected a call before the first"),
        StoreWriter(tmp_path / "a") as writer,
    ):
        writer.spheres(np.zeros((3, 3)), 1.0)
        writer.expect({Kind.SPHERE: 3}, 1.0)


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_the_surface_that_a_scene_expects_is_about_its_grids(name, tmp_path):
    scene = bfrt.spd.scene(name, bfrt.spd.DEFAULT_SIZES[name])
    grid = scene.write(tmp_path / "a.bfrt").store.groups[0].grid_bounds
    assert scene.surface == pytest.approx(grid.surface, rel=0.2)
