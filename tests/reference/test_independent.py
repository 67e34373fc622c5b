"""The oracle against cases worked out by hand, and against what must hold for any scene."""

from __future__ import annotations

import tracemalloc
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import EVERY_KIND, hard_scenes, joined, mapped, moved, random_objects, random_rays

from bfrt.errors import SceneError
from bfrt.records import INDEX_BITS, NO_HIT, Kind
from bfrt.reference.independent import Objects, agree, nearest, stable

UNIT_SPHERE = Objects(spheres=[[0, 0, 0, 1]])
CYLINDER = Objects(cones=[[0, 0, 0, 1, 0, 0, 2, 1]])  # along z, from 0 to 2
CONE = Objects(cones=[[0, 0, 0, 1, 0, 0, 2, 0]])  # its tip at (0, 0, 2)
TRIANGLE = Objects(triangles=[[0, 0, 0, 4, 0, 0, 0, 4, 0]])
PATCH = Objects(patches=[[0, 0, 0, 4, 0, 0, 0, 4, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1]])
SQUARE = Objects(vertices=[[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], counts=[4])
NOTCH = [[0, 0, 0], [4, 0, 0], [4, 4, 0], [2, 1, 0], [0, 4, 0]]  # open to the top, down to (2, 1)
NOTCHED = Objects(vertices=NOTCH, counts=[5])
STAR = [
    [0, 3, 0],
    [2, -3, 0],
    [-3, 1, 0],
    [3, 1, 0],
    [-2, -3, 0],
]  # a pentagram: wound twice inside

INF = np.inf
ROOT_HALF = np.sqrt(0.5)

BY_HAND = [
    ("sphere from outside", UNIT_SPHERE, (-3, 0, 0), (1, 0, 0), 2.0),
    ("sphere, unnormalised", UNIT_SPHERE, (-3, 0, 0), (0.5, 0, 0), 4.0),
    ("sphere off its centre", UNIT_SPHERE, (-3, 0.6, 0), (1, 0, 0), 2.2),
    ("sphere from inside", UNIT_SPHERE, (0.5, 0, 0), (1, 0, 0), 0.5),
    ("sphere from its centre", UNIT_SPHERE, (0, 0, 0), (0, 0, -2), 0.5),
    ("sphere behind", UNIT_SPHERE, (3, 0, 0), (1, 0, 0), INF),
    ("sphere missed", UNIT_SPHERE, (-3, 1.001, 0), (1, 0, 0), INF),
    ("sphere touched", UNIT_SPHERE, (-3, 1, 0), (1, 0, 0), 3.0),
    ("sphere of negative radius", Objects(spheres=[[0, 0, 0, -1]]), (-3, 0, 0), (1, 0, 0), 2.0),
    ("sphere of no radius", Objects(spheres=[[0, 0, 0, 0]]), (-3, 0, 0), (1, 0, 0), INF),
    ("tiny sphere far away", Objects(spheres=[[1e6, 0, 0, 0.25]]), (0, 0, 0), (1, 0, 0), 999999.75),
    ("cylinder from its side", CYLINDER, (-3, 0, 1), (1, 0, 0), 2.0),
    ("cylinder from inside", CYLINDER, (0, 0, 1), (0, 1, 0), 1.0),
    ("cylinder along its axis", CYLINDER, (0, 0, -1), (0, 0, 1), INF),
    ("cylinder along its axis inside", CYLINDER, (0.5, 0.25, -1), (0, 0, 1), INF),
    ("cylinder above its end", CYLINDER, (-3, 0, 2.001), (1, 0, 0), INF),
    ("cylinder in by the open end", CYLINDER, (0, 0, 3), (0.5, 0, -1), 2.0),
    ("cylinder in and out by the ends", CYLINDER, (0, 0, 4), (0.1, 0, -1), INF),
    ("cylinder touched", CYLINDER, (-3, 1, 1), (1, 0, 0), 3.0),
    ("cylinder missed", CYLINDER, (-3, 1.001, 1), (1, 0, 0), INF),
    ("cylinder of negative radius", Objects(cones=[[0, 0, 0, -1, 0, 0, 2, -1]]),
     (-3, 0, 1), (1, 0, 0), 2.0),
    ("cylinder askew", Objects(cones=[[0, 0, 0, 1, 4, 4, 0, 1]]),
     (2, 2, 5), (0, 0, -1), 4.0),
    ("cone from its side", CONE, (-3, 0, 1), (1, 0, 0), 2.5),
    ("cone from inside", CONE, (0, 0, 1), (1, 0, 0), 0.5),
    ("cone from below, on its axis: the tip", CONE, (0, 0, -1), (0, 0, 1), 3.0),
    ("cone at its tip from the side", CONE, (-1, 0, 2), (1, 0, 0), 1.0),
    ("cone's mirror image above the tip", CONE, (-3, 0, 3), (1, 0, 0), INF),
    ("cone parallel to its side, from inside", CONE, (-0.5, 0, 0), (-1, 0, 2), 0.25),
    ("cone parallel to its side, from below", CONE, (0.5, 0, -1), (-1, 0, 2), 1.0),
    ("cone parallel to its side, outside", CONE, (1.5, 0, 0), (-1, 0, 2), INF),
    ("cone upside down", Objects(cones=[[0, 0, 0, 0, 0, 0, 2, 1]]), (-3, 0, 0.5), (1, 0, 0), 2.75),
    ("cone of negative radius", Objects(cones=[[0, 0, 0, -1, 0, 0, 2, 0]]),
     (-3, 0, 1), (1, 0, 0), 2.5),
    ("cone of no length", Objects(cones=[[0, 0, 0, 1, 0, 0, 0, 2]]), (0, 0, 3), (0, 0, -1), INF),
    ("cone of no radius", Objects(cones=[[0, 0, 0, 0, 0, 0, 2, 0]]), (-3, 0, 1), (1, 0, 0), INF),
    ("truncated cone", Objects(cones=[[0, 0, 0, 2, 0, 0, 2, 1]]), (-3, 0, 1), (1, 0, 0), 1.5),
    ("triangle", TRIANGLE, (1, 1, 3), (0, 0, -1), 3.0),
    ("triangle from behind", TRIANGLE, (1, 1, -3), (0, 0, 2), 1.5),
    ("triangle askew", TRIANGLE, (0, 0, 1), (1, 1, -1), 1.0),
    ("triangle beside", TRIANGLE, (2.001, 2, 3), (0, 0, -1), INF),
    ("triangle in its plane", TRIANGLE, (-1, 1, 0), (1, 0, 0), INF),
    ("triangle behind", TRIANGLE, (1, 1, 3), (0, 0, 1), INF),
    ("triangle of no area", Objects(triangles=[[0, 0, 0, 1, 1, 1, 2, 2, 2]]),
     (1, 1, 3), (0, 0, -1), INF),
    ("patch", PATCH, (1, 1, 3), (0, 0, -1), 3.0),
    ("patch beside", PATCH, (2.001, 2, 3), (0, 0, -1), INF),
    ("square", SQUARE, (3, 3, 3), (0, 0, -1), 3.0),
    ("square from behind", SQUARE, (3, 3, -3), (0, 0, 1), 3.0),
    ("square beside", SQUARE, (4.001, 3, 3), (0, 0, -1), INF),
    ("square in its plane", SQUARE, (-1, 1, 0), (1, 0, 0), INF),
    ("notch", NOTCHED, (2, 2, 3), (0, 0, -1), INF),
    ("notch's left", NOTCHED, (0.5, 3, 3), (0, 0, -1), 3.0),
    ("notch's right", NOTCHED, (3.5, 3, 3), (0, 0, -1), 3.0),
    ("notch's bottom", NOTCHED, (2, 0.9, 3), (0, 0, -1), 3.0),
    ("star's ray", Objects(vertices=STAR, counts=[5]), (0, 2, 3), (0, 0, -1), 3.0),
    ("star's heart", Objects(vertices=STAR, counts=[5]), (0, 0, 3), (0, 0, -1), INF),
    ("polygon of no area", Objects(vertices=[[0, 0, 0], [1, 0, 0], [2, 0, 0]], counts=[3]),
     (1, 0, 3), (0, 0, -1), INF),
    ("polygon across two axes",
     Objects(vertices=[[1, 0, 0], [0, 1, 0], [0, 1, 2], [1, 0, 2]], counts=[4]),
     (0, 0, 1), (ROOT_HALF, ROOT_HALF, 0), ROOT_HALF),
]  # fmt: skip


@pytest.mark.parametrize(
    ("objects", "origin", "direction", "expected"),
    [case[1:] for case in BY_HAND],
    ids=[case[0] for case in BY_HAND],
)
def test_by_hand(objects, origin, direction, expected):
    t, ids = nearest(objects, [origin], [direction])
    assert t[0] == pytest.approx(expected, rel=1e-12)
    assert (ids[0] == NO_HIT) == np.isinf(expected)


def test_ids_are_kind_and_index():
    for kind, objects in zip(Kind, (UNIT_SPHERE, CONE, TRIANGLE, PATCH, SQUARE), strict=True):
        away = moved(objects, np.array([100.0, 0, 0]))
        _, ids = nearest(joined(away, objects), [[0.5, 0.5, 9]], [[0, 0, -1]])
        assert ids[0] == (kind << INDEX_BITS | 1)


def test_degenerate_objects_keep_their_index():
    line = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    objects = Objects(
        spheres=[[0, 0, 0, 0], [0, 0, 0, 1]],
        vertices=[*line, [0, 0, -2], [4, 0, -2], [4, 4, -2]],
        counts=[3, 3],
    )
    _, ids = nearest(objects, [[0, 0, 3], [3, 1, 3]], [[0, 0, -1], [0, 0, -1]])
    assert ids.tolist() == [Kind.SPHERE << INDEX_BITS | 1, Kind.POLYGON << INDEX_BITS | 1]


def test_the_lesser_id_wins_a_tie():
    _, ids = nearest(joined(SQUARE, PATCH, TRIANGLE, TRIANGLE), [[1, 1, 3]], [[0, 0, -1]])
    assert ids[0] == Kind.TRIANGLE << INDEX_BITS


def test_t_max_is_excluded():
    origins, directions = [[-3, 0, 0]] * 3, [[1, 0, 0]] * 3
    t, ids = nearest(UNIT_SPHERE, origins, directions, t_max=[2.0, np.nextafter(2.0, 3), 1.0])
    assert t.tolist() == [INF, 2.0, INF]
    assert ids.tolist() == [NO_HIT, 0, NO_HIT]


def test_a_hit_at_zero_is_none():
    t, _ = nearest(TRIANGLE, [[1, 1, 0]], [[0, 0, 1]])
    assert t[0] == INF


def test_rays_that_are_none_miss():
    origins = [[0, 0, 0], [np.nan, 0, 0], [0, 0, 0], [0, 0, 0]]
    directions = [[0, 0, 0], [1, 0, 0], [np.nan, 1, 0], [INF, 0, 0]]
    t, ids = nearest(
        joined(UNIT_SPHERE, moved(SQUARE, np.array([-2, -2, 5.0]))), origins, directions
    )
    assert np.isinf(t).all()
    assert (ids == np.uint64(NO_HIT)).all()


def test_lengths_from_the_least_to_the_largest():
    length = np.array([1e-300, 1e-200, 1e-3, 1.0, 1e200])
    t, _ = nearest(UNIT_SPHERE, np.tile([-3.0, 0, 0], (5, 1)), length[:, None] * [1, 0, 0])
    np.testing.assert_allclose(t * length, 2.0, rtol=1e-12)


def test_no_rays():
    t, ids = nearest(UNIT_SPHERE, np.empty((0, 3)), np.empty((0, 3)))
    assert t.shape == ids.shape == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spheres": [[0, 0, 0]]}, r"spheres: found shape \(1, 3\), expected \(n, 4\)"),
        ({"triangles": [[0] * 8 + [np.nan]]}, "triangles: row 0: .* expected finite"),
        ({"vertices": [[0, 0, 0]] * 4, "counts": [3]}, "vertices: found 4, expected the 3"),
        ({"vertices": [[0, 0, 0]] * 2, "counts": [2]}, "counts: found 2, expected 3"),
        ({"vertices": [[0, 0, 0]] * 3, "counts": [3.0]}, "counts: found float64"),
    ],
)
def test_what_is_no_scene_is_refused(arguments, message):
    with pytest.raises(SceneError, match=message):
        Objects(**arguments)


def test_bounds_of_each_kind():
    offset = np.array([1.0, 2, 3])
    expected = [
        (UNIT_SPHERE, (-1, -1, -1), (1, 1, 1)),
        (CYLINDER, (-1, -1, -1), (1, 1, 3)),  # as if its ends were spheres
        (TRIANGLE, (0, 0, 0), (4, 4, 0)),
        (PATCH, (0, 0, 0), (4, 4, 0)),
        (NOTCHED, (0, 0, 0), (4, 4, 0)),
        (Objects(), -offset, -offset),  # zeros, wherever it is moved
    ]
    for objects, low, high in expected:
        found = moved(objects, offset).bounds()
        assert found[0].tolist() == (low + offset).tolist()
        assert found[1].tolist() == (high + offset).tolist()


@pytest.mark.parametrize("block", [1, 7, 1 << 10, 1 << 20])
def test_the_block_changes_no_bit(block):
    rng = np.random.default_rng(5)
    objects = random_objects(rng, 60, spread=2.0)
    origins, directions = random_rays(rng, objects, 20)["random"]
    expected = nearest(objects, origins, directions)
    found = nearest(objects, origins, directions, block=block)
    assert np.isfinite(found[0]).any()
    np.testing.assert_array_equal(found, expected)


def test_memory_is_bounded_by_the_block():
    rng = np.random.default_rng(6)
    objects = random_objects(rng, 4000)
    origins, directions = random_rays(rng, objects, 500)["random"]
    tracemalloc.start()
    try:
        nearest(objects, origins, directions)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8e6  # one number for every pair is 16 MB


# --- what holds for any scene ------------------------------------------------------------------


seeds = st.integers(0, 2**32 - 1)
kinds = st.sampled_from(EVERY_KIND)
few = settings(max_examples=25, deadline=None)


def scene_and_rays(seed, kind=None, n=40):
    """A dense scene, with rays of all sorts; only those that are stable."""
    rng = np.random.default_rng(seed)
    objects = random_objects(rng, 30, EVERY_KIND if kind is None else [kind], spread=1.0, size=1.0)
    rays = random_rays(rng, objects, n).values()
    origins, directions = (np.concatenate(some) for some in zip(*rays, strict=True))
    t, ids = nearest(objects, origins, directions)
    kept = stable(objects, origins, directions, t, ids)
    assert kept.mean() > 0.5
    return objects, origins[kept], directions[kept], t[kept], ids[kept]


def distance(objects, kind, index, point):
    """How far a point is from the surface of an object, as by the surface's definition."""
    if kind == Kind.SPHERE:
        *centre, radius = objects.spheres[index]
        return abs(np.linalg.norm(point - centre) - abs(radius))
    if kind == Kind.CONE:
        return distance_to_cone(objects.cones[index], point)
    if kind == Kind.POLYGON:
        end = objects.counts[: index + 1].sum()
        corners = objects.vertices[end - objects.counts[index] : end]
        return distance_to_fan(corners, point)
    table = objects.triangles if kind == Kind.TRIANGLE else objects.patches[:, :9]
    return distance_to_fan(table[index].reshape(3, 3), point)


def distance_to_cone(cone, point):
    """In the half-plane through the axis and the point, where the surface is a segment."""
    base, axis = cone[:3], cone[4:7] - cone[:3]
    length = np.linalg.norm(axis)
    along = (point - base) @ axis / length
    across = np.linalg.norm(np.cross(point - base, axis)) / length
    start, end = np.array([0, abs(cone[3])]), np.array([length, abs(cone[7])])
    s = np.clip(
        (np.array([along, across]) - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1
    )
    return np.linalg.norm(start + s * (end - start) - [along, across])


def distance_to_fan(corners, point):
    """Areas: seen from a point inside, the triangles over the edges add up to the whole.

    For a star around its mean the fan of triangles there covers it, and one of them holds the
    point. The distance is how much larger the three areas over that triangle are, over its size.
    """
    middle = corners.mean(axis=0)
    excess = [
        sum(area(a, b, point) for a, b in ((p, q), (q, middle), (middle, p))) - area(p, q, middle)
        for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return min(excess) / np.ptp(corners, axis=0).max()


def area(a, b, c):
    return np.linalg.norm(np.cross(b - a, c - a)) / 2


@few
@given(seeds, kinds)
def test_hits_lie_on_their_surface(seed, kind):
    rng = np.random.default_rng(seed)
    objects = random_objects(rng, 10, [kind], spread=1.0, size=1.0)
    rays = random_rays(rng, objects, 20)
    del rays["from far away"]  # rounded by more than is allowed here
    origins, directions = (np.concatenate(some) for some in zip(*rays.values(), strict=True))
    t, ids = nearest(objects, origins, directions)
    hit = np.isfinite(t) & stable(objects, origins, directions, t, ids)
    assert hit.any()
    assert (ids[hit] >> np.uint64(INDEX_BITS) == kind).all()
    points = origins[hit] + t[hit, None] * directions[hit]
    index = (ids[hit] & np.uint64((1 << INDEX_BITS) - 1)).astype(int)
    far = [distance(objects, kind, i, point) for i, point in zip(index, points, strict=True)]
    assert max(far) < 1e-7


@few
@given(seeds, st.sampled_from([1e-3, 0.3, 7.0, 1e3]))
def test_a_longer_direction_makes_a_shorter_t(seed, scale):
    objects, origins, directions, t, ids = scene_and_rays(seed)
    found, name = nearest(objects, origins, directions * scale)
    np.testing.assert_allclose(found * scale, t, rtol=1e-9)
    np.testing.assert_array_equal(name, ids)


@few
@given(seeds, st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_moved_scene_has_the_same_hits(seed, offset):
    objects, origins, directions, t, ids = scene_and_rays(seed)
    found, name = nearest(moved(objects, np.array(offset)), origins + offset, directions)
    np.testing.assert_allclose(found, t, rtol=1e-9)
    np.testing.assert_array_equal(name, ids)


@few
@given(seeds, st.sampled_from(list(permutations(range(3)))))
def test_a_turned_scene_has_the_same_hits(seed, axes):
    objects, origins, directions, t, ids = scene_and_rays(seed)
    turned = mapped(objects, axes)
    found, name = nearest(turned, origins[:, axes], directions[:, axes])
    np.testing.assert_allclose(found, t, rtol=1e-9)
    np.testing.assert_array_equal(name, ids)


@few
@given(seeds)
def test_a_moved_scene_agrees_where_stable(seed):
    """The same, but by `stable` and `agree`, in scenes that are hard."""
    rng = np.random.default_rng(seed)
    scenes = hard_scenes(rng)
    name = sorted(scenes)[seed % len(scenes)]
    objects = scenes[name]
    rays = random_rays(rng, objects, 5).values()
    origins, directions = (np.concatenate(some) for some in zip(*rays, strict=True))
    low, high = objects.bounds()
    offset = (high - low) * [0.3, -0.7, 0.1]
    first = nearest(objects, origins, directions)
    again = nearest(moved(objects, offset), origins + offset, directions)
    report = agree(*first, *again, stable(objects, origins, directions, *first))
    assert report.compared > 0.2 * len(origins)
    assert report.wrong == 0
    assert report.tied == 0 or name == "flat"  # where triangles overlap in one plane


# --- stable and agree --------------------------------------------------------------------------


def is_stable(objects, origin, direction, t_max=INF):
    t, ids = nearest(objects, [origin], [direction], t_max)
    return bool(stable(objects, [origin], [direction], t, ids, t_max)[0])


def test_stable():
    assert is_stable(UNIT_SPHERE, (-3, 0.5, 0), (1, 0, 0))
    assert is_stable(UNIT_SPHERE, (-3, 2, 0), (1, 0, 0))
    assert is_stable(UNIT_SPHERE, (-3, 0, 0), (1, 0, 0), t_max=2.1)
    assert is_stable(SQUARE, (1, 1, 1), (0, 0, -1e-3))
    assert is_stable(SQUARE, (1, 1, 1e8), (0, 0, -1))
    assert is_stable(Objects(), (0, 0, 0), (1, 0, 0))


@pytest.mark.parametrize(
    ("objects", "origin", "direction", "t_max"),
    [
        (UNIT_SPHERE, (-3, 1, 0), (1, 0, 0), INF),  # a tangent
        (UNIT_SPHERE, (-3, 0, 0), (1, 0, 0), 2.0),  # ends on the surface
        (UNIT_SPHERE, (1, 0, 0), (-1, 0, 0), INF),  # begins on the surface
        (SQUARE, (4, 1, 1), (0, 0, -1), INF),  # at an edge
        (SQUARE, (4, 4, 1), (0, 0, -1), INF),  # at a corner
        (SQUARE, (-1, 1, 0), (1, 0, 0), INF),  # in the plane
        (joined(TRIANGLE, PATCH), (2, 2, 1), (0, 0, -1), INF),  # at an edge of both
        (CYLINDER, (-3, 0, 2), (1, 0, 0), INF),  # at the rim
        (CYLINDER, (1, 0, -1), (0, 0, 1), INF),  # along the side
        (CONE, (1, 0, 0), (-1, 0, 2), INF),  # the same
        (CONE, (-1, 0, 2), (1, 0, 0), INF),  # at the tip
    ],
)
def test_unstable(objects, origin, direction, t_max):
    assert not is_stable(objects, origin, direction, t_max)


def test_agree_counts():
    none = NO_HIT
    cases = [  # t, id, t2, id2, stable
        (1.0, 5, 1.0, 5, True),
        (1.0, 5, 1.0 + 1e-10, 5, True),
        (INF, none, INF, none, True),
        (1.0, 5, 1.0, 6, True),  # a tie
        (1.0, 5, 1.0 + 1e-8, 5, True),  # wrong from here
        (1.0, 5, INF, none, True),
        (INF, none, 1.0, 5, True),
        (1.0, 5, 1.0, none, True),
        (INF, none, INF, 5, True),
        (1.0, 5, np.nan, 5, True),
        (1.0, 5, 2.0, 6, False),  # unstable
    ]
    types = (np.float64, np.uint64, np.float64, np.uint64, np.bool_)
    report = agree(*map(np.array, zip(*cases, strict=True), types))
    assert (report.compared, report.unstable, report.tied, report.wrong) == (10, 1, 1, 6)
    assert report.rows.tolist() == [4, 5, 6, 7, 8, 9]
