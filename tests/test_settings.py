"""Settings are checked once, where they come in: what cannot be honoured is one sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bfrt
from bfrt.errors import BudgetError, SettingError
from bfrt.memory import default_memory
from bfrt.settings import REFINEMENTS, Settings, at_least_one, scratch_folder
from bfrt.workers import usable_threads

NO_MEMORY = "expected an amount such as 256MiB or 1.5GB"
NO_COUNT = "expected a whole number of 1 or more"

# fmt: off
#: What every render, plan and query refuses, and what it says.
REFUSED = [
    ("memory", "lots", f"memory: found 'lots', {NO_MEMORY}"),
    ("memory", 1.5, f"memory: found 1.5, {NO_MEMORY}"),
    ("memory", True, f"memory: found True, {NO_MEMORY}"),
    ("memory", 10**30, "memory: found 2^99 bytes or more, expected fewer than 2^63, "
     "as many as have addresses"),
    ("memory", 1 << 63, "memory: found 2^63 bytes or more, expected fewer than 2^63, "
     "as many as have addresses"),
    ("memory", "8388608TiB", "memory: found 2^63 bytes or more, expected fewer than 2^63, "
     "as many as have addresses"),
    ("memory", "9" * 5000, f"memory: found {repr('9' * 5000)[:80]}, {NO_MEMORY}"),
    ("threads", 0, f"threads: found 0, {NO_COUNT}"),
    ("threads", -1, f"threads: found -1, {NO_COUNT}"),
    ("threads", 2.0, f"threads: found 2.0, {NO_COUNT}"),
    ("threads", True, f"threads: found True, {NO_COUNT}"),
    ("threads", "2", f"threads: found '2', {NO_COUNT}"),
    ("refine", "fast", "refine: found 'fast', expected one of base, sg, sgb, tree"),
    ("refine", "SGB", "refine: found 'SGB', expected one of base, sg, sgb, tree"),
    ("refine", ["sg"], "refine: found ['sg'], expected one of base, sg, sgb, tree"),
    ("grid", 0, f"grid: found 0, {NO_COUNT}"),
    ("grid", 1.5, f"grid: found 1.5, {NO_COUNT}"),
    ("max_grid", -7, f"max_grid: found -7, {NO_COUNT}"),
    ("max_grid", "x", f"max_grid: found 'x', {NO_COUNT}"),
    ("scratch", "/no/such", "scratch: found /no/such, expected a folder that is there"),
]
# fmt: on

#: What a view refuses beside those.
REFUSED_OF_A_VIEW = [
    ("samples", 0, f"samples: found 0, {NO_COUNT}"),
    ("samples", 1.0, f"samples: found 1.0, {NO_COUNT}"),
    ("samples", 1 << 31, "samples: found more than 2147483647, expected a number from 1 to that"),
    ("samples", 10**30, "samples: found more than 2147483647, expected a number from 1 to that"),
    ("camera", 3, "camera: found int, expected a Camera or None"),
    ("ambient", 10**400, f"ambient: found {str(10**400)[:80]}, expected a number of 0 or more"),
    (
        "ambient",
        np.complex64(1),
        "ambient: found np.complex64(1+0j), expected a number of 0 or more",
    ),
    ("aovs", 3, "aovs: found 3, expected a sequence of position, albedo"),
    ("aovs", None, "aovs: found None, expected a sequence of position, albedo"),
    ("depth", 0, f"depth: found 0, {NO_COUNT}"),
    ("depth", None, f"depth: found None, {NO_COUNT}"),
    ("aovs", "albedo", "aovs: found 'albedo', expected a sequence of position, albedo"),
    ("aovs", [["albedo"]], "aovs: found ['albedo'], expected a sequence of position, albedo"),
    ("aovs", ["Q"], "aovs: found 'Q', expected a sequence of position, albedo"),
    ("lights", 3, "lights: found 3, expected a sequence of Light and Sun"),
    ("lights", "sun", "lights: found 'sun', expected a sequence of Light and Sun"),
    (
        "lights",
        bfrt.Light((0, 0, 1)),
        "lights: found Light(position=(0, 0, 1), "
        "color=(1.0, 1.0, 1.0)), expected a sequence of Light and Sun",
    ),
    ("lights", [(0, 0, 1)], "lights: found (0, 0, 1) among them, expected a Light or a Sun"),
    (
        "lights",
        [bfrt.Light((0, 0))],
        "lights: position: found (0, 0), expected three finite numbers",
    ),
    (
        "lights",
        [bfrt.Light((0, 0, 1), (np.nan, 0, 0))],
        "lights: color: found (nan, 0, 0), expected three finite numbers",
    ),
    ("ambient", -1, "ambient: found -1, expected a number of 0 or more"),
    ("ambient", np.nan, "ambient: found nan, expected a number of 0 or more"),
    ("ambient", np.inf, "ambient: found inf, expected a number of 0 or more"),
    ("ambient", True, "ambient: found True, expected a number of 0 or more"),
    ("ambient", "dim", "ambient: found 'dim', expected a number of 0 or more"),
    ("background", (1, 2), "background: found (1, 2), expected three finite numbers"),
    ("background", (0, 0, np.inf), "background: found (0, 0, inf), expected three finite numbers"),
    ("ao", -1, "ao: found -1, expected a whole number of 0 or more"),
    ("ao", 1.5, "ao: found 1.5, expected a whole number of 0 or more"),
    ("ao", True, "ao: found True, expected a whole number of 0 or more"),
    ("ao", None, "ao: found None, expected a whole number of 0 or more"),
    ("ao", 65537, "ao: found more than 65536, expected a number from 1 to that"),
    ("ao_distance", 1.0, "ao_distance: found 1.0 without ao, which it is of"),
]

#: Lengths of rays of ambient occlusion that are none.
NO_LENGTH = "expected a length of 1e-150 or more"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return bfrt.spd.tetra(2).write(tmp_path_factory.mktemp("settings") / "t.bfrt")


def refusal(ask, **settings):
    """The sentence in which settings are refused."""
    with pytest.raises(SettingError) as caught:
        ask(**settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(("name", "value", "said"), REFUSED)
def test_each_is_refused_in_one_sentence(scene, name, value, said):
    assert refusal(Settings.of, **{name: value}) == said
    assert refusal(scene.render, **{name: value}) == said
    assert refusal(scene.plan, **{name: value}) == said
    rays = np.zeros((1, 3)), np.ones((1, 3))
    for query in ("cast_rays", "occluded", "count_intersections", "list_intersections"):

        def ask(query=query, **settings):
            return getattr(scene, query)(*rays, **settings)

        assert refusal(ask, **{name: value}) == said


def test_an_empty_path_is_not_the_working_folder(scene, tmp_path, monkeypatch):
    """As it is where a script's variable is not set."""
    monkeypatch.chdir(tmp_path)
    image = scene.render(camera=bfrt.Camera((1, 2, 3), (0, 0, 0), resolution=(2, 2)))
    rays = np.zeros((1, 3)), np.ones((1, 3))
    for name, ask in {
        "checkpoint": lambda: scene.render(checkpoint=""),
        "scratch": lambda: scene.render(scratch=""),
        "out": lambda: scene.cast_rays(*rays, out=""),
        "image": lambda: image.save(""),
        "clean": lambda: bfrt.clean(""),
        "store": lambda: bfrt.open(""),
        "source": lambda: bfrt.convert("", "a.bfrt"),
    }.items():
        assert refusal(ask) == f"{name}: found an empty path, expected one with a name"
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("memory", [(1 << 63) - 1, 1 << 62, "100TB"])
def test_more_memory_than_the_machine_has_is_only_a_limit(tmp_path, memory):
    """What is needed is taken: the answers are those of a small budget, in several groups too."""
    made = bfrt.convert(["spd:tetra:2", "spd:balls:1"], tmp_path / "two.bfrt")
    rays = np.random.default_rng(5).normal(size=(2, 40, 3))
    for scene in (made, bfrt.spd.tetra(2).write(tmp_path / "one.bfrt")):
        for query in ("cast_rays", "occluded", "count_intersections", "list_intersections"):
            ask = getattr(scene, query)
            few, much = ask(*rays, memory="128MiB"), ask(*rays, memory=memory)
            blocks = ask([tuple(rays)], memory=memory)
            for key, values in few.items():
                np.testing.assert_array_equal(values, much[key])
                np.testing.assert_array_equal(values, blocks[key])
        camera = bfrt.framing_camera(scene, resolution=(8, 8))
        few, much = (scene.render(camera=camera, memory=m) for m in ("128MiB", memory))
        np.testing.assert_array_equal(np.asarray(few), np.asarray(much))
        assert scene.plan(memory=memory).as_dict()


@pytest.mark.parametrize(("name", "value", "said"), REFUSED_OF_A_VIEW)
def test_those_of_a_view_too(scene, name, value, said):
    assert refusal(scene.render, **{name: value}) == said
    assert refusal(scene.plan, **{name: value}) == said


@pytest.mark.parametrize("length", [0, -1.0, np.nan, 1e-200, True, "far"])
def test_rays_of_ambient_occlusion_have_a_length(scene, length):
    said = f"ao_distance: found {length!r}, {NO_LENGTH}"
    assert refusal(scene.render, ao=1, ao_distance=length) == said
    assert refusal(scene.plan, ao=1, ao_distance=length) == said


@pytest.mark.parametrize("value", [70_000, 1 << 40, 1 << 63, 10**30])
def test_more_voxels_than_there_can_be(scene, value, recwarn):
    rays = np.zeros((1, 3)), np.ones((1, 3))
    with pytest.raises(BudgetError, match=f"grid: found {value} voxels on the longest axis"):
        scene.cast_rays(*rays, grid=value)
    found = scene.cast_rays(*rays, max_grid=value)
    np.testing.assert_array_equal(found["t_hit"], scene.cast_rays(*rays)["t_hit"])
    assert not recwarn.list


def test_a_file_is_no_folder(scene, tmp_path):
    file = tmp_path / "file"
    file.touch()
    assert refusal(scene.render, scratch=file) == (
        f"scratch: found {file}, expected a folder that is there"
    )


def test_what_nobody_sets():
    settings = Settings.of()
    assert settings == Settings(default_memory(), usable_threads(), REFINEMENTS["sgb"])
    assert (settings.grid, settings.max_grid, settings.scratch) == (None, None, None)
    assert settings.fresh_marks is False


def test_words_become_values(tmp_path):
    settings = Settings.of(
        memory="1MiB", threads=np.int32(3), refine="sg", grid=np.uint8(4), max_grid=5,
        fresh_marks=True, scratch=str(tmp_path),
    )  # fmt: skip
    assert settings == Settings(1 << 20, 3, REFINEMENTS["sg"], 4, 5, True, tmp_path)
    assert type(settings.threads) is type(settings.grid) is int
    assert hash(settings) == hash(Settings.of(
        memory=1 << 20, threads=3, refine="sg", grid=4, max_grid=5, fresh_marks=True,
        scratch=tmp_path,
    ))  # fmt: skip


def test_each_refinement_has_those_before_it():
    made = list(REFINEMENTS.values())
    assert [each.name for each in made] == list(REFINEMENTS) == ["base", "sg", "sgb", "tree"]
    assert [(each.lazy, each.hierarchy, each.tree) for each in made] == [
        (False, False, False), (True, False, False), (True, True, False), (True, False, True),
    ]  # fmt: skip


@given(st.integers())
def test_whole_numbers_of_one_or_more(value):
    if value >= 1:
        assert at_least_one("n", value) == value
    else:
        with pytest.raises(SettingError, match=f"n: found {value}, {NO_COUNT}"):
            at_least_one("n", value)


def test_scratch_is_beside_unless_it_is_asked_for(tmp_path, monkeypatch):
    store = tmp_path / "a.bfrt"
    (tmp_path / "other").mkdir()
    assert scratch_folder(None, store) == tmp_path.resolve()
    assert scratch_folder(tmp_path / "other", store) == tmp_path / "other"
    assert Settings.of(scratch=tmp_path / "other").scratch_beside(store) == tmp_path / "other"
    assert Settings.of().scratch_beside(store) == tmp_path.resolve()
    monkeypatch.setattr("os.access", lambda *_: False)
    monkeypatch.setattr("tempfile.gettempdir", lambda: "/else/where")
    assert Settings.of().scratch_beside(store) == Path("/else/where")
