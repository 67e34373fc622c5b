"""A shard that cannot be read ends the work with a sentence that names worker and path."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest
from cluster_fixtures import NEEDED, cluster_of
from sharded_scenes import both, rays

import bfrt
from bfrt.errors import StoreError

pytest.importorskip("distributed", reason=NEEDED)

SMALL = {"memory": "160MiB", "threads": 1, "refine": "base"}


def halve(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


NOBODY = 65534

NO_TABLE = r"/scene\.json: not a scene store: expected a header of bfrt"

#: What is done to a shard, and what is said of it behind its path.
DAMAGES = {
    "absent": (shutil.rmtree, r": not a scene store: expected a directory with scene\.json"),
    "no table": (lambda path: (path / "scene.json").write_text("{"), NO_TABLE),
    "half a table": (lambda path: halve(path / "scene.json"), NO_TABLE),
    "half a file": (
        lambda path: halve(a_file_of(path)),
        r"/\S+: found \d+ bytes, expected \d+: the store is trunc",
    ),
    "no file": (lambda path: a_file_of(path).unlink(), r"/\S+: the file is missing: exp"),
}


def a_file_of(path: Path) -> Path:
    return max(path.rglob("*geometry*"), key=lambda file: file.stat().st_size)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with a sound scene of three shards, with marks."""
    folder = tmp_path_factory.mktemp("whole")
    both(folder, 3).sharded.render(camera=bfrt.Camera((0, 2, 16), (0, 0, 0), resolution=(2, 2)))
    return folder


@pytest.fixture
def scene(whole, tmp_path):
    """The path of a copy of it."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    return tmp_path / "scene.bfrts"


@pytest.fixture(params=DAMAGES)
def damage(request):
    return DAMAGES[request.param]


def test_a_shard_that_is_damaged_before(scene, tmp_path, shared_client, damage):
    """Opening with a client ends with it, and so does a render by workers that open all shards."""
    change, said = damage
    sharded = bfrt.open(scene)
    path = tmp_path / "part1.bfrt"
    change(path)
    with pytest.raises(StoreError, match=rf"^tcp:\S+: shard 1 cannot be opened: {path}{said}"):
        bfrt.open(scene, client=shared_client)
    with pytest.raises(StoreError, match=rf"^worker \d \(tcp:\S+\): {path}{said}"):
        sharded.render(client=shared_client, **SMALL)


@contextmanager
def not_root():
    """Act as somebody who may not read everything."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.mark.skipif(sys.platform != "linux", reason="threads share a user here alone")
def test_a_shard_that_may_not_be_read(whole):
    with tempfile.TemporaryDirectory() as name, cluster_of(1, processes=False) as client:
        folder = Path(name)
        shutil.copytree(whole, folder, dirs_exist_ok=True)
        folder.chmod(0o755)  # all may come as far as this
        (folder / "part1.bfrt").chmod(0)
        said = rf"shard 1 cannot be opened: .*{folder}/part1\.bfrt"
        with not_root(), pytest.raises(StoreError, match=rf"^\S+: {said}") as caught:
            bfrt.open(folder / "scene.bfrts", client=client)
        (folder / "part1.bfrt").chmod(0o755)
    assert "ermission denied" in str(caught.value)


@pytest.mark.parametrize("ask", ["render", "cast_rays"])
def test_a_shard_that_is_damaged_meanwhile(scene, tmp_path, shared_client, ask):
    """After the scene was opened: it is the worker that reads it which says so."""
    far = bfrt.open(scene, client=shared_client)
    halve(a_file_of(tmp_path / "part1.bfrt"))
    given = rays() if ask == "cast_rays" else ()
    with pytest.raises(
        StoreError, match=rf"^worker \d \(tcp:\S+\): {tmp_path}/part1\.bfrt/\S+: found"
    ):
        getattr(far, ask)(*given, **SMALL)
