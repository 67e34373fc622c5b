"""A checkpoint is complete or not there: what is torn, flipped or of other work is refused."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from checkpoints import VIEW, Killed, Stop, same_picture, scene_of, tight

import bfrt
from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.pace import Pace
from bfrt.checkpoint.state import SavedState
from bfrt.errors import CheckpointError, SettingError
from bfrt.store.model import Light

SETTINGS = {"camera": VIEW, "threads": 2}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return tight(rows=8)(scene_of(tmp_path_factory.mktemp("scenes") / "a.bfrt"))


@pytest.fixture(scope="module")
def expected(scene):
    return scene.render(**SETTINGS)


@pytest.fixture(scope="module")
def saved(scene, tmp_path_factory):
    """Two generations of one render, one after the other, in folders of their own."""
    folders = []
    for at in (90, 91):
        folder = tmp_path_factory.mktemp("saved") / "kept"
        with pytest.raises(Killed):
            scene.render(checkpoint=folder, every=0, progress=Stop(at), **SETTINGS)
        folders.append(next(folder.iterdir()))
    assert [each.name for each in folders] == ["state.91", "state.92"]
    return folders


def put(folder, *generations):
    folder.mkdir()
    for each in generations:
        shutil.copytree(each, folder / each.name)
    return folder


def damages(generation):
    """Every way to damage a generation: each file cut, one bit flipped, missing."""
    for path in sorted(generation.iterdir()):
        size = path.stat().st_size
        yield path.name, lambda file: file.unlink()
        for at in {0, size // 2, size - 1} if size else ():
            yield path.name, lambda file, at=at: file.write_bytes(file.read_bytes()[:at])
            yield path.name, lambda file, at=at: flip(file, at)
        yield path.name, lambda file: file.write_bytes(file.read_bytes() + b"\0")


def flip(file, at):
    data = bytearray(file.read_bytes())
    data[at] ^= 0x10
    file.write_bytes(data)


def test_what_is_damaged_is_refused(scene, saved, tmp_path):
    count = 0
    for number, (name, damage) in enumerate(damages(saved[0])):
        folder = put(tmp_path / str(number), saved[0])
        damage(folder / saved[0].name / name)
        with pytest.raises(CheckpointError, match=f"^{folder / saved[0].name / name}: "):
            scene.render(checkpoint=folder, **SETTINGS)
        assert [path.name for path in folder.iterdir()] == [saved[0].name]
        count += 1
    assert count > 50


def test_the_state_before_is_used_where_the_last_is_damaged(scene, saved, expected, tmp_path):
    for number, (name, damage) in enumerate(damages(saved[1])):
        folder = put(tmp_path / str(number), *saved)
        damage(folder / saved[1].name / name)
        with Checkpoint(folder) as kept:
            identity = SavedState(saved[0]).identity
            found = kept.find(identity)
            assert found.folder.name == saved[0].name
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)
    assert not folder.exists()


def test_the_later_of_two_is_used(scene, saved, expected, tmp_path):
    folder = put(tmp_path / "kept", *saved)
    with Checkpoint(folder) as kept:
        assert kept.find(SavedState(saved[0]).identity).folder.name == saved[1].name
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)


def test_what_a_kill_was_writing_is_removed(scene, saved, expected, tmp_path):
    folder = put(tmp_path / "kept", saved[0])
    (folder / "state.93.part").mkdir()
    (folder / "state.93.part" / "film0").write_bytes(b"some")
    (folder / "mine").write_text("of another program")
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)
    assert [path.name for path in folder.iterdir()] == ["mine"]


OTHERS = {
    "eye": {"camera": replace(VIEW, eye=(0.3, -7.0, np.nextafter(1.5, 2.0)))},
    "at": {"camera": replace(VIEW, at=(0.0, 0.0, 0.1))},
    "up": {"camera": replace(VIEW, up=(0.0, 0.1, 1.0))},
    "angle": {"camera": replace(VIEW, angle=44.0)},
    "resolution": {"camera": replace(VIEW, resolution=(24, 20))},
    "samples": {"samples": 2},
    "depth": {"depth": 4},
    "aovs": {"aovs": ("albedo",)},
    "refine": {"refine": "sg"},
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_settings_are_refused(scene, saved, tmp_path, name):
    folder = put(tmp_path / "kept", saved[0])
    with pytest.raises(SettingError, match=f"found the state of work with {name} .*, expected"):
        scene.render(checkpoint=folder, **{**SETTINGS, **OTHERS[name]})
    assert [path.name for path in folder.iterdir()] == [saved[0].name]


def test_another_scene_and_another_version_are_refused(scene, saved, tmp_path, monkeypatch):
    folder = put(tmp_path / "kept", saved[0])
    other = scene_of(tmp_path / "b.bfrt", count=401)
    with pytest.raises(SettingError, match=r'with scene "[0-9a-f]{8}", expected scene "'):
        other.render(checkpoint=folder, **SETTINGS)
    lit = bfrt.scene.Scene(replace(scene.store, lights=[Light((0.0, 0.0, 9.0))]))
    with pytest.raises(SettingError, match="with lights "):
        lit.render(checkpoint=folder, **SETTINGS)
    monkeypatch.setattr("bfrt.checkpoint.identity.VERSION", "9.9")
    with pytest.raises(SettingError, match=r'with version "0\.1\.0", expected version "9\.9"'):
        scene.render(checkpoint=folder, **SETTINGS)


def test_one_run_at_a_time(scene, saved, tmp_path):
    folder = put(tmp_path / "kept", saved[0])
    with (
        Checkpoint(folder),
        pytest.raises(SettingError, match="found another run at work with it"),
    ):
        scene.render(checkpoint=folder, **SETTINGS)


def test_a_save_that_fails_leaves_the_state_before(scene, saved, expected, tmp_path, monkeypatch):
    """At every file that is written."""
    from bfrt.checkpoint import state
    from bfrt.errors import StreamError

    create = state._create
    files = len(list(saved[0].iterdir()))
    for at in range(files):
        folder = put(tmp_path / str(at), saved[0])
        calls = []

        def failing(path, at=at, calls=calls):
            calls.append(path)
            if len(calls) > at:
                raise StreamError(path, 0, 5, "creating")
            return create(path)

        monkeypatch.setattr(state, "_create", failing)
        with pytest.raises(StreamError, match="creating at byte 0"):
            scene.render(checkpoint=folder, every=0, **SETTINGS)
        monkeypatch.setattr(state, "_create", create)
        assert [path.name for path in folder.iterdir()] == [saved[0].name]
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)


@pytest.mark.parametrize("where", ["a file", "in a store"])
def test_folders_that_cannot_be(scene, tmp_path, where):
    folder = tmp_path / "kept"
    if where == "a file":
        folder.write_text("mine")
    else:
        folder = scene.path / "kept"
    with pytest.raises(SettingError, match=r"^checkpoint: "):
        scene.render(checkpoint=folder, **SETTINGS)


def test_saves_cost_a_fiftieth_of_the_time(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("time.perf_counter", lambda: now[0])
    pace = Pace(10.0)
    now[0] = 9.9
    assert not pace.due(1)
    now[0] = 10.0
    assert pace.due(1)
    assert not pace.due(10**9)  # until one has been timed, at 100 MB/s: 10 s, each 500
    pace.saved(10**6, 2.0)
    now[0] += 99.0
    assert not pace.due(10**6)
    now[0] += 1.0
    assert pace.due(10**6) and not pace.due(2 * 10**6)
    assert Pace(0.0).due(10**12)
