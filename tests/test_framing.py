"""A scene that has no camera, or no lights, is seen whole and lit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bfrt
from bfrt.cli import main
from bfrt.framing import axes_of, bounding_sphere, framing_camera, framing_lights, unit
from bfrt.phases.eye import view_vectors
from bfrt.records import NO_HIT
from bfrt.scene import Scene
from bfrt.store.extent import Bounds

FRAMED = ("eye", "at", "up", "angle")
THIRD = 1 / math.sqrt(6)


def cloud(path, **settings):
    rng = np.random.default_rng(3)
    with bfrt.SceneWriter(path, **settings) as writer:
        writer.spheres(rng.uniform([0, 0, 0], [4, 2, 1], (300, 3)), 0.15)
    return bfrt.open(path)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Spheres in a box of 4 x 2 x 1 on map coordinates; neither camera nor lights."""
    folder = tmp_path_factory.mktemp("framing")
    return cloud(folder / "cloud.bfrt", origin=(5e5, 4.5e6, 100.0))


@pytest.fixture(scope="module")
def store(scene):
    return scene.store


@pytest.fixture(scope="module")
def empty(tmp_path_factory):
    path = tmp_path_factory.mktemp("framing") / "empty.bfrt"
    bfrt.SceneWriter(path).close()
    return bfrt.open(path)


@pytest.mark.parametrize(
    ("up", "way"),
    [
        ((0, 0, 1), (1, -2, 1)),
        ((0, 1, 0), (1, 1, 2)),
        ((1, 0, 0), (1, 1, -2)),
        ((0, 0, -7), (1, 2, -1)),
        ((0, 1e-300, 0), (1, 1, 2)),
    ],
)
def test_the_eye_is_in_front_to_the_right_and_above(store, up, way):
    center, _ = bounding_sphere(store)
    camera = framing_camera(store, up=up)
    assert (camera.at, camera.up) == (center, up)
    to_eye = unit(tuple(np.subtract(camera.eye, center)))
    assert to_eye == pytest.approx([THIRD * w for w in way], abs=1e-8)
    assert np.dot(to_eye, unit(up)) == pytest.approx(THIRD)


SMALL = st.floats(-10, 10)
VECTOR = st.tuples(SMALL, SMALL, SMALL)


@given(
    lo=VECTOR,
    sides=st.tuples(*[st.floats(0.01, 1000)] * 3),
    up=VECTOR.filter(lambda v: max(map(abs, v)) > 1e-3),
    angle=st.floats(1, 175),
    resolution=st.tuples(st.integers(1, 4000), st.integers(1, 4000)),
)
def test_the_sphere_around_the_bounds_touches_the_pictures_edges(
    store, lo, sides, up, angle, resolution
):
    """Both edges of the smaller angle, and neither of the other."""
    bounds = Bounds(np.array(lo), np.array(lo) + sides)
    store = replace(store, bounds=bounds, origin=(1.0, 2.0, 3.0))
    camera = framing_camera(store, up=up, angle=angle, resolution=resolution)
    center, radius = bounding_sphere(store)
    np.testing.assert_allclose(center, (bounds.lo + bounds.hi) / 2 + [1, 2, 3], atol=1e-12)
    _, forward, right, above = view_vectors(camera, (0.0, 0.0, 0.0))
    away = np.subtract(center, camera.eye)
    gaps = {}
    for name, edge in (("width", right), ("height", above)):
        inward = np.linalg.norm(edge) * forward - edge / np.linalg.norm(edge)
        gaps[name] = away @ inward / np.linalg.norm(inward) - radius
    tight, loose = ("height", "width") if resolution[0] >= resolution[1] else ("width", "height")
    assert gaps[tight] == pytest.approx(0, abs=1e-6 * np.linalg.norm(away))
    assert gaps[loose] >= -1e-6 * np.linalg.norm(away)


@pytest.mark.parametrize("resolution", [(96, 64), (32, 80)])
@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (-1, 2, 3)])
def test_all_of_the_scene_is_in_the_picture(scene, up, resolution):
    camera = bfrt.framing_camera(scene, up=up, resolution=resolution)
    seen = bfrt.render(scene, camera=camera, memory="128MiB").ids != NO_HIT
    assert seen[1:-1, 1:-1].sum() > 0.02 * seen.size
    assert not seen[[0, -1]].any() and not seen[:, [0, -1]].any()


def test_a_render_without_a_camera_is_that_of_the_framing_camera(scene):
    image = scene.render(samples=1, memory="128MiB")
    assert image.shape == (512, 512)
    asked = bfrt.render(scene, camera=scene.framing_camera(), samples=1, memory="128MiB")
    assert image.metadata == asked.metadata
    for name, channel in image.channels.items():
        assert channel.tobytes() == asked.channels[name].tobytes(), name


@pytest.mark.parametrize(
    ("arguments", "given"),
    [
        ([], {}),
        (["--up", "0", "1", "0"], {"up": (0.0, 1.0, 0.0)}),
        (["--angle", "20"], {"angle": 20.0}),
        (["--from", "500010", "4500000", "105"], {"eye": (500010.0, 4500000.0, 105.0)}),
        (["--at", "500000", "4500001", "100"], {"at": (500000.0, 4500001.0, 100.0)}),
        (["--resolution", "9", "20"], {"resolution": (9, 20)}),
    ],
    ids=["nothing", "up", "angle", "from", "at", "resolution"],
)
def test_the_command_changes_single_fields(store, tmp_path, arguments, given):
    size = [] if "--resolution" in arguments else ["--resolution", "16", "16"]
    output = tmp_path / "a.exr"
    command = ["render", str(store.path), "-o", str(output), "--memory", "128MiB"]
    assert main([*command, *arguments, *size]) == 0
    header = OpenEXR.File(str(output)).header()
    camera = framing_camera(store, **{"resolution": (16, 16), **given})
    plain = framing_camera(store, resolution=camera.resolution)
    facts = {f"bfrt.{name}": value for name, value in expected_view(camera).items()}
    assert {name: header[name] for name in facts} == facts
    changed = {name for name in FRAMED if getattr(camera, name) != getattr(plain, name)}
    follows = {"up", "angle"} & set(given)  # the eye does, with what is up, and with the angle
    assert changed == set(given) - {"resolution"} | ({"eye"} if follows else set())


def expected_view(camera):
    vectors = {name: getattr(camera, name) for name in ("eye", "at", "up")}
    texts = {name: " ".join(f"{x:.15g}" for x in vector) for name, vector in vectors.items()}
    return {**texts, "angle": f"{camera.angle:g}"}


def test_the_eye_of_a_high_picture_is_farther_away(store):
    wide, square, high = (framing_camera(store, resolution=r) for r in ((20, 9), (9, 9), (9, 20)))
    assert wide.eye == square.eye != high.eye
    assert (math.dist(high.eye, high.at)) > 2 * math.dist(wide.eye, wide.at)


def test_what_cannot_be_framed_is_refused(store, empty):
    for nothing in (empty, Scene(replace(store, bounds=Bounds(np.ones(3), np.ones(3))))):
        with pytest.raises(bfrt.SettingError, match=r"found no camera and no extent.*expected"):
            bfrt.render(nothing)
        camera = bfrt.framing_camera(nothing, eye=(0.0, -5.0, 0.0), at=(0.0, 0.0, 0.0))
        assert camera.eye == (0.0, -5.0, 0.0)  # there is no need of bounds
    for up in ((0, 0, 0), (math.nan, 0, 1), (0, math.inf, 0), (0, 0, -math.inf), (0, math.nan, 0)):
        with pytest.raises(bfrt.SettingError, match=r"up: found \(.*, expected .*finite numbers"):
            framing_camera(store, up=up)
    for up in ("abc", None, (1, 2), 3, ("0", "0", "1"), (10**400, 0, 0)):
        with pytest.raises(bfrt.SettingError, match=r"^up: found .*, expected "):
            framing_camera(store, up=up)
    for angle in (0.0, 180.0, math.nan):
        with pytest.raises(bfrt.SceneError, match=r"camera: found .*, expected"):
            framing_camera(store, angle=angle)
    center, _ = bounding_sphere(store)
    with pytest.raises(bfrt.SceneError, match="does not span a view"):
        framing_camera(store, eye=center)


def test_the_command_says_what_cannot_be_framed(empty, tmp_path, capsys):
    assert main(["render", str(empty.path), "-o", str(tmp_path / "a.png")]) == 2
    assert f"bfrt: {empty.path}: found no camera and no extent" in capsys.readouterr().err


def test_a_light_over_the_left_shoulder_and_a_weaker_one_from_the_right(store):
    camera = framing_camera(store)
    right, up, back = axes_of(camera)
    key, fill = framing_lights(store, camera)
    size = math.dist(camera.eye, camera.at)
    for light, parts in ((key, (-1.25, 0.75, 0.5)), (fill, (1, 0.25, 0))):
        way = np.subtract(light.position, camera.eye)
        assert [way @ right, way @ up, way @ back] == pytest.approx(np.multiply(parts, size))
    assert key.color == (1.5, 1.5, 1.5) and fill.color == (0.5, 0.5, 0.5)
    assert framing_lights(store, camera) == [key, fill]
    high = math.asin((key.position[2] - camera.at[2]) / math.dist(key.position, camera.at))
    assert math.degrees(high) == pytest.approx(38, abs=0.5)


def test_an_eye_in_the_midst_has_its_lights_outside(store):
    center, radius = bounding_sphere(store)
    inside = bfrt.Camera(center, (center[0], center[1] + 1, center[2]))
    key, fill = framing_lights(store, inside)
    assert math.dist(key.position, center) == pytest.approx(math.sqrt(2.375) * radius)
    assert math.dist(fill.position, center) > radius


def test_lights_are_made_only_where_there_are_none(tmp_path):
    """They are what a store that has them would have, and the metadata names them."""
    camera = bfrt.Camera((2, -9, 4), (2, 1, 0.5), resolution=(48, 32))
    dark = cloud(tmp_path / "dark.bfrt", origin=(0, 0, 0))
    lights = framing_lights(dark.store, camera)
    rng = np.random.default_rng(3)
    with bfrt.SceneWriter(tmp_path / "lit.bfrt", origin=(0, 0, 0)) as writer:
        for light in lights:
            writer.light(light)
        writer.spheres(rng.uniform([0, 0, 0], [4, 2, 1], (300, 3)), 0.15)
    made, own = (
        bfrt.render(tmp_path / name, camera=camera, memory="128MiB")
        for name in ("dark.bfrt", "lit.bfrt")
    )
    for name, channel in made.channels.items():
        assert channel.tobytes() == own.channels[name].tobytes(), name
    numbers = [" ".join(f"{x:.15g}" for x in (*light.position, *light.color)) for light in lights]
    assert made.metadata["lights"] == f"automatic: {numbers[0]}, {numbers[1]}"
    assert "lights" not in own.metadata


def test_a_lit_sphere_is_round(tmp_path):
    """Brighter where the key light is, dark nowhere, and never burnt out."""
    with bfrt.SceneWriter(tmp_path / "one.bfrt") as writer:
        writer.spheres([[0.0, 0.0, 0.0]], [1.0], writer.material(bfrt.Material((1, 1, 1))))
    scene = bfrt.open(tmp_path / "one.bfrt")
    camera = scene.framing_camera(resolution=(64, 64))
    image = bfrt.render(scene, camera=camera, memory="128MiB")
    light, solid = image.channels["R"], image.channels["A"] == 1
    upper_left, lower_right = light[20:28, 20:28], light[36:44, 36:44]
    assert solid[20:28, 20:28].all() and solid[36:44, 36:44].all()
    assert upper_left.min() > lower_right.max() + 0.1
    assert light[solid].min() > 0.3 and light.max() < 1.1


def test_a_file_without_a_view_or_lights_is_a_picture(tmp_path):
    (tmp_path / "a.nff").write_text("f 1 1 1 1 0 0 0 0\ns 0 0 0 1\ns 2 0 0 1\n")
    output = tmp_path / "a.npy"
    command = ["render", str(tmp_path / "a.nff"), "-o", str(output), "--memory", "128MiB"]
    assert main([*command, "--resolution", "32", "32"]) == 0
    pixels = np.load(output)
    assert 0.1 < pixels[:, :, 3].mean() < 0.9 and pixels[:, :, 0].max() > 0.6
