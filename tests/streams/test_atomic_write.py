"""A file written aside exists whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from bfrt.errors import DiskFullError, SettingError, StreamError
from bfrt.streams import atomic_write
from bfrt.streams.atomic_write import atomic_path, atomic_paths, put
from bfrt.streams.exchange import exchange


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_file_appears_at_the_end_only(tmp_path):
    target = tmp_path / "a.bin"
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        temporary.write_bytes(b"new")
        assert not target.exists()
    assert target.read_bytes() == b"new"
    assert names(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path, error):
    target = tmp_path / "a.bin"
    target.write_bytes(b"old")
    with pytest.raises(error), atomic_path(target) as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert target.read_bytes() == b"old"
    assert names(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("old", ["", "a", "c", "ab", "abc"])
@pytest.mark.parametrize("named", range(4))
def test_several_files_have_their_names_or_none_has(tmp_path, monkeypatch, named, old):
    """What they take the place of comes back; those that all have their names stay."""
    targets = [tmp_path / name for name in "abc"]
    for name in old:
        (tmp_path / name).write_bytes(b"old")
    done = []

    def interrupted(call):
        def called(path, target):
            if len(done) == named:
                done.append(None)  # what is undone is not interrupted
                raise KeyboardInterrupt
            made = call(path, target)
            done.append(target)
            if done == targets:
                raise KeyboardInterrupt
            return made

        return called

    monkeypatch.setattr(Path, "replace", interrupted(Path.replace))
    monkeypatch.setattr(atomic_write, "exchange", interrupted(exchange))
    with pytest.raises(KeyboardInterrupt), atomic_paths(targets) as paths:
        for path in paths:
            path.write_bytes(b"new")
    found = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert found == dict.fromkeys("abc" if named == 3 else old, b"new" if named == 3 else b"old")


def test_without_exchanges_a_file_that_was_replaced_is_gone_where_another_fails(
    tmp_path, monkeypatch
):
    """It is not half there, as documented: some systems cannot exchange names."""
    targets = [tmp_path / name for name in "ab"]
    targets[0].write_bytes(b"old")
    monkeypatch.setattr(atomic_write, "exchange", lambda *_: False)
    with pytest.raises(StreamError, match="renaming to it"), atomic_paths(targets) as paths:
        targets[1].mkdir()
        (targets[1] / "x").touch()
    assert names(tmp_path) == ["b"] and len(paths) == 2


def test_files_of_which_one_is_gone_leave_the_old_ones(tmp_path):
    targets = [tmp_path / name for name in "ab"]
    for target in targets:
        target.write_bytes(b"old")
    with pytest.raises(StreamError, match="syncing"), atomic_paths(targets) as paths:
        paths[1].unlink()
    assert names(tmp_path) == ["a", "b"]


def test_a_path_with_a_nul(tmp_path):
    with (
        pytest.raises(SettingError, match=r"output: found .*, expected a path without NUL"),
        atomic_path(f"{tmp_path}/a\0"),
    ):
        pytest.fail("it was created")


def test_failure_after_the_temporary_file_is_gone_keeps_its_own_error(tmp_path):
    with pytest.raises(RuntimeError, match="mine"), atomic_path(tmp_path / "a.bin") as temporary:
        temporary.unlink()
        raise RuntimeError("mine")


def test_file_and_folder_are_synced_in_this_order(tmp_path, monkeypatch):
    synced = []

    def record(descriptor):
        is_folder = stat.S_ISDIR(os.fstat(descriptor).st_mode)
        synced.append(("folder" if is_folder else "file", names(tmp_path)))

    monkeypatch.setattr(os, "fsync", record)
    with atomic_path(tmp_path / "a.bin") as temporary:
        name = temporary.name
    assert synced[0] == ("file", [name])
    assert synced[1:] == ([("folder", ["a.bin"])] if hasattr(os, "O_DIRECTORY") else [])


def test_disk_full_at_sync(tmp_path, monkeypatch):
    def refuse(descriptor):
        raise OSError(errno.ENOSPC, "no")

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(DiskFullError), atomic_path(tmp_path / "a.bin"):
        pass
    assert names(tmp_path) == []


def test_disk_full_found_at_close(tmp_path):
    with pytest.raises(DiskFullError, match=r"a\.bin: writing"), atomic_path(tmp_path / "a.bin"):
        raise OSError(errno.ENOSPC, "no")
    assert names(tmp_path) == []


def test_other_errors_of_the_block_stay_themselves(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a.bin"):
        (tmp_path / "input").read_bytes()


def test_refused_rename(tmp_path):
    target = tmp_path / "a.bin"
    with pytest.raises(StreamError, match=r"a\.bin: renaming to it"), atomic_path(target):
        (target / "inside").mkdir(parents=True)
    assert names(tmp_path) == ["a.bin"]


def test_folder_is_refused_before_the_work(tmp_path):
    with pytest.raises(SettingError, match="expected a file or nothing"), atomic_path(tmp_path):
        pytest.fail("the block ran")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_pipe_is_refused_and_kept(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(SettingError), atomic_path(pipe):
        pytest.fail("the block ran")
    assert pipe.is_fifo()


def test_missing_folder(tmp_path):
    target = tmp_path / "none" / "a.bin"
    with pytest.raises(StreamError, match="creating") as caught, atomic_path(target):
        pytest.fail("the block ran")
    assert caught.value.errno == errno.ENOENT


def test_link_stays_a_link(tmp_path):
    folder = tmp_path / "there"
    folder.mkdir()
    link = tmp_path / "link.bin"
    try:
        link.symlink_to(folder / "a.bin")
    except OSError:
        pytest.skip("no symbolic links here")
    with atomic_path(link) as temporary:
        temporary.write_bytes(b"new")
    assert link.is_symlink()
    assert (folder / "a.bin").read_bytes() == b"new"


def test_longest_name(tmp_path):
    target = tmp_path / ("é" * 100 + ".bin")
    with atomic_path(target):
        pass
    assert names(tmp_path) == [target.name]


@pytest.mark.skipif(os.name == "nt", reason="no permission bits here")
def test_permissions_are_those_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    with atomic_path(tmp_path / "a.bin"):
        pass
    assert (tmp_path / "a.bin").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_two_writers_of_one_file_do_not_meet(tmp_path):
    target = tmp_path / "a.bin"
    with atomic_path(target) as first, atomic_path(target) as second:
        assert first != second
        first.write_bytes(b"first")
        second.write_bytes(b"second")
    assert target.read_bytes() == b"first"


def test_put_goes_on_after_a_partial_write(tmp_path):
    class Slow:
        written = b""

        def write(self, data):
            self.written += bytes(data[:3])
            return min(3, len(data))

    file = Slow()
    put(file, b"0123456789", tmp_path)
    assert file.written == b"0123456789"


def test_put_names_the_offset():
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full here")
    with full.open("wb", buffering=0) as file, pytest.raises(DiskFullError) as caught:
        put(file, b"x", "target")
    assert str(caught.value).startswith("target: writing at byte 0")
