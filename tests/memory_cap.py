"""Commands inside a memory cgroup, whose output is kept."""

from __future__ import annotations

import subprocess
from pathlib import Path

from capped import inside


def run_in(group: Path, command: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command inside a cgroup."""
    return subprocess.run(
        inside(group, command), capture_output=True, text=True, check=False, cwd=cwd
    )
