"""A memory cgroup for tests: counts everything, the page cache too, and kills what passes it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

V1 = Path("/sys/fs/cgroup/memory")
V2 = Path("/sys/fs/cgroup")


@contextmanager
def memory_cap(amount: int) -> Iterator[Path | None]:
    """A cgroup limited to `amount` bytes: its folder, or None where none can be made."""
    root, limit = (V1, "memory.limit_in_bytes") if V1.is_dir() else (V2, "memory.max")
    group = root / f"bfrt-test-{os.getpid()}"
    try:
        if root == V2:
            (V2 / "cgroup.subtree_control").write_text("+memory")
        group.mkdir()
        (group / limit).write_text(str(amount))
    except OSError:
        if group.exists():
            group.rmdir()
        yield None
        return
    try:
        yield group
    finally:
        group.rmdir()


def run_in(group: Path, command: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command inside a cgroup."""
    script = 'echo $$ >"$0/cgroup.procs" && exec "$@"'
    return subprocess.run(
        ["sh", "-c", script, str(group), *command],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
    )
