"""Shards made by the workers of a cluster: the bytes that this process makes."""

from __future__ import annotations

import numpy as np
import pytest
from cluster_fixtures import NEEDED, cluster_of
from shard_files import ASKED, made_at, names_in, snapshots
from shard_workers import Killer, make_shard_at_last

import bfrt
from bfrt.conversion import by_workers
from bfrt.errors import BudgetError, Cancelled, SceneError, SettingError

pytest.importorskip("distributed", reason=NEEDED)


@pytest.fixture
def files(tmp_path):
    return snapshots(tmp_path)


def digests(scene):
    return [stream.files for stream in scene.store.streams]


def test_workers_make_the_same_shards(files, tmp_path, shared_client):
    here = bfrt.convert(files, tmp_path / "here.bfrts", **ASKED)
    found = bfrt.convert(files, tmp_path / "there.bfrts", client=shared_client, **ASKED)
    assert digests(found) == digests(here)
    assert names_in(tmp_path / "there.shards") == names_in(tmp_path / "here.shards")
    assert found.store.manifest.checksum == here.store.manifest.checksum
    before = {path: made_at(path) for path in (tmp_path / "there.shards").iterdir()}
    bfrt.convert(files, tmp_path / "there.bfrts", client=True, **ASKED)
    assert {path: made_at(path) for path in (tmp_path / "there.shards").iterdir()} == before


def test_relative_paths_are_the_clients(files, tmp_path, shared_client, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [file.name for file in files]
    found = bfrt.convert(names, "scene.bfrts", client=shared_client, shards=2, **ASKED)
    assert found.objects == 400


def test_a_bad_file_is_named_with_the_worker(files, tmp_path, shared_client):
    np.save(files[3], np.full((9, 3), np.nan))
    with pytest.raises(SceneError, match=rf"^worker \d \(.*\): {files[3]}: "):
        bfrt.convert(files, tmp_path / "scene.bfrts", client=shared_client, **ASKED)
    assert not (tmp_path / "scene.bfrts").exists()


def test_a_budget_beyond_the_workers_limit_is_refused(files, tmp_path, shared_client):
    with pytest.raises(BudgetError, match=r"found 8192MiB, expected \d+MiB or less: worker \d"):
        bfrt.convert(files, tmp_path / "a.bfrts", client=shared_client, memory="8GiB", **ASKED)


def test_a_store_is_made_by_one_process(files, tmp_path, shared_client):
    with pytest.raises(SettingError, match=r"client: found one for .*one\.bfrt, expected"):
        bfrt.convert(files, tmp_path / "one.bfrt", client=shared_client, **ASKED)


def test_progress_and_cancel(files, tmp_path, shared_client):
    told = []
    bfrt.convert(files, tmp_path / "a.bfrts", client=shared_client, progress=told.append, **ASKED)
    assert told[-1] == told[-1].total == sum(file.stat().st_size for file in files)
    with pytest.raises(Cancelled):
        bfrt.convert(
            files, tmp_path / "b.bfrts", client=shared_client, progress=lambda _: False, **ASKED
        )
    assert not (tmp_path / "b.bfrts").exists()


def test_a_killed_worker_is_replaced(files, tmp_path, monkeypatch):
    here = bfrt.convert(files, tmp_path / "here.bfrts", **ASKED)
    monkeypatch.setattr(by_workers, "make_shard", make_shard_at_last)
    with cluster_of(2) as client:
        killer = Killer(tmp_path / "note")
        killer.start()
        found = bfrt.convert(files, tmp_path / "there.bfrts", client=client, **ASKED)
        killer.join()
    assert killer.killed
    assert digests(found) == digests(here)
