"""``bfrt clean`` removes what killed runs left, tells it, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

import bfrt
from bfrt.cli import main
from bfrt.grid import marks_home
from bfrt.paths import HEADER, MAGIC
from bfrt.streams import litter

pytest.importorskip("fcntl", reason="no locks of this sort here")

MARK = "bfrt-0123456789abcdef"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "bfrt"


@pytest.fixture
def folder(tmp_path, cache):
    """A folder with a store and what killed runs left there: 3 + 5 + 7 + 11 bytes."""
    folder = tmp_path / "work"
    with bfrt.SceneWriter(folder / "a.bfrt") as writer:
        writer.spheres(np.zeros((1, 3), np.float32), 1.0)
    (folder / "a.png").write_bytes(b"mine")
    (folder / ".hidden.tmp").write_bytes(b"mine")
    (folder / f".a.png.{MARK}.tmp").write_bytes(b"x" * 3)
    (folder / f".b.bfrt.{MARK}.part" / "0").mkdir(parents=True)
    (folder / f".b.bfrt.{MARK}.part" / "0" / "boxes").write_bytes(b"x" * 5)
    (folder / "a.bfrt" / f".x.{MARK}.tmp").write_bytes(b"x" * 7)
    (folder / "a.bfrt" / "0" / f".marks.{MARK}.tmp").write_bytes(b"x" * 11)
    return folder


def contents(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_it_is_removed_in_the_folder_and_in_its_stores(folder):
    before = contents(folder)
    found = bfrt.clean(folder, dry_run=True)
    assert contents(folder) == before
    assert bfrt.clean(folder) == found
    assert [left.bytes for left in found] == [3, 5, 7, 11]
    stems = [left.path.name.split(".bfrt-")[0] for left in found]
    assert stems == [".a.png", ".b.bfrt", ".x", ".marks"]
    assert contents(folder) == [path for path in before if MARK not in path]
    bfrt.open(folder / "a.bfrt").verify()
    assert bfrt.clean(folder) == []


def test_a_store_may_be_given(folder):
    assert [left.bytes for left in bfrt.clean(folder / "a.bfrt")] == [7, 11]


def test_the_command_tells_each_and_the_sum(folder, capsys):
    said = [
        f"{folder}/.a.png.{MARK}.tmp: 3 bytes",
        f"{folder}/.b.bfrt.{MARK}.part: 5 bytes",
        f"{folder}/a.bfrt/.x.{MARK}.tmp: 7 bytes",
        f"{folder}/a.bfrt/0/.marks.{MARK}.tmp: 11 bytes",
    ]
    assert main(["clean", str(folder), "--dry-run"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        *said, f"{folder}: 4 things, 26 bytes would be removed"
    ]  # fmt: skip
    assert main(["clean", str(folder)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        *said, f"{folder}: 4 things, 26 bytes removed"
    ]  # fmt: skip
    assert main(["clean", str(folder)]) == 0
    assert capsys.readouterr().out == f"{folder}: found nothing that a killed run left\n"
    assert main(["clean", str(folder), "--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", ["none", "file"])
def test_what_is_no_folder_is_wrong_use(tmp_path, capsys, name):
    (tmp_path / "file").write_bytes(b"")
    assert main(["clean", str(tmp_path / name)]) == 2
    assert "expected a folder that is there" in capsys.readouterr().err


def test_links_are_not_followed(folder, tmp_path):
    link = tmp_path / "other"
    link.mkdir()
    (link / "a").symlink_to(folder / "a.bfrt")
    assert bfrt.clean(link) == []


def test_marks_go_whose_store_is_gone(folder, cache, tmp_path, monkeypatch):
    bfrt.clean(folder)
    monkeypatch.setattr(marks_home.os, "access", lambda *_: False)
    rays = np.zeros((1, 3)), np.ones((1, 3))
    scene = bfrt.open(folder / "a.bfrt")
    scene.cast_rays(*rays, memory="128MiB", refine="sgb")
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache.parent))
    (home,) = cache.iterdir()
    (home / f".0.marks.{MARK}.tmp").write_bytes(b"x" * 9)
    assert [left.bytes for left in bfrt.clean(tmp_path)] == [9]
    assert home.is_dir()
    (folder / "a.bfrt").rename(folder / "b.bfrt")
    size = sum(file.stat().st_size for file in home.iterdir())
    assert bfrt.clean(folder, dry_run=True) == bfrt.clean(folder) == [bfrt.Litter(home, size)]
    assert list(cache.iterdir()) == []


def test_a_store_whose_replacement_ended_half_way_gets_its_name_back(folder):
    store, old = folder / "a.bfrt", folder / f".a.bfrt.{MARK}.old"
    bfrt.clean(folder)
    new = old.with_suffix(".part")
    store.rename(new)
    old.mkdir()
    (old / HEADER).write_text(f'{{"magic": "{MAGIC}"}}')
    found = bfrt.clean(store)  # by its name, where nothing is
    assert found == []
    bfrt.open(store).verify()
    assert [left.path for left in bfrt.clean(folder)] == [old]
    assert not new.exists()


@pytest.mark.parametrize("how", ["open", "convert", "render"])
def test_the_next_run_does_so_too(folder, how):
    store, old = folder / "a.bfrt", folder / f".a.bfrt.{MARK}.old"
    store.rename(old.with_suffix(".part"))
    old.mkdir()
    litter._swept.clear()  # as of another process
    if how == "open":
        assert bfrt.open(store).objects == 1
    elif how == "convert":
        assert bfrt.convert("spd:tetra:1", store).objects == 4
        assert not [path for path in contents(folder) if MARK in path]
    else:
        picture = str(folder / "x.png")
        assert main(["render", str(store), "-o", picture, "--memory", "128MiB", "--quiet"]) == 0
    bfrt.clean(folder)
    bfrt.open(store).verify()
    assert not [path for path in contents(folder) if MARK in path]
