"""A checkpoint is complete or not there: what is torn, flipped or of other work is refused."""

from __future__ import annotations

import errno
import fcntl
import gc
import json
import os
import shutil
import warnings
from dataclasses import replace

import numpy as np
import pytest
from checkpoints import VIEW, Killed, Stop, same_picture, scene_of, tight
from signing import sign_state

import bfrt
from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.pace import Pace
from bfrt.checkpoint.soundness import RENDER_FACTS
from bfrt.checkpoint.state import SavedState
from bfrt.errors import CheckpointError, SettingError, StreamError
from bfrt.records import HIT, PATH, RAY
from bfrt.store.model import Light

SETTINGS = {"camera": VIEW, "threads": 2}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return tight(rows=8, rays=60, candidates=100)(
        scene_of(tmp_path_factory.mktemp("scenes") / "a.bfrt")
    )


@pytest.fixture(scope="module")
def expected(scene):
    return scene.render(**SETTINGS)


class Rich:
    """Kills a run some reports after a state that has something of everything."""

    def __init__(self, folder, later):
        self.folder, self.left, self.found = folder, later, False

    def __call__(self, _):
        (state,) = self.folder.iterdir()
        names = ("rays", "paths", "hits", "between1", "image.R")  # in the last group
        sizes = [(state / name).stat().st_size for name in names if (state / name).exists()]
        self.found |= len(sizes) == len(names) and all(sizes)
        self.left -= self.found
        if self.left < 0:
            raise Killed


@pytest.fixture(scope="module")
def saved(scene, tmp_path_factory):
    """Two generations of one render, one after the other, in folders of their own."""
    folders = []
    for later in (0, 1):
        folder = tmp_path_factory.mktemp("saved") / "kept"
        with pytest.raises(Killed):
            scene.render(checkpoint=folder, every=0, progress=Rich(folder, later), **SETTINGS)
        folders.append(next(folder.iterdir()))
    numbers = [int(each.name.removeprefix("state.")) for each in folders]
    assert numbers[1] > numbers[0]
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


def signed(generation, change):
    """Change a generation, and sign it anew: its checksums are right."""
    body = json.loads((generation / "state.json").read_text())
    change(generation, body)
    sign_state(generation, body)


def records(name, dtype, field, value):
    """Change a field of all records of a file."""

    def change(generation, _):
        held = np.fromfile(generation / name, dtype)
        assert len(held)
        held[field] = value
        held.tofile(generation / name)

    return change


def fact(name, value):
    return lambda _, body: body["facts"].update({name: value})


FORGED = {
    "pixel of a ray in flight": records("paths", PATH, "pixel", 1 << 30),
    "pixel of the band before": records("paths", PATH, "pixel", 0),
    "sentinel": records("rays", RAY, "voxel", 1 << 29),
    "face": records("rays", RAY, "face", 7),
    "locked": records("rays", RAY, "lock", 1),
    "state": records("rays", RAY, "state", 9),
    "kind": records("rays", RAY, "kind", 4),
    "object": records("rays", RAY, "id", 5 << 48 | 7),
    "object beyond the last": records("hits", HIT, "id", 1 << 40),
    "pixel of a hit": records("hits", HIT, "pixel", 1 << 30),
    "pixel of a ray between groups": records("between1", HIT, "pixel", 1 << 31),
    "band": fact("band", 1),
    "row": fact("row", 9),
    "rows": fact("rows", 4),
    "depth": fact("depth", 0),
    "a text": fact("depth", "2"),
    "eye rays": fact("eye_rays", 10**9),
    "no picture": fact("image", {}),
    "another channel": fact("image", {"R": "<f4", "S": "<f4"}),
    "tracer": fact("tracer", None),
    "group": fact("tracer", {"group": 9, "where": "end", "quota": 2}),
    "quota": fact("tracer", {"group": 0, "where": "end", "quota": -2}),
    "counters": fact("stats", {"marks_reused": True, "total": {"rays": "many"}, "depths": []}),
    "nothing": lambda _, body: body["facts"].clear(),
    "a list": lambda _, body: body.update(facts=[]),
    "another file": lambda _, body: body["files"].update(
        {"../kept/state.json": {"bytes": 1, "crc32": 1}}
    ),
    "cut records": lambda generation, _: (generation / "rays").write_bytes(b"1234567"),
    "fewer paths": lambda generation, _: (generation / "paths").write_bytes(b""),
}


@pytest.mark.parametrize("name", FORGED)
def test_what_is_forged_is_refused(scene, saved, tmp_path, name):
    """Header and checksums are right, but what they are of leads outside."""
    folder = put(tmp_path / "kept", saved[0])
    signed(folder / saved[0].name, FORGED[name])
    with pytest.raises(CheckpointError, match=f"^{folder / saved[0].name}"):
        scene.render(checkpoint=folder, **SETTINGS)


def test_the_state_before_is_used_where_the_last_is_damaged(scene, saved, expected, tmp_path):
    for number, (name, damage) in enumerate(damages(saved[1])):
        folder = put(tmp_path / str(number), *saved)
        damage(folder / saved[1].name / name)
        with Checkpoint(folder) as kept:
            identity = SavedState(saved[0]).identity
            found = kept.find(identity, RENDER_FACTS)
            assert found.folder.name == saved[0].name
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)
    assert not folder.exists()


def test_the_later_of_two_is_used(scene, saved, expected, tmp_path):
    folder = put(tmp_path / "kept", *saved)
    with Checkpoint(folder) as kept:
        assert kept.find(SavedState(saved[0]).identity, RENDER_FACTS).folder.name == saved[1].name
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
    "lights": {"lights": [bfrt.Sun(315.0, 45.0)]},
    "ambient": {"ambient": 0.5},
    "ao": {"ao": 2},
    "background": {"background": (0.1, 0.2, 0.25)},
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


@pytest.mark.parametrize("number", ["ENOLCK", "EOPNOTSUPP", "ENOTSUP", "ENOSYS", "EINVAL", "EBADF"])
def test_a_folder_that_cannot_be_locked_is_used(scene, expected, tmp_path, monkeypatch, number):
    """As over NFS, where a folder has no lock of this sort, since none can be written to."""

    def refuse(*_):
        raise OSError(getattr(errno, number), "no")

    monkeypatch.setattr(fcntl, "flock", refuse)
    folder = tmp_path / "kept"
    with pytest.raises(Killed):
        scene.render(checkpoint=folder, every=0, progress=Stop(9), **SETTINGS)
    assert list(folder.iterdir())
    same_picture(scene.render(checkpoint=folder, **SETTINGS), expected)
    assert not folder.exists()


def test_a_lock_that_the_system_refuses_is_an_error(scene, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EIO, "no")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(StreamError, match=f"^{tmp_path / 'kept'}: creating"):
        scene.render(checkpoint=tmp_path / "kept", **SETTINGS)


def test_a_lock_that_the_system_refuses_to_close_is_given_up(tmp_path, monkeypatch):
    """Nothing was written by it: the work is done."""
    close = os.close

    def refusing(descriptor):
        close(descriptor)
        raise OSError(errno.ENOSPC, "no")

    with Checkpoint(tmp_path / "kept") as kept:
        kept.find({}, lambda _: None)
        monkeypatch.setattr(os, "close", refusing)
    assert not (tmp_path / "kept").exists()


@pytest.mark.parametrize("linked", [False, True])
def test_a_run_that_finishes_meanwhile_takes_its_folder_with_it(tmp_path, monkeypatch, linked):
    """It removes the folder between the look and the lock of another, which makes its own."""
    folder = named = tmp_path / "kept"
    if linked:
        named = tmp_path / "link"
        named.symlink_to(folder)
        folder.mkdir()
    real, spoilt = fcntl.flock, []

    def late(descriptor, how):
        if not spoilt:
            spoilt.append(folder.rmdir())
        real(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with Checkpoint(named, 0) as kept:
        kept.find({}, lambda _: None)
        kept.save(lambda writer: {"a": writer.put("b", [np.zeros(3)])})
        assert [path.name for path in folder.iterdir()] == ["state.1"]
        kept.remove()
    assert spoilt and not folder.exists()


def test_files_of_others_stay(tmp_path):
    """Also those whose names begin as marks' do."""
    mine, others = ("bfrt-marks.0.layers", "bfrt-marks.12.index"), ("bfrt-marks.txt", "state.x")
    for name in (*mine, *others):
        (tmp_path / name).write_bytes(b"")
    with Checkpoint(tmp_path, 0) as kept:
        kept.remove()
    assert {path.name for path in tmp_path.iterdir()} == {*others}


def test_a_save_that_fails_leaves_the_state_before(scene, saved, expected, tmp_path, monkeypatch):
    """At every file that is written."""
    from bfrt.checkpoint import state

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


@pytest.mark.parametrize("refused", ["unlink", "rmdir", "rename"])
def test_a_removal_that_the_system_refuses_once(scene, expected, tmp_path, monkeypatch, refused):
    """At each of its calls: a finished run leaves nothing all the same."""
    at, calls = 0, []
    call = getattr(os, refused)

    def refusing(*given, **how):
        calls.append(given)
        if len(calls) == at:
            raise OSError(errno.EIO, "refused")
        return call(*given, **how)

    monkeypatch.setattr(os, refused, refusing)
    for place in (1, 2):
        folder, at = tmp_path / "kept", 0
        with Checkpoint(folder, 0) as kept:
            kept.find({}, lambda _: None)
            for _ in range(2):
                kept.save(lambda writer: {"a": writer.put("b", [np.zeros(3)])})
            calls.clear()
            at = place
            kept.remove()
        assert not folder.exists()
        assert len(calls) > 1 or place == 2


def test_no_file_is_left_to_be_closed(tmp_path):
    """Nor where the work ends early, and where what is found is refused after a part of it."""
    given = scene_of(tmp_path / "a.bfrt", groups=1)
    scene, folder = tight(rows=5, rays=60, candidates=100)(given), tmp_path / "kept"
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always", ResourceWarning)
        expected = scene.render(**SETTINGS)
        with pytest.raises(Killed):
            scene.render(checkpoint=folder, every=0, progress=Band(3), **SETTINGS)
        (state,) = folder.iterdir()
        signed(state, lambda _, body: body["facts"].update(stats={}))
        with pytest.raises(CheckpointError):
            scene.render(checkpoint=folder, **SETTINGS)
        gc.collect()
    assert [str(each.message) for each in seen] == []
    same_picture(expected, given.render(**SETTINGS))


class Band:
    """Kills a run in a band."""

    def __init__(self, number):
        self.number = number

    def __call__(self, progress):
        if progress.band == self.number:
            raise Killed


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
    pace.saved(10**6, 2.0)  # a small one: much the same, whatever it holds
    now[0] += 99.0
    assert not pace.due(1)
    now[0] += 3.0
    assert pace.due(10**6) and not pace.due(10**7)
    pace.saved(10**9, 22.0)
    now[0] += 1099.0
    assert not pace.due(10**9)
    now[0] += 2.0
    assert pace.due(10**9) and not pace.due(2 * 10**9)
    assert Pace(0.0).due(10**12)
