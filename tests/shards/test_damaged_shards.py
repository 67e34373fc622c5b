"""A shard that cannot be read ends the work with a sentence that names worker and path."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from cluster_fixtures import NEEDED
from sharded_scenes import both, rays

import bfrt
from bfrt.errors import BfrtError, StoreError

pytest.importorskip("distributed", reason=NEEDED)

SMALL = {"memory": "160MiB", "threads": 1, "refine": "base"}


def halve(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def forbid(path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    path.chmod(0)


#: What is done to a shard, and what is said of it behind its path.
DAMAGES = {
    "absent": (shutil.rmtree, r": not a scene store: expected a directory with scene\.json"),
    "forbidden": (forbid, r".*Permission denied"),
    "no table": (lambda path: (path / "scene.json").write_text("{"), r".*"),
    "half a table": (lambda path: halve(path / "scene.json"), r".*"),
    "half a file": (lambda path: halve(a_file_of(path)), r"/.*: found \d+ bytes, expected \d+"),
    "no file": (lambda path: a_file_of(path).unlink(), r"/.*"),
}


def a_file_of(path: Path) -> Path:
    return max(path.rglob("*geometry*"), key=lambda file: file.stat().st_size)


@pytest.fixture(params=DAMAGES)
def damage(request):
    return DAMAGES[request.param]


def test_a_shard_that_is_damaged_before(tmp_path, shared_client, damage):
    """Opening with a client ends with it, and so does a render by workers that open all shards."""
    _, sharded = both(tmp_path, 3)
    change, said = damage
    path = tmp_path / "part1.bfrt"
    change(path)
    with pytest.raises(BfrtError, match=rf"^tcp:\S+: shard 1 cannot be opened: {path}{said}"):
        bfrt.open(sharded.path, client=shared_client)
    with pytest.raises(BfrtError, match=rf"^worker \d \(tcp:\S+\): {path}{said}"):
        sharded.render(client=shared_client, **SMALL)


@pytest.mark.parametrize("ask", ["render", "cast_rays"])
def test_a_shard_that_is_damaged_meanwhile(tmp_path, shared_client, ask):
    """After the scene was opened: it is the worker that reads it which says so."""
    _, sharded = both(tmp_path, 3)
    far = bfrt.open(sharded.path, client=shared_client)
    halve(a_file_of(tmp_path / "part1.bfrt"))
    given = rays() if ask == "cast_rays" else ()
    with pytest.raises(StoreError, match=rf"^worker \d \(tcp:\S+\): {tmp_path}/part1\.bfrt/.*"):
        getattr(far, ask)(*given, **SMALL)
