"""What a process leaves is removed when it has ended, and never before."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from bfrt.errors import StreamError
from bfrt.paths import HEADER, MAGIC
from bfrt.streams import atomic_write, litter, ownership
from bfrt.streams.atomic_write import atomic_path, nameless, temporary_folder
from bfrt.streams.litter import claimed, clear, restore, sweep
from bfrt.streams.ownership import (
    FILE,
    FOLDER,
    TemporaryName,
    create_file,
    create_folder,
    parsed,
    stem_of,
)

fcntl = pytest.importorskip("fcntl", reason="no locks of this sort here")

NUMBER = "0123456789abcdef"


@pytest.fixture(autouse=True)
def unswept():
    """No folder was swept a moment ago."""
    litter._swept.clear()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def left(folder, name="a.png", kind=FILE, number=NUMBER, size=3):
    """A thing as a killed process leaves it."""
    path = folder / str(TemporaryName(stem_of(name), number, kind))
    if kind == FILE:
        path.write_bytes(b"x" * size)
    else:
        path.mkdir()
        (path / "geometry").write_bytes(b"x" * size)
    return path


def marked(folder):
    (folder / HEADER).write_text(f'{{"magic": "{MAGIC}"}}')


@pytest.mark.parametrize("name", ["a", "a.b.png", ".a", "é" * 100, "a" * 201, "a\nb", "x" * 250])
@pytest.mark.parametrize("kind", ["tmp", "part", "old"])
def test_names_are_parsed_as_they_are_made(name, kind):
    made = TemporaryName(stem_of(name), NUMBER, kind)
    assert parsed(str(made)) == made
    assert len(os.fsencode(str(made))) < 255
    assert (made.stem == name) == (len(os.fsencode(name)) <= 200)


def test_long_names_that_begin_alike_differ():
    assert stem_of("a" * 220) != stem_of("a" * 221)


@pytest.mark.parametrize(
    "name",
    [
        "a.png", ".a.png", f".a.{NUMBER}.tmp", f"a.bfrt-{NUMBER}.tmp", f".bfrt-{NUMBER}.tmp",
        f".a.bfrt-{NUMBER}.tmpx", f".a.bfrt-{NUMBER[:-1]}.tmp", f".a.bfrt-{NUMBER.upper()}.tmp",
        f".a.bfrt-{NUMBER}.part.bak", f"..bfrt-{NUMBER}0.part", ".a.bfrt-.tmp",
    ],
)  # fmt: skip
def test_other_names_are_nobodys_litter(tmp_path, name):
    (tmp_path / name).write_bytes(b"mine")
    assert parsed(name) is None
    assert clear(tmp_path) == []
    assert names(tmp_path) == [name]


def test_litter_is_removed_and_told(tmp_path):
    file, folder = left(tmp_path), left(tmp_path, "s.bfrt", FOLDER, size=5)
    (tmp_path / "a.png").write_bytes(b"mine")
    found = [(file, 3), (folder, 5)]
    assert clear(tmp_path, dry=True) == found
    assert len(names(tmp_path)) == 3
    assert clear(tmp_path) == found
    assert names(tmp_path) == ["a.png"]
    assert clear(tmp_path) == []


@pytest.mark.parametrize("create", [create_file, create_folder])
def test_what_is_in_use_stays(tmp_path, create):
    owned = create(tmp_path / "a")
    assert clear(tmp_path) == []
    assert owned.path.exists()
    os.close(owned.descriptor)  # as when the process ends
    owned.descriptor = -1
    assert [found.path for found in clear(tmp_path)] == [owned.path]


HOLDER = """
import sys
from pathlib import Path
from bfrt.streams.ownership import create_file, create_folder
held = create_file(Path(sys.argv[1]) / "a"), create_folder(Path(sys.argv[1]) / "b")
print("held", flush=True)
sys.stdin.read()
"""


def test_what_another_process_uses_stays_until_that_is_killed(tmp_path):
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=tmp_path,
    )
    assert holder.stdout.readline() == b"held\n"
    assert clear(tmp_path) == []
    holder.kill()
    holder.communicate()
    assert len(clear(tmp_path)) == 2
    assert names(tmp_path) == []


def test_a_fork_that_lives_on_owns_it_too(tmp_path):
    owned = create_file(tmp_path / "a")
    read, write = os.pipe()
    child = os.fork()
    if not child:
        os.close(write)
        os.read(read, 1)
        litter.remove_own()  # of the parent: not the child's to remove
        os._exit(0)
    os.close(owned.descriptor)
    owned.descriptor = -1
    assert clear(tmp_path) == []
    os.write(write, b"x")
    os.waitpid(child, 0)
    assert len(clear(tmp_path)) == 1


@pytest.mark.parametrize("kind", [FILE, FOLDER])
def test_what_is_not_of_its_names_sort_stays(tmp_path, kind):
    path = tmp_path / str(TemporaryName("a", NUMBER, kind))
    path.mkdir() if kind == FILE else path.write_bytes(b"")
    assert clear(tmp_path) == []
    assert path.exists()


@pytest.mark.parametrize("kind", [FILE, FOLDER])
def test_a_link_is_no_litter_and_is_not_followed(tmp_path, kind):
    mine = tmp_path / "mine"
    mine.mkdir() if kind == FOLDER else mine.write_bytes(b"mine")
    link = tmp_path / str(TemporaryName("a", NUMBER, kind))
    link.symlink_to(mine)
    assert clear(tmp_path) == []
    assert link.is_symlink() and mine.exists()


def test_links_in_litter_are_not_followed(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "work").write_bytes(b"mine")
    folder = left(tmp_path, kind=FOLDER)
    (folder / "link").symlink_to(tmp_path / "mine")
    assert len(clear(tmp_path)) == 1
    assert (tmp_path / "mine" / "work").read_bytes() == b"mine"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="not root")
def test_what_another_user_owns_stays(tmp_path):
    path = left(tmp_path)
    os.chown(path, 12345, -1)
    assert clear(tmp_path) == []
    assert path.exists()


@pytest.mark.parametrize("number", ["ENOLCK", "EOPNOTSUPP", "EBADF"])
def test_what_cannot_be_locked_is_in_use(tmp_path, monkeypatch, number):
    def refuse(*_):
        raise OSError(getattr(errno, number), "no")

    path = left(tmp_path)
    monkeypatch.setattr(fcntl, "flock", refuse)
    assert clear(tmp_path) == []
    with atomic_path(tmp_path / "b") as temporary:  # and work goes on
        temporary.write_bytes(b"b")
    assert names(tmp_path) == [path.name, "b"]


def test_without_locks_nothing_is_litter(tmp_path, monkeypatch):
    left(tmp_path)
    monkeypatch.setattr(ownership, "fcntl", None)
    assert clear(tmp_path) == []
    with atomic_path(tmp_path / "b"):
        pass


def test_a_lock_that_is_refused_leaves_nothing(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EIO, "no")

    monkeypatch.setattr(fcntl, "flock", refuse)
    with pytest.raises(StreamError, match="creating"), atomic_path(tmp_path / "b"):
        pytest.fail("it was created")
    assert names(tmp_path) == []


@pytest.mark.parametrize("create", [create_file, create_folder])
def test_a_cleaner_between_creation_and_lock(tmp_path, monkeypatch, create):
    """It removes the thing, or still holds its lock: the creator tries again, with another name."""
    real, spoilt = fcntl.flock, []

    def late(descriptor, how):
        if len(spoilt) < 2:
            spoilt.append(names(tmp_path))
            if len(spoilt) == 1:
                monkeypatch.setattr(fcntl, "flock", real)
                assert len(clear(tmp_path)) == 1
                monkeypatch.setattr(fcntl, "flock", late)
            else:
                raise BlockingIOError
        real(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", late)
    owned = create(tmp_path / "a")
    assert len({*map(tuple, spoilt), (owned.path.name,)}) == 3
    assert names(tmp_path) == [owned.path.name]
    monkeypatch.setattr(fcntl, "flock", real)
    assert clear(tmp_path) == []
    owned.remove()
    assert names(tmp_path) == []


def test_a_missing_folder_is_no_cleaner(tmp_path):
    for create in (create_file, create_folder):
        with pytest.raises(FileNotFoundError):
            create(tmp_path / "none" / "a")
    assert ownership.made_here() == []


def test_a_name_that_is_anothers_now_is_not_removed(tmp_path, monkeypatch):
    """Between the look and the lock the thing got its name, and another took the temporary one."""
    path = left(tmp_path)
    real = fcntl.flock

    def late(descriptor, how):
        path.rename(tmp_path / "a.png")
        path.write_bytes(b"another's")
        real(descriptor, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with claimed(path) as ours:
        assert not ours
    assert names(tmp_path) == [path.name, "a.png"]


def test_who_writes_into_a_folder_sweeps_it_before(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    file = left(tmp_path)
    with atomic_path(tmp_path / "b"):
        assert not file.exists()
    assert [(each.levelname, each.message) for each in caplog.records] == [
        ("INFO", f"{file}: removed, 3 bytes that an ended process left")
    ]
    left(tmp_path)
    nameless(tmp_path, tmp_path / "spool").close()
    assert file.exists()  # swept a moment ago
    litter._swept.clear()
    nameless(tmp_path, tmp_path / "spool").close()
    assert not file.exists()


def test_litter_that_stays_never_fails_a_run(tmp_path, monkeypatch, caplog):
    caplog.set_level(logging.INFO)
    file, folder = left(tmp_path), left(tmp_path, kind=FOLDER)

    def refuse(*_, **__):
        raise PermissionError(errno.EPERM, "no")

    monkeypatch.setattr(Path, "unlink", refuse)
    monkeypatch.setattr(os, "unlink", refuse)
    sweep(tmp_path)
    assert [each.levelname for each in caplog.records] == ["INFO", "INFO"]
    assert file.exists() and folder.exists()
    monkeypatch.undo()
    litter._swept.clear()
    monkeypatch.setattr(litter, "clear", refuse)
    with atomic_path(tmp_path / "b"):
        pass
    sweep(tmp_path / "none")


@pytest.mark.parametrize("create", [create_file, create_folder])
def test_a_link_that_foretells_a_name_is_not_followed(tmp_path, monkeypatch, create):
    (tmp_path / "mine").mkdir()
    numbers = iter(["0" * 16, "1" * 16])
    monkeypatch.setattr(ownership.secrets, "token_hex", lambda _: next(numbers))
    kind = FILE if create is create_file else FOLDER
    link = tmp_path / str(TemporaryName("a", "0" * 16, kind))
    link.symlink_to(tmp_path / "mine" / "made" if kind == FILE else tmp_path / "mine")
    owned = create(tmp_path / "a")
    assert owned.path.name == str(TemporaryName("a", "1" * 16, kind))
    owned.remove()
    litter.remove_own()
    assert link.is_symlink() and names(tmp_path / "mine") == []


def test_a_folder_for_us_alone(tmp_path):
    with temporary_folder(tmp_path, "scene") as folder:
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert clear(tmp_path) == []
        (folder / "a").write_bytes(b"a")
    assert names(tmp_path) == []


@pytest.mark.parametrize(("owner", "name"), [(os, "fstat"), (os, "open"), (fcntl, "flock")])
def test_what_cannot_be_looked_at_is_no_litter(tmp_path, monkeypatch, owner, name):
    def refuse(*_, **__):
        raise OSError(errno.EIO, "no")

    path = left(tmp_path, kind=FOLDER)
    monkeypatch.setattr(owner, name, refuse)
    assert clear(tmp_path) == []
    monkeypatch.undo()
    assert path.is_dir()


def test_an_interrupt_upon_an_interrupt_is_for_the_end(tmp_path, monkeypatch):
    """Clearing up is interrupted too: the end of the process does it."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "a"):
        monkeypatch.setattr(atomic_write, "remove_file", interrupted)
        raise KeyboardInterrupt
    assert len(names(tmp_path)) == 1
    litter.remove_own()
    assert names(tmp_path) == []


@pytest.mark.parametrize("kind", [FILE, FOLDER])
def test_an_interrupt_at_any_moment_of_a_creation(tmp_path, monkeypatch, kind):
    """Between two calls of the system, and when the thing is on its way to its owner."""
    create = create_file if kind == FILE else create_folder
    for owner, name in [(os, "open"), (Path, "mkdir"), (fcntl, "flock"), (ownership, "is_named")]:
        real = getattr(owner, name)

        def interrupted(*arguments, real=real, **named):
            real(*arguments, **named)
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(owner, name, interrupted)
            if kind == FILE and name == "mkdir":
                continue
            with pytest.raises(KeyboardInterrupt):
                create(tmp_path / "a")
        litter.remove_own()
        assert names(tmp_path) == []
    assert ownership.made_here() == []


def test_the_end_removes_nothing_that_has_its_name(tmp_path):
    with atomic_path(tmp_path / "a") as temporary:
        temporary.write_bytes(b"a")
    litter.remove_own()
    assert names(tmp_path) == ["a"]


@pytest.mark.parametrize("number", ["EISDIR", "EOPNOTSUPP", "EINVAL"])
def test_spools_where_all_files_have_names(tmp_path, monkeypatch, number):
    """They are locked as the rest, and lose their names at once."""
    if not hasattr(os, "O_TMPFILE"):
        pytest.skip("all files have names here")
    real, seen = os.open, []

    def refuse(path, flags, *mode, **named):
        if flags & os.O_TMPFILE == os.O_TMPFILE:
            raise OSError(getattr(errno, number), "no")
        if flags & os.O_CREAT:
            seen.append((Path(path), flags, mode))
        return real(path, flags, *mode, **named)

    monkeypatch.setattr(os, "open", refuse)
    with nameless(tmp_path, tmp_path / "spool") as file:
        assert names(tmp_path) == []
        file.write(b"abc")
        file.seek(0)
        assert file.read() == b"abc"
    ((path, flags, mode),) = seen
    assert parsed(path.name).kind == FILE
    assert flags & os.O_EXCL and mode == (0o600,)


# --- replacements that end half-way ---------------------------------------------------------------


def halves(folder, name="s.bfrt", whole=True):
    old, new = left(folder, name, "old"), left(folder, name, "part")
    (old / "which").write_text("old")
    (new / "which").write_text("new")
    marked(old)
    if whole:
        marked(new)
    return old, new


@pytest.mark.parametrize("by", ["restore", "clear", "sweep"])
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("name", ["s.bfrt", "s" * 230])
def test_a_replacement_that_ended_between_the_renames(tmp_path, by, whole, name):
    halves(tmp_path, name, whole)
    target = tmp_path / name
    if by == "restore" or len(name) > 200:
        if by == "clear":  # whose name cannot be known
            assert clear(tmp_path, dry=True) == clear(tmp_path) == []
            assert len(names(tmp_path)) == 2
        assert restore(target)
    elif by == "clear":
        assert clear(tmp_path, dry=True) == []
        assert not target.exists()
        assert len(clear(tmp_path)) == 1
    else:
        sweep(tmp_path)
    assert (target / "which").read_text() == ("new" if whole else "old")
    clear(tmp_path)
    assert names(tmp_path) == [name]


def test_a_replacement_that_is_done_leaves_litter(tmp_path):
    old, new = halves(tmp_path)
    shutil.rmtree(new)
    (tmp_path / "s.bfrt").mkdir()
    assert [found.path for found in clear(tmp_path)] == [old]
    halves(tmp_path)
    assert len(clear(tmp_path)) == 2
    assert names(tmp_path) == ["s.bfrt"]


def test_an_old_folder_whose_heir_was_deleted_stays_dead(tmp_path):
    _, new = halves(tmp_path)
    shutil.rmtree(new)
    assert not restore(tmp_path / "s.bfrt")
    assert len(clear(tmp_path)) == 1
    assert names(tmp_path) == []


def test_a_replacement_under_way_is_waited_for(tmp_path, monkeypatch):
    old, new = halves(tmp_path)
    descriptor = ownership.look_at(old, FOLDER)
    assert ownership.lock(descriptor)
    assert clear(tmp_path) == []
    assert len(names(tmp_path)) == 2
    monkeypatch.setattr(litter.time, "sleep", lambda _: new.rename(tmp_path / "s.bfrt"))
    assert restore(tmp_path / "s.bfrt")
    os.close(descriptor)


def test_what_never_ends_is_not_waited_for_long(tmp_path, monkeypatch):
    old, _ = halves(tmp_path)
    monkeypatch.setattr(litter, "REPLACING", 0.05)
    descriptor = ownership.look_at(old, FOLDER)
    assert ownership.lock(descriptor)
    assert not restore(tmp_path / "s.bfrt")
    os.close(descriptor)


def test_the_end_of_a_process_between_the_renames(tmp_path):
    target = tmp_path / "s.bfrt"
    target.mkdir()
    (target / "which").write_text("old")
    owned = create_folder(target)
    marked(owned.path)
    target.rename(owned.path.with_suffix(".old"))
    litter.remove_own()
    assert names(tmp_path) == ["s.bfrt"]
    assert names(target) == [HEADER]
    owned.release()


# --- where locks of others are not seen ----------------------------------------------------------

TABLE = """\
22 1 8:1 / / rw shared:1 - ext4 /dev/sda1 rw
30 22 0:40 / /mnt/far\\040away rw,relatime shared:2 - nfs4 server:/x rw
31 22 0:41 / /mnt rw - fuse.sshfs host: rw
32 22 0:42 / /mnt/é rw - xfs /dev/b rw
33 32 0:43 / /mnt/é rw - tmpfs none rw
"""


@pytest.mark.parametrize(
    ("folder", "kind", "shared"),
    [
        ("/", "ext4", False), ("/home", "ext4", False), ("/mnt/far away/x", "nfs4", True),
        ("/mnt/far", "fuse.sshfs", True), ("/mnt/é/x", "tmpfs", False), ("/mntx", "ext4", False),
    ],
)  # fmt: skip
def test_file_systems_of_several_machines(tmp_path, monkeypatch, folder, kind, shared):
    table = tmp_path / "mountinfo"
    table.write_text(TABLE)
    monkeypatch.setattr(litter, "MOUNTS", table)
    assert litter.file_system_of(Path(folder)) == kind
    assert litter.is_shared(Path(folder)) == shared


def test_there_nothing_is_litter_and_replacements_are_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(litter, "file_system_of", lambda _: "nfs4")
    halves(tmp_path)
    assert clear(tmp_path) == []
    assert restore(tmp_path / "s.bfrt")
    assert len(names(tmp_path)) == 2


def test_a_system_without_the_table(tmp_path, monkeypatch):
    monkeypatch.setattr(litter, "MOUNTS", tmp_path / "none")
    assert not litter.is_shared(tmp_path)
    left(tmp_path)
    assert len(clear(tmp_path)) == 1
