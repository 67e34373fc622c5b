"""Running a command inside a memory cgroup, its disk as slow as wanted, its files not cached."""

from __future__ import annotations

import functools
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

V1 = Path("/sys/fs/cgroup/memory")
V1_DISK = Path("/sys/fs/cgroup/blkio")
V2 = Path("/sys/fs/cgroup")

#: The paper's memory, and the suite's.
CAP = 256 << 20


def drop(path: Path) -> None:
    """Take a file, or all of a folder, out of the page cache: others' pages are not charged to a
    cgroup, and a cache that another process filled makes a reader look good."""
    if not hasattr(os, "posix_fadvise"):
        return
    for file in [path, *path.rglob("*")]:
        if file.is_file():
            descriptor = os.open(file, os.O_RDONLY)
            try:
                os.fdatasync(descriptor)
                os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
            finally:
                os.close(descriptor)


@contextmanager
def memory_cap(amount: int, name: str = "") -> Iterator[Path | None]:
    """A memory cgroup of `amount` bytes: its folder; None where none can be made.

    It takes root, and cgroups of version 1 or 2. Where there are several at once each has a name.
    """
    root, limit = (V1, "memory.limit_in_bytes") if V1.is_dir() else (V2, "memory.max")
    group = root / f"bfrt-{os.getpid()}{name}"
    try:
        if root == V2:
            (V2 / "cgroup.subtree_control").write_text("+memory")
        group.mkdir()
        (group / limit).write_text(str(amount))
        if (group / "memory.swap.max").exists():
            (group / "memory.swap.max").write_text("0")
    except OSError:
        if group.exists():
            group.rmdir()
        yield None
        return
    try:
        yield group
    finally:
        remove(group)


def remove(group: Path) -> None:
    """Remove a cgroup, as soon as its last process has left."""
    for _ in range(50):
        try:
            group.rmdir()
            break
        except OSError:
            time.sleep(0.1)


def disk_of(path: Path) -> str:
    """The disk that a file system lies on, as MAJOR:MINOR; a partition's limits are its disk's.

    Raises
    ------
    SystemExit
        If it lies on no block device, as a network's or a file system in memory.
    """
    number = path.stat().st_dev
    device = Path(f"/sys/dev/block/{os.major(number)}:{os.minor(number)}")
    if not device.exists():
        raise SystemExit(f"{path}: lies on no block device, expected a disk to cap")
    whole = device.resolve()
    return ((whole.parent if (whole / "partition").exists() else whole) / "dev").read_text().strip()


@contextmanager
def disk_cap(group: Path, folder: Path, rate: int) -> Iterator[Path]:
    """Where a cgroup's disk gives `rate` bytes a second at the most: a cgroup beside the memory's
    in version 1, the same in version 2."""
    if not V1.is_dir():
        (V2 / "cgroup.subtree_control").write_text("+io")
        (group / "io.max").write_text(f"{disk_of(folder)} rbps={rate}")
        yield group
        return
    own = V1_DISK / group.name
    own.mkdir()
    try:
        (own / "blkio.throttle.read_bps_device").write_text(f"{disk_of(folder)} {rate}")
        yield own
    finally:
        remove(own)


@functools.cache
def how_capped() -> str:
    """What caps memory here."""
    with memory_cap(1 << 30) as group:
        return "cgroup" if group else "RLIMIT_DATA, which does not count the page cache"


def peak_of(group: Path) -> int:
    """The most bytes that a cgroup has held, page cache included."""
    for name in ("memory.peak", "memory.max_usage_in_bytes"):
        if (group / name).exists():
            return int((group / name).read_text())
    return 0


def run_capped(
    arguments: list[str],
    amount: int,
    disk: tuple[Path, int] | None = None,
    python: str = sys.executable,
) -> tuple[int, int]:
    """Run ``python arguments`` inside a cgroup, or else under RLIMIT_DATA.

    Parameters
    ----------
    disk : (Path, int), optional
        A folder, of whose disk so many bytes are read in a second at the most.
    python : str, optional
        Another Python than this one.

    Returns
    -------
    status, peak : int
        The exit status, and the most bytes held: the cgroup's, or the process's resident ones.
    """
    with memory_cap(amount) as group:
        command = [python, *arguments]
        if group is None:
            if disk:
                raise SystemExit("reads of a disk are capped by a cgroup, and none could be made")
            script = 'ulimit -d "$0" && exec "$@"'
            capped = ["sh", "-c", script, str(amount >> 10), *command]
            status = subprocess.run(capped, check=False).returncode
            return status, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss << 10
        command = inside(group, command)
        if disk is None:
            return subprocess.run(command, check=False).returncode, peak_of(group)
        with disk_cap(group, *disk) as slow:
            status = subprocess.run(inside(slow, command), check=False).returncode
        return status, peak_of(group)


def inside(group: Path, command: list[str]) -> list[str]:
    """The command that runs another inside a cgroup."""
    return ["sh", "-c", 'echo $$ >"$0/cgroup.procs" && exec "$@"', str(group), *command]
