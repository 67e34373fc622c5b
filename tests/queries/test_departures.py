"""Where hits are, and where rays begin that leave them: off the surface, and not beyond others."""

from __future__ import annotations

import fast
import numpy as np
import pytest
from scenes import hard_scenes, random_objects, random_rays, units

import bfrt
from bfrt.errors import SettingError
from bfrt.records import Kind
from bfrt.reference.independent import Objects

BOTH = ("positions", "next_origins")
SIDES = ("incoming", "opposite", "front", "back")
NAMES = sorted(hard_scenes(np.random.default_rng(0)))
WAYS = {"base": "given", "sgb": "given", "tree": "spatial"}


@pytest.mark.parametrize("name", NAMES)
def test_the_same_bits_in_every_way(tmp_path, name):
    rng = np.random.default_rng(NAMES.index(name))
    objects = hard_scenes(rng)[name]
    rays = [
        np.concatenate(part) for part in zip(*random_rays(rng, objects, 20).values(), strict=True)
    ]
    found = {}
    for way, order in WAYS.items():
        path = tmp_path / f"{order}.bfrt"
        if not path.exists():
            fast.write(objects, path, order=order)
        for settings in ({}, {"memory": "100MiB", "threads": 1}, {"checkpoint": tmp_path / "kept"}):
            if settings.get("checkpoint"):
                settings["out"] = tmp_path / "out"
            with bfrt.open(path) as scene:
                found[way, len(settings)] = scene.cast_rays(
                    *rays, outputs=BOTH, side="opposite", refine=way, **settings
                )
    first, *others = found.values()
    missed = np.isinf(first["t_hit"])
    for key in BOTH:
        assert first[key].dtype == np.float64 and np.isinf(first[key][missed]).all()
        assert np.isfinite(first[key][~missed]).all()
        for other in others:
            np.testing.assert_array_equal(other[key], first[key])
    plain = bfrt.cast_rays(tmp_path / "given.bfrt", *rays)
    assert not set(BOTH) & plain.keys()
    for key, values in plain.items():
        np.testing.assert_array_equal(values, first[key])


def test_positions_are_those_of_the_picture(tmp_path):
    """To float32, which the picture has; of the middles of pixels (test_camera_rays.py)."""
    path = bfrt.spd.rings(2).write(tmp_path / "r.bfrt").path
    with bfrt.open(path) as scene:
        camera = bfrt.Camera(**{**vars(scene.camera), "resolution": (32, 32)})
        twice = bfrt.Camera(**{**vars(scene.camera), "resolution": (64, 64)})
        seen = scene.render(camera=twice, aovs=["position"])
        found = scene.cast_rays(bfrt.camera_rays(camera), outputs=["positions"])
    expected = np.stack([seen.channels[f"P.{axis}"][1::2, 1::2] for axis in "XYZ"], axis=-1)
    assert np.isfinite(expected).mean() > 0.5
    np.testing.assert_array_equal(found["positions"].astype(np.float32), expected)
    assert "next_origins" not in found


@pytest.fixture
def ball(tmp_path):
    with bfrt.SceneWriter(tmp_path / "ball.bfrt") as writer:
        writer.spheres([[0.0, 0, 0]], [1.0])
    with bfrt.open(tmp_path / "ball.bfrt") as scene:
        yield scene


@pytest.mark.parametrize(
    ("side", "outside"),
    [("incoming", [True, False]), ("opposite", [False, True]), ("front", [True, True]),
     ("back", [False, False])],
)  # fmt: skip
def test_sides(ball, side, outside):
    """Of a ray from outside, and one from inside."""
    found = ball.cast_rays(
        [[0, 0.3, -3.0], [0, 0.3, 0]], [0.0, 0, 1], outputs=["next_origins"], side=side
    )
    radius = np.linalg.norm(found["next_origins"], axis=1)
    assert ((radius > 1.0) == outside).all()
    assert (np.abs(radius - 1.0) < 1e-11).all()


def one_kind(rng, kind, n, size, middle):
    objects = random_objects(rng, n, [kind], spread=20.0 * size, size=size)
    if kind.label == "polygon":  # flat ones, as convex faces of meshes are
        return Objects(vertices=objects.vertices + middle, counts=objects.counts)
    table = {"sphere": "spheres", "cone": "cones", "triangle": "triangles", "patch": "patches"}
    rows = getattr(objects, table[kind.label]).copy()
    places = {"sphere": [0], "cone": [0, 4], "triangle": [0, 3, 6], "patch": [0, 3, 6]}
    for first in places[kind.label]:
        rows[:, first : first + 3] += middle
    return Objects(**{table[kind.label]: rows})


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("middle", [0.0, 1e6])
@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("away", [3.0, 1e4, 1e9])
@pytest.mark.parametrize("kind", list(Kind), ids=lambda kind: kind.label)
def test_a_ray_that_leaves_never_meets_its_place(tmp_path, kind, away, size, middle, side):
    """Its object only elsewhere: as far away as what is round is, or as the hit is from an edge."""
    if size == 1e6 and away == 1e9:
        away = 1e3
    rng = np.random.default_rng([list(Kind).index(kind), round(away), round(size)])
    objects = one_kind(rng, kind, 30, size, middle)
    fast.write(objects, tmp_path / "s.bfrt")
    with bfrt.open(tmp_path / "s.bfrt") as scene:
        center = (scene.bounds.lo + scene.bounds.hi) / 2
        targets = scene.bounds.lo + (scene.bounds.hi - scene.bounds.lo) * rng.random((6000, 3))
        origins = center + away * size * units(rng, 6000)
        hits = scene.cast_rays(origins, targets - origins, outputs=BOTH, side=side)
        hit = np.flatnonzero(np.isfinite(hits["t_hit"]))
        assert len(hit) > 8
        n = hits["primitive_normals"][hit].astype(float)
        p, start = hits["positions"][hit], hits["next_origins"][hit]
        step = start - p
        toward = np.sign((step * n).sum(axis=1))
        front = (n * (targets - origins)[hit]).sum(axis=1) < 0
        expected = {"front": 1.0, "back": -1.0, "incoming": np.where(front, 1.0, -1.0),
                    "opposite": np.where(front, -1.0, 1.0)}[side]  # fmt: skip
        assert (toward == expected).all()
        ways = units(rng, len(hit))
        ways[::3] += 1e-7 * units(rng, len(ways[::3])) - n[::3] * (ways[::3] * n[::3]).sum(
            axis=1, keepdims=True
        )  # almost along the surface
        ways *= np.sign((ways * step).sum(axis=1, keepdims=True))
        leaving = (ways * n).sum(axis=1) * toward > 1e-6 * np.linalg.norm(ways, axis=1)
        again = scene.cast_rays(start, ways)
        same = (again["primitive_ids"] == hits["primitive_ids"][hit]) & leaving
        distance = again["t_hit"] * np.linalg.norm(ways, axis=1)
        error = np.linalg.norm(step, axis=1)
        assert (error > 0).all() and np.median(error) < 1e-3 * size
        if kind.label not in ("sphere", "cone"):
            assert not same.any()
            return
        # The other side of what is round is away by the slope times its radius.
        slope = (ways * n).sum(axis=1) / np.linalg.norm(ways, axis=1) * toward
        assert (distance[same] > np.minimum(4 * error, 0.01 * slope * size)[same]).all()
        assert leaving.mean() > 0.5


def test_a_bounce_goes_on_forever(tmp_path):
    """Rays in a closed box of mirrors stay in it, and meet another face each time."""
    corners = np.array(np.meshgrid([0, 1.0], [0, 1.0], [0, 1.0], indexing="ij")).reshape(3, -1).T
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6],
             [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    with bfrt.SceneWriter(tmp_path / "box.bfrt") as writer:
        writer.mesh(corners, faces)
    rng = np.random.default_rng(4)
    o, d = np.full((500, 3), 0.5), units(rng, 500)
    with bfrt.open(tmp_path / "box.bfrt") as scene:
        before = np.full(500, -1)
        for _ in range(40):
            hits = scene.cast_rays(o, d, outputs=["next_origins"])
            assert np.isfinite(hits["t_hit"]).all()
            assert (hits["primitive_ids"] // 2 != before).all()  # two triangles a face
            before = hits["primitive_ids"] // 2
            n = hits["primitive_normals"].astype(float)
            d = d - 2 * n * (n * d).sum(axis=1, keepdims=True)
            o = hits["next_origins"]


@pytest.mark.parametrize(
    ("settings", "what"),
    [
        ({"outputs": "positions"}, "outputs: found 'positions', expected a sequence of positions"),
        ({"outputs": 5}, "outputs: found 5, expected a sequence of positions, next_origins"),
        ({"outputs": [["positions"]]}, r"outputs: found \['positions'\], expected a seq"),
        ({"side": np.array(["front", "back"])}, "side: found array.*, expected one of inc"),
        ({"outputs": ["normals"]}, "outputs: found 'normals', expected a sequence of positions"),
        ({"side": "left"}, "side: found 'left', expected one of incoming, opposite, front, back"),
        ({"out": {"positions": np.zeros((1, 3))}}, "out: found 'positions', expected some"),
        (
            {"outputs": BOTH, "out": {"positions": np.zeros((1, 3), "f4")}},
            "out: found positions of float32 and shape",
        ),
    ],
)  # fmt: skip
def test_refused(ball, settings, what):
    with pytest.raises(SettingError, match=what):
        ball.cast_rays([[0.0, 0, 0]], [[0.0, 0, 1]], **settings)


def test_keys_that_are_gone_through_once(ball):
    """As of a generator: none is forgotten."""
    rays = [[0.0, 0, 0]], [[0.0, 0, 1]]
    assert set(BOTH) < set(ball.cast_rays(*rays, outputs=(key for key in BOTH)))
