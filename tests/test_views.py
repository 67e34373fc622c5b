"""Several views at once: each picture is the same, bit for bit, as alone."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from capped import memory_cap
from checkpoints import Killed, Stop, scene_of, tight
from memory_cap import run_in
from sharded_scenes import both
from waves import render_here, wave_of

import bfrt
from bfrt.errors import BudgetError, SettingError
from bfrt.image.film import Film
from bfrt.image.frame import FrameSize, held_frame
from bfrt.phases.eye import EyeRays, count_eye_rays
from bfrt.records import ON_REQUEST
from bfrt.view import MOST_ELEMENTS

AOVS = tuple(ON_REQUEST)
SIZE = (24, 19)
VIEWS = [
    bfrt.Camera((0.3, -7.0, 1.5), (0.0, 0.0, 0.0), resolution=SIZE),
    bfrt.Camera((5.0, 4.0, 3.0), (0.5, 0.0, 0.0), angle=70.0, resolution=SIZE),
    bfrt.Camera((0.0, 0.2, 9.0), (0.0, 0.0, 0.0), up=(1.0, 1.0, 0.0), resolution=SIZE),
    bfrt.Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), angle=100.0, resolution=SIZE),
]
SETTINGS = {"aovs": AOVS, "threads": 2, "memory": "160MiB"}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("views")
    return {
        order: scene_of(folder / f"{order}.bfrt", order=order) for order in ("given", "spatial")
    }


@pytest.fixture(scope="module")
def alone(scenes):
    """Each view's picture, made by a call of its own, of either order."""
    return {
        order: [scene.render(camera=camera, **SETTINGS) for camera in VIEWS]
        for order, scene in scenes.items()
    }


@pytest.fixture(scope="module")
def unlit(tmp_path_factory):
    """A scene that has no lights, so that each view brings its own."""
    rng = np.random.default_rng(3)
    with bfrt.SceneWriter(tmp_path_factory.mktemp("views") / "unlit.bfrt") as writer:
        shiny = writer.material(bfrt.Material((0.8, 0.6, 0.4), 0.7, 0.3, 20.0))
        writer.spheres(rng.uniform(-2, 2, (200, 3)), 0.3, shiny)
    return bfrt.open(writer.path)


def same(images, expected):
    assert isinstance(images, bfrt.Images) and isinstance(images, list)
    assert len(images) == len(expected)
    for image, other in zip(images, expected, strict=True):
        assert image.channels.keys() == other.channels.keys()
        for name, channel in other.channels.items():
            assert np.asarray(image.channels[name]).tobytes() == channel.tobytes(), name
        assert image.metadata == other.metadata
    rays = [image.stats.total.rays for image in expected]
    for kind in ("eye", "eye_hits", "reflection", "refraction", "shadow"):
        found = getattr(images.stats.total.rays, kind)
        assert found == sum(getattr(each, kind) for each in rays)


@pytest.mark.parametrize(
    ("refine", "order"),
    [("base", "given"), ("sg", "given"), ("sgb", "given"), ("tree", "spatial")],
)
def test_each_picture_is_the_same_as_alone(scenes, alone, refine, order):
    assert not np.array_equal(alone[order][0].rgb, alone[order][1].rgb)
    images = scenes[order].render(camera=VIEWS, refine=refine, **SETTINGS)
    same(images, alone[order])


@pytest.mark.parametrize("rows", [19, 10, 1])
@pytest.mark.parametrize("threads", [1, 3])
def test_bands_of_rows(scenes, alone, rows, threads):
    scene = tight(rows)(scenes["given"])
    told = []
    images = scene.render(camera=VIEWS, progress=told.append, **{**SETTINGS, "threads": threads})
    same(images, alone["given"])
    assert {progress.bands for progress in told} == {-(-19 // rows)}
    assert isinstance(images[2].channels["Z"], np.memmap) == (rows < 19)


@pytest.mark.parametrize("samples", [1, 3])
def test_samples_are_seeded_inside_their_view(scenes, samples):
    scene = tight(7)(scenes["spatial"])
    settings = {**SETTINGS, "samples": samples, "depth": 2}
    expected = [scene.render(camera=camera, **settings) for camera in VIEWS]
    same(scene.render(camera=VIEWS, **settings), expected)
    twice = scene.render(camera=[VIEWS[1]] * 2, **settings)
    same(twice, [expected[1]] * 2)


def test_a_scene_without_lights_is_lit_for_each_view(unlit):
    expected = [unlit.render(camera=camera, **SETTINGS) for camera in VIEWS]
    assert len({image.metadata["lights"] for image in expected}) == len(VIEWS)
    same(unlit.render(camera=VIEWS, **SETTINGS), expected)


def test_lights_and_channels_that_are_gone_through_once(unlit):
    """As of a generator: all views have them."""
    suns = [bfrt.Sun(40.0, 50.0), bfrt.Sun(200.0, 30.0)]
    given = unlit.render(camera=VIEWS, lights=iter(suns), aovs=iter(AOVS), memory="160MiB")
    expected = unlit.render(camera=VIEWS, lights=suns, aovs=AOVS, memory="160MiB")
    for one, other in zip(given, expected, strict=True):
        assert one.channels.keys() == other.channels.keys()
        for name, channel in other.channels.items():
            np.testing.assert_array_equal(one.channels[name], channel, err_msg=name)


def test_a_sequence_of_one_is_a_list_of_one(scenes, alone):
    same(scenes["given"].render(camera=(VIEWS[0],), **SETTINGS), alone["given"][:1])
    same(bfrt.render(scenes["given"].path, camera=iter(VIEWS[:2]), **SETTINGS), alone["given"][:2])


@pytest.mark.parametrize("samples", [0, 1, 3])
@pytest.mark.parametrize("views", [1, 2, 5])
def test_any_part_of_the_eye_rays_is_that_part_of_all(scenes, samples, views):
    store = scenes["given"].store
    cameras = (VIEWS * 2)[:views]
    frame = FrameSize(*SIZE, samples, views=views)
    whole = EyeRays(store, cameras, samples).read(1 << 20)
    assert len(whole) == count_eye_rays(frame) == frame.elements * max(1, samples)
    assert whole["pixel"].max() == frame.elements - 1
    rng = np.random.default_rng(views)
    rays, parts = EyeRays(store, cameras, samples), []
    while len(rays):
        parts.append(rays.read(int(rng.integers(1, 200))))
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    first, last = frame.across * 3 + 5, frame.across * 7 + 2
    some = EyeRays(store, cameras, samples, first, last).read(1 << 20)
    each = max(1, samples)
    assert some.tobytes() == whole[first * each : last * each].tobytes()


@pytest.mark.parametrize("samples", [0, 1, 3])
@pytest.mark.parametrize("views", [1, 3])
def test_eye_rays_of_some_rows_are_those_of_the_frame(scenes, samples, views):
    """But for their elements, which are those of a film that has no other rows."""
    store, cameras = scenes["given"].store, VIEWS[:views]
    frame = FrameSize(*SIZE, samples, views=views)
    whole = EyeRays(store, cameras, samples).read(1 << 20)
    rows = np.array([1, 2, 5, 3], np.uint32)
    last = len(rows) * frame.across
    found = EyeRays(store, cameras, samples, 0, last, rows).read(1 << 20)
    each = frame.across * max(1, samples)
    expected = whole.reshape(-1, each)[rows].reshape(-1)
    expected["pixel"] = np.arange(last).repeat(max(1, samples))
    assert found.tobytes() == expected.tobytes()


def test_the_rows_of_a_film_are_those_of_each_view():
    """Sums that tell their element: each view is averaged with corners of its own."""
    film = Film(3, 4, 0, views=2)
    assert film.shape == (5, 8)
    (sums, _), _, (ids, _), *_ = film.planes()
    sums[:] = np.arange(40)[:, None] * 2**34
    ids[:] = np.arange(40)
    for view in range(2):
        rows = film.rows(1, 3, view)
        assert rows["R"].shape == (2, 3)
        first = np.arange(40).reshape(5, 8)[1:3, 4 * view : 4 * view + 3]
        np.testing.assert_array_equal(rows["id.lo"], first)
        np.testing.assert_array_equal(rows["R"], 4 * (first + 4.5))


def test_a_render_that_is_killed_goes_on(scenes, alone, tmp_path):
    """After each pass, with bands of which the pictures are on disk."""
    scene = tight(10)(scenes["given"])
    settings = {**SETTINGS, "scratch": tmp_path}
    folder, runs = tmp_path / "kept", 0
    while True:
        try:
            images = scene.render(
                camera=VIEWS, progress=Stop(30), checkpoint=folder, every=0, **settings
            )
            break
        except Killed:
            runs += 1
            with pytest.raises(SettingError, match="found the state of work with eye"):
                scene.render(camera=VIEWS[::-1], checkpoint=folder, every=0, **settings)
            with pytest.raises(SettingError, match="found the state of work with eye"):
                scene.render(camera=VIEWS[0], checkpoint=folder, every=0, **settings)
    assert runs > 1
    same(images, alone["given"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("samples", [None, 2])
@pytest.mark.parametrize("lit", [True, False])
def test_shards_on_workers(tmp_path, samples, lit):
    """Each element's view is told to the worker that shades its hits."""
    scene = both(tmp_path / "s", 3, lit=lit)
    views = [replace(scene.one.camera or VIEWS[0], resolution=SIZE)]
    views += scene.one.turntable(3, views[0])[1:]
    settings = {"samples": samples, "aovs": AOVS, "depth": 3, "ao": 2}
    expected = scene.one.render(camera=views, memory="160MiB", **settings)
    for image, camera in zip(expected, views, strict=True):
        single = scene.one.render(camera=camera, memory="160MiB", **settings)
        assert image.rgb.tobytes() == single.rgb.tobytes()
    found = render_here(wave_of(scene.sharded, [[0], [1, 2]], None), camera=views, **settings)
    for image, other in zip(found, expected, strict=True):
        for name, channel in other.channels.items():
            assert image.channels[name].tobytes() == channel.tobytes(), name


@pytest.mark.parametrize(
    ("camera", "fault"),
    [
        ([], "camera: found no cameras, expected one or more"),
        (7, "camera: found int, expected a Camera or None"),
        ([VIEWS[0], "x"], "camera: found str at 1, expected Cameras"),
        (
            [VIEWS[0], replace(VIEWS[1], resolution=(19, 24))],
            r"camera: found \(19, 24\) pixels at 1 and \(24, 19\) at 0, expected one resolution",
        ),
        (
            [replace(VIEWS[0], resolution=(65535, 65535))] * 2,
            f"found 2 views of {2 * 65536**2} film elements, expected {MOST_ELEMENTS} or fewer",
        ),
    ],
)
def test_views_that_cannot_be(scenes, camera, fault):
    with pytest.raises(SettingError, match=fault):
        scenes["given"].render(camera=camera)


def test_a_budget_that_is_too_small_tells_of_all_views(scenes):
    views = [replace(VIEWS[0], resolution=(4000, 10))] * 400
    with pytest.raises(
        BudgetError, match="for 400 views of 4000 x 10 pixels of this scene"
    ) as found:
        scenes["given"].render(camera=views, memory="100MiB")
    assert "expected" in str(found.value)


def test_a_plan_counts_all_views(scenes):
    one = scenes["given"].plan(camera=VIEWS[0], memory="160MiB")
    all_views = scenes["given"].plan(camera=VIEWS * 9, memory="160MiB")
    assert all_views.rays.eye == 36 * one.rays.eye == 36 * 25 * 20
    assert all_views.settings["views"] == 36 and one.settings["views"] == 1
    assert "36 x 24 x 19" in str(all_views) and " 24 x 19" in str(one)


def test_a_frame_of_many_views_is_held_in_bands():
    frame = FrameSize(512, 512, 0, views=36)
    held = held_frame(frame, 200 << 20, 1000)
    assert held.on_disk and 16 < held.rows < 128
    assert frame.band_bytes(held.rows) <= 0.31 * (200 << 20)
    assert frame.image_bytes == 36 * 512 * 512 * 40


def test_the_views_of_a_turntable_go_round(scenes):
    scene = scenes["given"]
    center = (scene.bounds.lo + scene.bounds.hi) / 2
    first = bfrt.Camera(tuple(center + np.array([3.0, -4.0, 2.0])), tuple(center), resolution=SIZE)
    views = scene.turntable(8, first)
    assert views[0] is first and len(views) == 8
    ways = np.array([np.subtract(view.eye, center) for view in views])
    np.testing.assert_allclose(np.hypot(ways[:, 0], ways[:, 1]), 5.0)
    np.testing.assert_allclose(ways[:, 2], 2.0)
    np.testing.assert_allclose(ways[2], [4.0, 3.0, 2.0])  # against the clock, from above
    np.testing.assert_allclose(ways[4], [-3.0, 4.0, 2.0], atol=1e-12)
    np.testing.assert_allclose([view.at for view in views], [center] * 8)
    lain = replace(first, up=(0.0, 5.0, 0.0), at=tuple(center + 1.0))
    turned = scene.turntable(4, lain)[1]
    np.testing.assert_allclose(np.subtract(turned.eye, center), [2.0, -4.0, -3.0], atol=1e-12)
    np.testing.assert_allclose(np.subtract(turned.at, center), [1.0, 1.0, -1.0], atol=1e-12)
    assert bfrt.turntable(scene.path, 2)[0].resolution == (512, 512)
    with pytest.raises(SettingError, match="count: found 0, expected a whole number of 1 or more"):
        scene.turntable(0)
    with pytest.raises(SettingError, match="count: found more than 65536, expected a number from"):
        scene.turntable(10**400)
    with pytest.raises(SettingError, match="camera: found int, expected a Camera or None"):
        scene.turntable(3, 5)


def test_many_views_stay_inside_the_budget(scenes, tmp_path):
    """Pictures of 64 MB, a frame that takes more than the budget, in a cgroup of it."""
    budget = 96 << 20
    with memory_cap(budget) as group:
        if group is None:
            pytest.skip("no memory cgroup can be made here")
        command = [sys.executable, "-m", "bfrt", "render", str(scenes["given"].path), "--quiet"]
        asked = ["--turntable", "25", "--resolution", "256", "256", "--depth", "2"]
        files = ["-o", "a{}.png", "--contact-sheet", "all.png", "--animation", "all-a.png"]
        done = run_in(group, [*command, *asked, *files, "--memory", "96MiB"], tmp_path)
        assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("a*.png"))) == 27


@pytest.mark.parametrize("samples", [None, 3])
@pytest.mark.parametrize("order", ["given", "spatial"])
def test_openness_is_that_of_each_view_alone(scenes, order, samples):
    """Rays of ambient occlusion are seeded by the pixel's number in its view."""
    settings = {**SETTINGS, "samples": samples, "ao": 3, "lights": [bfrt.Sun(30, 40)]}
    expected = [scenes[order].render(camera=camera, **settings) for camera in VIEWS]
    same(scenes[order].render(camera=VIEWS, **settings), expected)
    banded = tight(rows=7)(scenes[order])
    same(banded.render(camera=VIEWS, **settings), expected)


def test_openness_of_each_view_where_a_scene_has_no_light(unlit):
    expected = [unlit.render(camera=camera, ao=2, threads=2) for camera in VIEWS]
    same(unlit.render(camera=VIEWS, ao=2, threads=2), expected)
