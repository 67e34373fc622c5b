"""How much is open: against formulas, in every way to trace, and beyond memory."""

from __future__ import annotations

import sys

import fast
import numpy as np
import pytest
from capped import memory_cap
from failing import refuse_reads
from injected import dividing, holding
from memory_cap import run_in
from scenes import hard_scenes, units

import bfrt
from bfrt.errors import SettingError
from bfrt.queries import answers
from bfrt.queries import points as points_room
from bfrt.scene import Scene

WAYS = {"base": "given", "sgb": "given", "sg": "given", "tree": "spatial"}
UP = (0.0, 0.0, 1.0)
MANY = 2000


@pytest.fixture(params=["given", "spatial"])
def ball(request, tmp_path):
    """A sphere of radius 1, its middle 2 above the origin, and a plane of two triangles."""
    big = 1e4
    with bfrt.SceneWriter(tmp_path / "b.bfrt", order=request.param) as writer:
        writer.spheres([[0.0, 0, 2]], [1.0])
        writer.mesh([[-big, -big, 0], [big, -big, 0], [big, big, 0], [-big, big, 0]],
                    [[0, 1, 2], [0, 2, 3]])  # fmt: skip
    with bfrt.open(tmp_path / "b.bfrt") as scene:
        yield scene


def seen(scene, point, normal=None, **settings):
    """The mean of many points in one place, each of which has its own rays."""
    points = np.broadcast_to(point, (MANY, 3))
    return scene.visibility(points, normal, **settings)["visibility"].astype(float).mean()


@pytest.mark.parametrize("height", [0.0, 0.3, 0.9])
def test_a_sphere_above_a_plane(ball, height):
    """A cap of the sky: of half-angle asin(1 / d) around the normal."""
    sine2 = 1.0 / (2.0 - height) ** 2
    cap = 1.0 - np.sqrt(1.0 - sine2)
    point = (0.0, 0.0, height)
    assert seen(ball, point, UP) == pytest.approx(1.0 - cap, abs=2e-3)
    assert seen(ball, point, UP, cosine=True) == pytest.approx(1.0 - sine2, abs=2e-3)
    if height:
        assert seen(ball, point) == pytest.approx(0.5 - cap / 2, abs=2e-3)
    assert seen(ball, point, UP, distance=0.99 - height) == 1.0


def test_a_sphere_aside(ball):
    """With the cosine of its direction, as light from there counts (the form factor)."""
    point = np.array([3.0, 0.0, 0.0])
    way = np.array([0.0, 0, 2]) - point
    far = np.linalg.norm(way)
    expected = 1.0 - (way[2] / far) / far**2  # the whole sphere is above the horizon
    assert seen(ball, point, UP, cosine=True) == pytest.approx(expected, abs=2e-3)
    assert seen(ball, point, UP) == pytest.approx(np.sqrt(1 - 1 / far**2), abs=2e-3)


def test_under_the_plane_and_on_the_other_side(ball):
    assert seen(ball, (5.0, 5.0, 0.0), (0, 0, -7.5)) == 1.0
    assert seen(ball, (0.0, 0.0, 2.0), UP) == 0.0  # in the ball
    assert seen(ball, (0.0, 0.0, 2.0)) == 0.0
    assert seen(ball, (0.0, 0.0, 2.0), distance=0.9) == 1.0


@pytest.mark.parametrize(("walls", "uniform"), [(1, 0.5), (2, 0.25)])
def test_a_corner(tmp_path, walls, uniform):
    """A floor and walls at right angles to it, 1e-4 away from the point."""
    big, near = 1e3, 1e-4
    floor = [[-big, -big, 0], [big, -big, 0], [big, big, 0], [-big, big, 0]]
    one = [[-near, -big, -big], [-near, big, -big], [-near, big, big], [-near, -big, big]]
    two = [[-big, -near, -big], [big, -near, -big], [big, -near, big], [-big, -near, big]]
    with bfrt.SceneWriter(tmp_path / "c.bfrt") as writer:
        for face in [floor, one, two][: 1 + walls]:
            writer.mesh(face, [[0, 1, 2], [0, 2, 3]])
    with bfrt.open(tmp_path / "c.bfrt") as scene:
        for cosine in (False, True):  # by symmetry both are the same
            found = seen(scene, (0.0, 0, 0), UP, cosine=cosine)
            assert found == pytest.approx(uniform, abs=2e-3)


def test_open_sky(tmp_path):
    with bfrt.SceneWriter(tmp_path / "none.bfrt"):
        pass
    points = np.zeros((3, 4, 3))
    found = bfrt.visibility(tmp_path / "none.bfrt", points, UP, rays=7)["visibility"]
    assert found.dtype == np.float32 and found.shape == (3, 4) and (found == 1.0).all()


def test_one_point_is_near_the_truth(ball):
    """Low discrepancy: far nearer than as many rays by chance."""
    found = ball.visibility(np.zeros((500, 3)), UP, rays=256)["visibility"].astype(float)
    truth = np.sqrt(0.75)
    assert np.abs(found - truth).max() < 0.02
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.4 * np.sqrt(truth * (1 - truth) / 256)
    assert len(np.unique(found)) > 1


@pytest.mark.parametrize("spread", ["uniform", "cosine", "sphere"])
def test_directions_are_spread(tmp_path, monkeypatch, spread):
    """Unit, all on the normal's side, with the mean and the moments of their density."""
    taken = []
    fill = points_room.RowPerPoint.rays

    def rays(self, *given):
        made = fill(self, *given)
        return made._replace(blocks=iter(taken.append(block) or block for block in made.blocks))

    monkeypatch.setattr(points_room.RowPerPoint, "rays", rays)
    with bfrt.SceneWriter(tmp_path / "none.bfrt"):
        pass
    rng = np.random.default_rng(3)
    normals = units(rng, 300)
    normals[:6] = [*np.eye(3), *-np.eye(3)]
    bfrt.visibility(
        tmp_path / "none.bfrt", np.zeros((300, 3)), None if spread == "sphere" else normals * 3.0,
        rays=50, cosine=spread == "cosine",
    )  # fmt: skip
    d = np.concatenate([block[1] for block in taken]).reshape(300, 50, 3)
    np.testing.assert_allclose(np.linalg.norm(d, axis=2), 1.0, atol=1e-14)
    up = (d * normals[:, None]).sum(axis=2)
    if spread == "sphere":
        assert np.abs(d.reshape(-1, 3).mean(axis=0)).max() < 0.01
        np.testing.assert_allclose(np.mean(d.reshape(-1, 3) ** 2, axis=0), 1 / 3, atol=0.01)
        return
    assert (up > 0).all()
    expected = {"uniform": 0.5, "cosine": 2 / 3}[spread]
    np.testing.assert_allclose(up.mean(axis=1), expected, atol=0.011)
    beside = d - up[..., None] * normals[:, None]
    assert np.abs(beside.mean(axis=1)).max() < 0.12


def awkward(rng, n=60):
    """A scene of all kinds, and points on and beside it."""
    objects = hard_scenes(rng)["overlapping"]
    points, normals = rng.uniform(-1.3, 1.3, (n, 3)), units(rng, n)
    points[7], normals[8], normals[9], points[10, 0] = np.nan, 0.0, np.inf, -np.inf
    return objects, points, normals


@pytest.mark.parametrize("rays", [1, 3, 64])
@pytest.mark.parametrize("around", [True, False])
def test_the_same_bits_in_every_way(tmp_path, monkeypatch, rays, around):
    monkeypatch.setattr(answers, "ROWS", 23)
    objects, points, normals = awkward(np.random.default_rng(rays))
    normals = normals if around else None
    for order in set(WAYS.values()):
        fast.write(objects, tmp_path / f"{order}.bfrt", order=order)
    ask = {"rays": rays, "distance": 0.2, "cosine": around}
    expected = bfrt.visibility(tmp_path / "given.bfrt", points, normals, **ask)
    truth = expected["visibility"]
    bad = [7, 8, 9, 10] if around else [7, 10]
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(truth)), bad)
    assert expected.stats.bad_rays == rays * len(bad)
    assert ((truth >= 0) & (truth <= 1)).sum() == len(points) - len(bad)
    assert 0.0 < np.nanmean(truth) < 1.0
    for way, order in WAYS.items():
        with bfrt.open(tmp_path / f"{order}.bfrt") as scene:
            out = {"out": tmp_path / "out", "checkpoint": tmp_path / "kept", "every": 0}
            for settings in ({}, {"threads": 1, "memory": "110MiB"}, {"threads": 3}, out):
                found = scene.visibility(points, normals, **ask, refine=way, **settings)
                np.testing.assert_array_equal(found["visibility"], truth)
                assert found.stats.bad_rays == expected.stats.bad_rays
            poor = scene if order == "given" else dividing(scene, not_resident)
            poor = holding(Scene(scene.store), fast.TIGHT) if order == "given" else poor
            monkeypatch.setattr(points_room, "RAYS_AT_ONCE", 100)
            found = poor.visibility(points, normals, **ask, refine=way)
            monkeypatch.undo()
            monkeypatch.setattr(answers, "ROWS", 23)
            np.testing.assert_array_equal(found["visibility"], truth)


def not_resident(held):
    from dataclasses import replace

    return replace(held, resident=False, rays=61, candidates=150, queue=11)


def test_points_of_every_form(ball, tmp_path):
    rng = np.random.default_rng(5)
    points = rng.uniform(-2, 2, (6, 7, 3)).astype(np.float32)
    normals = units(rng, 42).reshape(6, 7, 3)
    expected = ball.visibility(points.reshape(-1, 3), normals.reshape(-1, 3))["visibility"]
    np.save(tmp_path / "p.npy", points)
    np.save(tmp_path / "n.npy", normals)
    filled = {"visibility": np.zeros((7, 6), "f4").T}
    for found in (
        ball.visibility(points, normals),
        ball.visibility(np.asfortranarray(points), normals.tolist()),
        ball.visibility(points.astype(">f8"), normals, out=filled),
        ball.visibility(tmp_path / "p.npy", normals, out=tmp_path / "out"),
        ball.visibility(np.load(tmp_path / "p.npy", mmap_mode="r"), str(tmp_path / "n.npy")),
        bfrt.visibility(ball.path, points, normals, memory="120MiB"),
    ):
        np.testing.assert_array_equal(found["visibility"].ravel(), expected)
        assert found["visibility"].shape == (6, 7)
    one = ball.visibility(points[0, 0], normals[0, 0])["visibility"]
    assert one.shape == () and one == expected[0]
    assert ball.visibility(np.zeros((0, 3)), UP)["visibility"].shape == (0,)


def test_rays_begin_off_the_surface(tmp_path):
    """Of hits on a sphere far from the origin of coordinates nothing hides the outside."""
    middle = np.array([5e5, 4.5e6, 120.0])
    with bfrt.SceneWriter(tmp_path / "s.bfrt") as writer:
        writer.spheres([middle], [2.5])
    with bfrt.open(tmp_path / "s.bfrt") as scene:
        d = units(np.random.default_rng(6), 2000)
        hits = scene.cast_rays(middle + 9 * d, -d, outputs=["positions"])
        places, n = hits["positions"], hits["primitive_normals"]
        assert (scene.visibility(places, n, rays=16)["visibility"] == 1.0).all()
        assert (scene.visibility(places, n, rays=16, cosine=True)["visibility"] == 1.0).all()
        assert (scene.visibility(places, -n, rays=16)["visibility"] == 0.0).all()


@pytest.mark.parametrize(
    ("arguments", "settings", "what"),
    [
        ((np.zeros((2, 2)),), {}, r"points: found float64 of shape \(2, 2\), expected float32"),
        ((np.zeros((2, 3)), np.ones((3, 3))), {}, r"normals: found shape \(3, 3\), expected"),
        ((np.zeros(3), np.ones((3, 3))), {}, r"normals: found shape \(3, 3\), expected \(3,\)"),
        ((np.zeros((2, 3)),), {"rays": 0}, "rays: found 0, expected a whole number"),
        ((np.zeros((2, 3)),), {"rays": 65537}, "rays: found more than 65536, expected"),
        ((np.zeros((2, 3)),), {"rays": 1.5}, r"rays: found 1\.5, expected a whole number"),
        ((np.zeros((2, 3)),), {"distance": 0.0}, "distance: found 0.0, expected a number above 0"),
        ((np.zeros((2, 3)),), {"distance": np.nan}, "distance: found nan, expected a number"),
        ((np.zeros((2, 3)),), {"distance": True}, "distance: found True, expected a number"),
        ((np.zeros((2, 3)),), {"distance": np.complex128(1)}, "distance: found .*, expected a num"),
        ((np.zeros((2, 3)),), {"distance": "far"}, "distance: found 'far', expected a number"),
        ((np.zeros((2, 3)),), {"cosine": True}, "cosine: found True without normals"),
        (("no.npy",), {}, "no.npy: expected an .npy file of points"),
        ((np.zeros((2, 3)),), {"out": {"open": 1}}, "out: found 'open', expected some of visib"),
        ((np.zeros((2, 3)),), {"checkpoint": "x"}, "checkpoint: found no folder for the answer"),
        ((np.ma.masked_equal(np.eye(3), 1.0),), {}, "points: found masked elements"),
    ],
)
def test_refused(ball, arguments, settings, what):
    with pytest.raises(SettingError, match=what):
        ball.visibility(*arguments, **settings)


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e-170, 1e170, 1e308])
def test_normals_of_any_length(ball, size):
    """Of powers of two that overflow, or are lost, in their squares."""
    normals = np.array([UP, (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
    points = np.tile((0.0, 0.0, 0.5), (3, 1))
    expected = ball.visibility(points, normals, rays=500)["visibility"]
    assert (expected < 1.0).all()
    found = ball.visibility(points, size * normals, rays=500)
    np.testing.assert_array_equal(found["visibility"], expected)
    assert found.stats.bad_rays == 0


def test_a_distance_beyond_all_numbers(ball):
    points = np.tile((0.0, 0.0, 0.5), (3, 1))
    expected = ball.visibility(points)["visibility"]
    np.testing.assert_array_equal(ball.visibility(points, distance=10**400)["visibility"], expected)


def test_cancelled(ball):
    with pytest.raises(bfrt.Cancelled):
        ball.visibility(np.zeros((5, 3)), progress=lambda _: False)


def test_a_read_that_is_refused(ball, tmp_path, monkeypatch):
    path, out = tmp_path / "p.npy", tmp_path / "out"
    np.save(path, np.ones((200, 3)))
    monkeypatch.setattr(points_room, "RAYS_AT_ONCE", 1000)

    def check():
        assert not out.exists()

    ask = lambda: ball.visibility(path, UP, out=out)  # noqa: E731
    assert refuse_reads(monkeypatch, path, ask, check) > 5


BEYOND = """
import sys
import numpy as np
import bfrt

points = np.lib.format.open_memmap(sys.argv[2], "r")
scene = bfrt.open(sys.argv[1])
answer = scene.visibility(points, (0, 0, 1.0), rays=16, memory="96MiB", out=sys.argv[3])
print(answer.stats.peak_rss_bytes)
"""


def test_more_points_than_memory_holds(tmp_path):
    """Six million rays, 600 MB of records, inside a cgroup as large as the budget."""
    store = bfrt.spd.rings(5).write(tmp_path / "r.bfrt")
    points = np.random.default_rng(2).uniform(-1, 1, (400_000, 3))
    np.save(tmp_path / "p.npy", points)
    with memory_cap(96 << 20) as group:
        if group is None:
            pytest.skip("no memory cgroup can be made here")
        paths = [str(store.path), str(tmp_path / "p.npy"), str(tmp_path / "out")]
        done = run_in(group, [sys.executable, "-c", BEYOND, *paths], tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 96 << 20
    found = np.load(tmp_path / "out" / "visibility.npy")
    assert found.shape == (400_000,)
    some = store.visibility(points[:5000], UP, rays=16)["visibility"]
    np.testing.assert_array_equal(found[:5000], some)
