"""Marks of a read-only store lie where only the user writes, and nobody else's are believed."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from pathlib import Path

import numpy as np
import pytest

import bfrt
from bfrt.errors import SettingError, StoreError, StreamError
from bfrt.grid import marks_home
from bfrt.grid.marks import verify_marks
from bfrt.grid.marks_home import home_in, marks_path, stale
from bfrt.streams import private_folder
from bfrt.streams.private_folder import cache_folder, make_private

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no owners of files here")

ROOT_ONLY = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away"
)
SETTINGS = {"memory": "128MiB", "threads": 1, "refine": "sgb"}
RAYS = np.array([[0.0, 0, -9], [0.4, 0, -9]]), np.array([[0.0, 0, 1], [0, 0, 1]])


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The user's cache, which is not there yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "bfrt"


@pytest.fixture
def scene(tmp_path, monkeypatch, cache):
    """A scene whose store is read-only, for root too."""
    with bfrt.SceneWriter(tmp_path / "there" / "a.bfrt", order="given") as writer:
        writer.spheres(np.zeros((2, 3), np.float32), [1.0, 0.5])
    real = os.access
    monkeypatch.setattr(
        marks_home.os, "access", lambda path, how: "there" not in str(path) and real(path, how)
    )
    return bfrt.open(tmp_path / "there" / "a.bfrt")


def cast(scene, **settings):
    """Whether the marks were there."""
    with bfrt.open(scene.path) as opened:
        answer = opened.cast_rays(*RAYS, **SETTINGS, **settings)
    np.testing.assert_array_equal(answer["t_hit"], [8, np.float64(9 - 0.84**0.5)])
    return answer.stats.marks_reused


def path_of(scene, scratch=None):
    return marks_path(scene.store, scene.store.groups[0], scratch)


def test_they_lie_in_the_users_cache(scene, cache):
    path = path_of(scene)
    assert path == cache / f"a.bfrt-{scene.store.checksum:08x}" / "0.marks"
    assert not bfrt.plan(scene, **SETTINGS).marks_reused
    assert not cache.exists()  # a plan writes nothing
    assert not cast(scene)
    assert cast(scene) and bfrt.plan(scene, **SETTINGS).marks_reused
    assert [stat.S_IMODE(each.stat().st_mode) for each in (cache, path.parent, path)] == [
        0o700, 0o700, 0o600,
    ]  # fmt: skip
    assert (path.parent / "store").read_text() == str(scene.path)
    assert sorted(each.name for each in path.parent.iterdir()) == ["0.marks", "store"]


def test_they_lie_in_the_scratch_folder_that_is_asked_for(scene, cache, tmp_path):
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    assert not cast(scene, scratch=scratch)
    assert cast(scene, scratch=scratch)
    assert not cache.exists()
    assert [each.name for each in scratch.iterdir()] == [f"bfrt-{os.geteuid()}"]
    assert path_of(scene, scratch).is_file()


def test_the_cache_is_in_the_home_where_nothing_else_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    for named in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", named)
        assert cache_folder() == tmp_path / ".cache" / "bfrt"


def test_a_user_without_a_home(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)

    def none():
        raise RuntimeError

    monkeypatch.setattr(private_folder.Path, "home", none)
    with pytest.raises(SettingError, match="marks: found no home"):
        cache_folder()


@pytest.mark.parametrize("what", ["home", "folder", "marks"])
@pytest.mark.parametrize("fault", ["writable", "linked", pytest.param("given", marks=ROOT_ONLY)])
def test_what_is_not_ours_alone_is_not_believed(scene, cache, tmp_path, what, fault):
    cast(scene)
    marks = path_of(scene)
    path = {"home": cache, "folder": marks.parent, "marks": marks}[what]
    if fault == "writable":
        path.chmod(0o777 if path.is_dir() else 0o622)
    elif fault == "given":
        os.chown(path, 12345, -1)
    else:
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    assert not bfrt.plan(scene, **SETTINGS).marks_reused
    if what == "marks":  # made anew, in its place
        before = (tmp_path / "elsewhere").read_bytes() if fault == "linked" else b""
        assert not cast(scene)
        assert cast(scene)
        assert not path.is_symlink() and path.stat().st_uid == os.geteuid()
        assert fault != "linked" or (tmp_path / "elsewhere").read_bytes() == before
    else:
        with pytest.raises(SettingError, match=r"found something else than a folder that is ours"):
            cast(scene)


@pytest.mark.parametrize("fresh", [True, False])
def test_a_link_in_their_place_loses_nobody_a_file(scene, cache, tmp_path, fresh):
    victim = tmp_path / "victim"
    victim.write_bytes(b"mine")
    path = path_of(scene)
    make_private(cache)
    make_private(path.parent)
    for name in ("0.marks", "store"):
        (path.parent / name).symlink_to(victim)
    assert not cast(scene, fresh_marks=fresh)
    assert victim.read_bytes() == b"mine"
    assert not path.is_symlink()
    assert cast(scene)


def test_a_link_to_nothing_in_their_place_makes_nothing(scene, cache, tmp_path):
    path = path_of(scene)
    make_private(cache)
    make_private(path.parent)
    path.symlink_to(tmp_path / "made")
    assert not cast(scene)
    assert not (tmp_path / "made").exists()


def test_nothing_is_put_into_the_shared_temporary_folder(scene, tmp_path, monkeypatch):
    shared = tmp_path / "shared"
    shared.mkdir()
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(shared))
    cast(scene)
    assert list(shared.iterdir()) == []


def test_a_link_in_a_store_is_not_followed(tmp_path):
    with bfrt.SceneWriter(tmp_path / "a.bfrt", order="given") as writer:
        writer.spheres(np.zeros((2, 3), np.float32), [1.0, 0.5])
    scene = bfrt.open(tmp_path / "a.bfrt")
    cast(scene)
    path = scene.path / "0" / "marks"
    made = path.read_bytes()
    path.rename(tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    verify_marks(scene.store, scene.store.groups[0])
    assert not cast(scene)
    assert cast(scene) and not path.is_symlink()
    assert path.read_bytes() == made == (tmp_path / "elsewhere").read_bytes()


def test_damage_is_told_as_in_a_store(scene):
    cast(scene)
    path = path_of(scene)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(StoreError, match="the marks are damaged"):
        cast(scene)
    assert not cast(scene, fresh_marks=True)
    assert cast(scene)


def test_a_file_in_the_place_of_the_folder(scene, cache):
    cache.parent.mkdir()
    cache.write_bytes(b"mine")
    with pytest.raises(SettingError, match="something else than a folder"):
        cast(scene)
    assert cache.read_bytes() == b"mine"


def test_stale_ones_are_those_without_their_store(scene, cache, tmp_path):
    assert list(stale(cache)) == []
    cast(scene)
    (cache / "mine").mkdir()
    assert list(stale(cache)) == []
    kept = tmp_path / "kept"
    shutil.copytree(scene.path, kept)
    with bfrt.SceneWriter(scene.path, order="given") as writer:
        writer.spheres(np.zeros((1, 3), np.float32), 1.0)
    assert list(stale(cache)) == [path_of(scene).parent]
    shutil.rmtree(scene.path)
    kept.rename(scene.path)
    assert list(stale(cache)) == []
    shutil.rmtree(scene.path)
    assert list(stale(cache)) == [path_of(scene).parent]
    cache.chmod(0o777)
    assert list(stale(cache)) == []


def test_a_store_that_the_system_refuses_to_read_may_be_there(scene, cache, monkeypatch):
    cast(scene)

    def refuse(path):
        raise StreamError(path, 0, errno.EIO, "opening")

    monkeypatch.setattr("bfrt.grid.marks_home.open_any", refuse)
    assert list(stale(cache)) == []


def test_a_scratch_folder_has_a_home_for_each_user():
    assert home_in(Path("/x")) == Path(f"/x/bfrt-{os.geteuid()}")
