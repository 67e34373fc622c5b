"""Conversion to shards: the groups of one conversion of all files, one store or several each."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
from ply_files import mesh as ply_mesh
from shard_files import ASKED, FAR, made_at, names_in, rays_here, snapshots
from sharded_scenes import SMALL, assert_same_answer, assert_same_picture

import bfrt
from bfrt.cli import main
from bfrt.conversion import sharding
from bfrt.errors import BfrtError, Cancelled, SceneError, SettingError


@pytest.fixture
def files(tmp_path):
    return snapshots(tmp_path)


@pytest.mark.parametrize("shards", [None, 1, 2, 4])
@pytest.mark.parametrize("order", ["given", "spatial"])
def test_files_become_the_scene_of_one_store(files, tmp_path, shards, order):
    one = bfrt.convert(files, tmp_path / "one.bfrt", order=order, **ASKED)
    found = bfrt.convert(files, tmp_path / "scene.bfrts", order=order, shards=shards, **ASKED)
    assert found.origin == one.origin != (0.0, 0.0, 0.0)
    assert found.geometries == one.geometries
    assert len(found.store.stores) == (shards or 5)
    assert_same_answer(found.cast_rays(*rays_here(), **SMALL), one.cast_rays(*rays_here(), **SMALL))
    for mine, others in zip(found.store.streams, one.store.streams, strict=True):
        assert mine.files == others.files  # the same bytes


def test_standard_scenes_become_shards(tmp_path):
    names = ["spd:balls:1", "spd:gears:1", "spd:teapot:2"]
    one = bfrt.convert(names, tmp_path / "one.bfrt", durable=False)
    found = bfrt.convert(names, tmp_path / "scene.bfrts", durable=False)
    camera = one.framing_camera(resolution=(40, 30))
    assert_same_picture(found.render(camera=camera, **SMALL), one.render(camera=camera, **SMALL))
    assert found.camera == one.camera
    assert found.lights == one.lights


def test_mixed_sources_keep_their_types(files, tmp_path):
    """A shard of standard scenes alone would be float32 around zero."""
    sources = [files[3], "spd:balls:1"]
    one = bfrt.convert(sources, tmp_path / "one.bfrt", **ASKED)
    found = bfrt.convert(sources, tmp_path / "scene.bfrts", **ASKED)
    assert found.origin == one.origin
    assert [s.wide for s in found.store.streams] == [s.wide for s in one.store.streams]
    assert [s.files for s in found.store.streams if not s.material_bytes] == [
        s.files for s in one.store.streams if not s.material_bytes
    ]


def test_shards_that_are_there_are_kept(files, tmp_path):
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    before = {path.name: made_at(path) for path in (tmp_path / "scene.shards").iterdir()}
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    folder = tmp_path / "scene.shards"
    assert {path.name: made_at(path) for path in folder.iterdir()} == before
    np.save(files[3], np.random.default_rng(9).uniform(-5, 5, (50, 3)) + FAR)
    changed = bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    after = {path.name: made_at(path) for path in folder.iterdir()}
    assert len(after) == len(before) == 10
    assert {name[:5] for name in before.keys() - after.keys()} == {"00003"}
    assert {name[:5] for name in after.keys() - before.keys()} == {"00003"}
    expected = bfrt.convert(files, tmp_path / "one.bfrt", **ASKED)
    assert_same_answer(
        changed.cast_rays(*rays_here(), **SMALL), expected.cast_rays(*rays_here(), **SMALL)
    )


def test_other_settings_make_other_shards(files, tmp_path):
    first = bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    names = names_in(tmp_path / "scene.shards")
    bfrt.convert(files, tmp_path / "scene.bfrts", **{**ASKED, "radius": 0.25})
    assert not set(names) & set(names_in(tmp_path / "scene.shards"))
    with pytest.raises(BfrtError, match=r"00000-.*: the store was removed while it was open"):
        first.cast_rays(*rays_here(), **SMALL)


def test_a_damaged_record_makes_the_shard_again(files, tmp_path):
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    folder = tmp_path / "scene.shards"
    stores = sorted(folder.glob("*.bfrt"))
    before = [made_at(store) for store in stores]
    stores[1].with_suffix(".json").write_text('{"known": [1]}')
    stores[2].with_suffix(".json").write_text("{")
    (stores[3] / "scene.json").write_text("{}")
    with pytest.raises(SettingError):  # what has no store's header is not ours to replace
        bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    shutil.rmtree(stores[3])
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED).verify()
    again = [made_at(store) != time for store, time in zip(stores, before, strict=True)]
    assert again == [False, True, True, True, False]


def test_what_else_is_in_the_folder_stays(files, tmp_path):
    folder = tmp_path / "scene.shards"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    (folder / "00009-0123456789abcdef.json").write_text("ours, of another time")
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    assert (folder / "notes.txt").read_text() == "mine"
    assert not (folder / "00009-0123456789abcdef.json").exists()


def test_a_bad_file_leaves_the_scene_as_it_was(files, tmp_path):
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    text = (tmp_path / "scene.bfrts").read_bytes()
    values = np.load(files[3])
    values[7, 1] = np.nan
    np.save(files[3], values)
    with pytest.raises(SceneError, match=rf"^{files[3]}: "):
        bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    assert (tmp_path / "scene.bfrts").read_bytes() == text
    bfrt.open(tmp_path / "scene.bfrts").verify()
    assert len(names_in(tmp_path / "scene.shards")) == 10


def test_nothing_is_left_of_a_first_conversion_that_fails_at_once(files, tmp_path):
    files[0].write_bytes(b"no numpy")
    with pytest.raises(BfrtError):
        bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    assert not (tmp_path / "scene.shards").exists()
    assert not (tmp_path / "scene.bfrts").exists()


def test_a_setting_that_one_file_uses_is_no_fault_of_the_others(files, tmp_path):
    mesh = tmp_path / "mesh.ply"
    mesh.write_bytes(ply_mesh())
    found = bfrt.convert([mesh, files[1]], tmp_path / "scene.bfrts", **ASKED)
    assert found.objects > 40
    for _ in range(2):
        with pytest.raises(SettingError, match=r"found radius=0\.5, expected none"):
            bfrt.convert([mesh, mesh], tmp_path / "other.bfrts", **ASKED)
        assert not (tmp_path / "other.shards").exists()


@pytest.mark.parametrize("shards", [0, 6, True, 2.0])
def test_other_numbers_of_shards_are_refused(files, tmp_path, shards):
    with pytest.raises(SettingError, match=r"shards: found .*, expected 1 to 5"):
        bfrt.convert(files, tmp_path / "scene.bfrts", shards=shards, **ASKED)


def test_shards_need_the_suffix(files, tmp_path):
    with pytest.raises(SettingError, match=r"one\.bfrt, expected a target with suffix \.bfrts"):
        bfrt.convert(files, tmp_path / "one.bfrt", shards=2, **ASKED)


def test_a_checkpoint_and_a_pipe_are_refused(files, tmp_path):
    with pytest.raises(SettingError, match="checkpoint: found one for a sharded scene"):
        bfrt.convert(files, tmp_path / "a.bfrts", checkpoint=tmp_path / "state", **ASKED)
    with pytest.raises(SettingError, match="found - among the sources, expected files"):
        bfrt.convert("-", tmp_path / "a.bfrts", durable=False)


def test_progress_counts_the_bytes_of_all_files(files, tmp_path):
    told = []
    bfrt.convert(files, tmp_path / "scene.bfrts", progress=told.append, **ASKED)
    read = [int(done) for done in told if done.stage == "reading"]
    sizes = [file.stat().st_size for file in files]
    assert read[-1] == max(read) == sum(sizes)
    assert {done.total for done in told if done.stage == "reading"} == {sum(sizes)}
    assert {sum(sizes[: n + 1]) for n in range(5)} <= set(read)  # where each file ends


def test_cancelled_work_goes_on(files, tmp_path):
    def cancel(done):
        return not (done.stage == "reading" and done > 3000)

    with pytest.raises(Cancelled):
        bfrt.convert(files, tmp_path / "scene.bfrts", progress=cancel, **ASKED)
    before = names_in(tmp_path / "scene.shards")
    assert 0 < len(before) < 10
    assert not (tmp_path / "scene.bfrts").exists()
    bfrt.convert(files, tmp_path / "scene.bfrts", **ASKED)
    assert set(before) < set(names_in(tmp_path / "scene.shards"))


KILLED = """
import os, signal, sys
import bfrt
from bfrt.conversion import sharding

make = sharding.write_parts
def killed(path, parts):
    make(path, parts)
    if path.name.startswith("00002-"):
        os.kill(os.getpid(), signal.SIGKILL)
sharding.write_parts = killed
bfrt.convert(sys.argv[2:], sys.argv[1], radius=0.5, durable=False)
"""


def test_killed_work_goes_on(files, tmp_path):
    target = tmp_path / "scene.bfrts"
    command = [sys.executable, "-c", KILLED, target, *files]
    killed = subprocess.run(command, cwd=tmp_path)  # away from the sources
    assert killed.returncode == -signal.SIGKILL
    kept = {path.name: made_at(path) for path in (tmp_path / "scene.shards").glob("*.bfrt")}
    assert sorted(name[:5] for name in kept) == ["00000", "00001", "00002"]
    found = bfrt.convert(files, target, **ASKED)
    after = {path.name: made_at(path) for path in (tmp_path / "scene.shards").iterdir()}
    assert kept.items() <= after.items()
    one = bfrt.convert(files, tmp_path / "one.bfrt", **ASKED)
    assert_same_answer(found.cast_rays(*rays_here(), **SMALL), one.cast_rays(*rays_here(), **SMALL))


def test_the_command_makes_and_shows_shards(files, tmp_path, capsys):
    target = tmp_path / "scene.bfrts"
    names = [str(file) for file in files]
    assert main(["convert", *names, "-o", str(target), "--radius", "0.5", "--shards", "3"]) == 0
    assert len(json.loads(target.read_text())["shards"]) == 3
    capsys.readouterr()
    assert main(["info", str(target), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["store"] == str(target)
    assert facts["objects"] == 400
    assert main(["verify", str(target)]) == 0
    assert main(["render", str(target), "-o", str(tmp_path / "a.exr"), "--memory", "160MiB"]) == 0


def test_the_record_names_the_sources(files, tmp_path):
    bfrt.convert(files, tmp_path / "scene.bfrts", shards=2, **ASKED)
    records = sorted((tmp_path / "scene.shards").glob("*.json"))
    told = [json.loads(record.read_text()) for record in records]
    assert [[s["path"] for s in each["sources"]] for each in told] == [
        [str(file) for file in files[:2]], [str(file) for file in files[2:]]
    ]  # fmt: skip
    assert "radius" in told[1]["known"]
    assert sharding.NAMED.fullmatch(records[0].name)
