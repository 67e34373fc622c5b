"""Scenes of any size, anywhere: each is refused when it is made, or traced as by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

import bfrt
from bfrt.errors import SceneError
from bfrt.records import INDEX_BITS, NO_HIT
from bfrt.reference.exhaustive import nearest
from bfrt.store.extent import SMALLEST

MOST = float(np.finfo(np.float32).max)

#: Powers of ten of a scene's size and of where it is, and the axes on which it has no extent.
POWERS = st.floats(-45, 38.3)
FLAT = st.sampled_from([(), (0,), (2,), (0, 1)])


def spread(rng, n, size, place, flat):
    """Points (n, 3) in a cube, as flat as asked for."""
    points = rng.uniform(-1, 1, (n, 3))
    points[:, list(flat)] = 0
    return points * size + place


def fill(writer, rng, size, place, flat, dtype):
    """Some objects of each kind."""

    def as_asked(array):
        return np.clip(array, -MOST / 2, MOST / 2).astype(dtype)

    def points(n):
        return spread(rng, n, size, place, flat)

    centers, radii = points(12), rng.uniform(0.02, 0.3, 12) * size
    corners = points(12)[:, None] + spread(rng, 36, size / 3, 0, flat).reshape(12, 3, 3)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * size / 2
    writer.spheres(as_asked(centers), as_asked(radii))
    writer.cones(as_asked(centers), as_asked(radii), as_asked(points(12)), as_asked(radii / 2))
    writer.triangles(as_asked(corners))
    writer.polygons(as_asked((points(6)[:, None] + square).reshape(-1, 3)), np.full(6, 4))


@pytest.mark.filterwarnings("ignore")
@given(
    size=POWERS, place=st.one_of(st.none(), POWERS), flat=FLAT, seed=st.integers(0, 999),
    dtype=st.sampled_from([np.float32, np.float64]), own_origin=st.booleans(),
)  # fmt: skip
@example(size=38.2, place=None, flat=(), seed=0, dtype=np.float32, own_origin=True)
@example(size=-45, place=None, flat=(), seed=0, dtype=np.float32, own_origin=True)
@example(size=-45, place=-30.0, flat=(2,), seed=0, dtype=np.float64, own_origin=False)
@example(size=0, place=14.4, flat=(2,), seed=0, dtype=np.float64, own_origin=False)
@example(size=18, place=30.0, flat=(0, 1), seed=0, dtype=np.float32, own_origin=True)
@examples(60)
def test_any_scene_is_refused_or_traced(
    tmp_path_factory, size, place, flat, seed, dtype, own_origin
):
    path = tmp_path_factory.mktemp("extents") / "a.bfrt"
    rng = np.random.default_rng(seed)
    size, place = 10.0**size, 0.0 if place is None else 10.0**place
    origin = None if own_origin else (0, 0, 0)
    try:
        with np.errstate(all="ignore"), bfrt.SceneWriter(path, origin=origin) as writer:
            fill(writer, rng, size, place, flat, dtype)
    except SceneError as error:
        assert ("too large for float32 boxes" in str(error)) or "found all objects" in str(error)
        assert not path.exists()
        return
    scene = bfrt.open(path)
    ends = spread(rng, 120, size, np.add(place, 0), ())
    starts = spread(rng, 120, size * 3, place, ())
    hits = bfrt.cast_rays(scene, starts, ends - starts, memory="128MiB", threads=1)
    t, ids = nearest(scene.store, starts - scene.origin, ends - starts)
    missed = hits["geometry_ids"] < 0
    found = hits["geometry_ids"].astype(np.uint64) << np.uint64(INDEX_BITS)
    found |= hits["primitive_ids"].astype(np.uint64)
    np.testing.assert_array_equal(hits["t_hit"], t)
    np.testing.assert_array_equal(np.where(missed, np.uint64(NO_HIT), found), ids)
    assert np.isfinite(hits["primitive_normals"]).all()
    if scene.bounds.diagonal:
        view = scene.framing_camera(resolution=(6, 4))
        assert bfrt.render(scene, camera=view, memory="128MiB", threads=1).shape == (4, 6)


def wall(far, axis):
    """A square of two triangles, at right angles to an axis."""
    corners = np.array([[0, 0, far], [4, 0, far], [0, 4, far], [4, 4, far]])
    return np.roll(corners[[[0, 1, 2], [3, 2, 1]]], axis, axis=-1)


@pytest.mark.parametrize("power", [10, 17, 22, 24, 30, 40, 46])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_wall_far_from_the_origin_is_hit(tmp_path, power, axis):
    """Its box fits it tightly, and what hits are off by grows with the distance."""
    far = 2.0**power
    with bfrt.SceneWriter(tmp_path / "a.bfrt", origin=(0, 0, 0)) as writer:
        writer.triangles(wall(far, axis))
    rng = np.random.default_rng(power)
    ends = np.column_stack([rng.uniform(0.1, 3.9, (300, 2)), np.full(300, far)])
    ways = np.column_stack([rng.normal(size=(300, 2)), rng.choice([-1, 1], 300)])
    starts = ends - ways * 2.0**10  # whose last number float64 has, there too
    starts, ways = (np.roll(rows, axis, axis=1) for rows in (starts, ways))
    hits = bfrt.cast_rays(tmp_path / "a.bfrt", starts, ways, memory="128MiB")
    assert np.isfinite(hits["t_hit"]).all()


def refusal(writer):
    """What is said of a scene that is too small; nothing is left of it."""
    with pytest.raises(SceneError) as caught:
        writer.close()
    assert list(writer.path.parent.iterdir()) == []
    return str(caught.value)


def test_a_wall_too_far_from_the_stores_origin_is_refused(tmp_path):
    writer = bfrt.SceneWriter(tmp_path / "a.bfrt", origin=(0, 0, 0))
    writer.triangles(wall(2.0**51, 0))
    assert refusal(writer) == (
        "scene: found all objects within 5.66 at 2 2 2.2518e+15, expected 8 or more across so far "
        "from the origin, where coordinates are rounded"
    )


def test_scenes_too_small_for_where_they_are_in_the_world(tmp_path):
    place = 2.0**100
    for radius in (SMALLEST * place / 4, SMALLEST * place):
        writer = bfrt.SceneWriter(tmp_path / "a.bfrt")
        writer.spheres(np.array([[place, 0.0, 0.0]]), [radius])
        if radius < SMALLEST * place:
            said = "at 1.26765e+30 0 0, expected 4.5e+15 or more across so far from the origin"
            assert said in refusal(writer)
        else:
            assert writer.close().objects == 1


def test_a_scan_with_a_broken_scale_is_refused_by_its_name(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.full((3, 3), 2e37))
    with pytest.raises(SceneError) as caught:
        bfrt.convert(path, tmp_path / "a.bfrt", radius=0.1)
    assert str(caught.value).startswith(f"{path}: scene: found all objects within 0.346 at 2e+37")
    assert list(tmp_path.iterdir()) == [path]
