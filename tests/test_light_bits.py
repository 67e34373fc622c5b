"""Light that is asked for makes the same picture whatever it is made with."""

from __future__ import annotations

import numpy as np
import pytest
from checkpoints import VIEW, scene_of, tight
from shading import LIT

import bfrt
from bfrt.illumination import Illumination, LightAsked

ASKED = {
    "of all kinds": LIT,
    "far": {"ao": 4, "lights": [bfrt.Sun(20, 50)]},
    "one ray": {"ao": 1},
    "dark": {"lights": [], "ambient": 0.0, "ao": 9},
}


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    given = scene_of(folder / "given.bfrt")
    return {"given": given, "tree": scene_of(folder / "ordered.bfrt", groups=3, order="spatial")}


@pytest.fixture(scope="module")
def expected(scenes):
    return {
        name: scenes["given"].render(camera=VIEW, refine="base", memory="1GiB", threads=1, **light)
        for name, light in ASKED.items()
    }


def same(image, expected):
    for name, channel in expected.channels.items():
        assert image.channels[name].tobytes() == channel.tobytes(), name
    assert image.stats.total.rays == expected.stats.total.rays
    assert image.stats.bad_rays == 0


@pytest.mark.parametrize("name", ASKED)
@pytest.mark.parametrize("refine", ["base", "sg", "sgb", "tree"])
@pytest.mark.parametrize(("memory", "threads"), [("96MiB", 2), ("512MiB", 1), ("512MiB", 3)])
def test_every_refinement_budget_and_number_of_threads(
    scenes, expected, name, refine, memory, threads
):
    scene = scenes["tree" if refine == "tree" else "given"]
    settings = {"refine": refine, "memory": memory, "threads": threads, **ASKED[name]}
    same(scene.render(camera=VIEW, **settings), expected[name])


@pytest.mark.parametrize("refine", ["sg", "sgb", "tree"])
@pytest.mark.parametrize("changes", [{}, {"rows": 7}, {"resident": False}, {"queue": 3, "hits": 5}])
def test_nearly_everything_is_spooled(scenes, expected, tmp_path, refine, changes):
    scene = tight(**changes)(scenes["tree" if refine == "tree" else "given"])
    settings = {"refine": refine, "threads": 2, "scratch": tmp_path}
    image = scene.render(camera=VIEW, **settings, **LIT)
    same(image, expected["of all kinds"])
    assert image.stats.total.phases.shading.bytes_written > 72 * 5 * image.stats.total.rays.eye_hits
    assert list(tmp_path.iterdir()) == []


def test_more_rays_than_a_worker_gathers(scenes):
    """A hit sends its rays in several parts, and each counts for itself."""
    camera = bfrt.Camera(VIEW.eye, VIEW.at, resolution=(4, 3))
    many = scenes["given"].render(camera=camera, ao=3000, ambient=0.5, threads=2, lights=[])
    again = scenes["given"].render(camera=camera, ao=3000, ambient=0.5, threads=1, lights=[])
    same(many, again)
    none = scenes["given"].render(camera=camera, ambient=0.5, threads=1, lights=[])
    assert (many.rgb <= none.rgb * (1 + 1e-5)).all() and (many.rgb < none.rgb).any()


def test_rays_do_not_depend_on_lights_and_strength(scenes):
    """Twice the ambient light is twice the light, sample by sample."""
    pictures = [
        scenes["given"].render(camera=VIEW, ao=3, ambient=a, lights=[], background=(0, 0, 0)).rgb
        for a in (0.25, 0.5)
    ]
    assert pictures[0].max() > 0.05
    np.testing.assert_allclose(2 * pictures[0], pictures[1], rtol=1e-5, atol=1e-7)


def test_what_changes_the_picture_is_known(scenes):
    store = scenes["given"].store

    def facts(**asked):
        return Illumination.of(store, VIEW, LightAsked(**asked)).facts()

    plain = facts()
    assert plain == facts(lights=store.lights, background=store.background)
    others = [
        facts(lights=[bfrt.Sun(1, 2)]), facts(lights=[bfrt.Sun(1, 2, intensity=2)]), facts(ao=1),
        facts(lights=store.lights[:1]), facts(ao=2), facts(ao=1, ao_distance=2.0),
        facts(ambient=0.3), facts(background=(0, 0, 0)), plain,
    ]  # fmt: skip
    assert all(a != b for n, a in enumerate(others) for b in others[:n])


def test_the_metadata_tells_what_is_not_the_scenes_own(scenes):
    scene = scenes["given"]
    plain = scene.render(camera=VIEW).metadata
    assert not plain.keys() & {"lights", "ambient", "ao", "ao_distance", "background"}
    told = scene.render(camera=VIEW, **LIT).metadata
    assert {key: told[key] for key in told.keys() - plain.keys()} == {
        "lights": "sun 140 35 1 0.8 0.6, 5 -8 9 1 1 1, sun 300 5 1 1 1",
        "ambient": "0.8", "ao": "5", "ao_distance": "1.5", "background": "0.1 0.25 0.5",
    }  # fmt: skip
    assert scene.render(camera=VIEW, lights=[]).metadata["lights"] == "none"
    assert scene.render(camera=VIEW, ao=2).metadata["ao_distance"] == "inf"


def test_a_store_keeps_point_lights_alone(tmp_path):
    with (
        pytest.raises(bfrt.SceneError, match=r"light: found Sun.*, expected a Light"),
        bfrt.SceneWriter(tmp_path / "a.bfrt") as writer,
    ):
        writer.light(bfrt.Sun(0, 0))
    assert list(tmp_path.iterdir()) == []
