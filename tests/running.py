"""The threads of this process, by the names that the system has."""

from __future__ import annotations

import contextlib
import sys
import threading
from pathlib import Path

import pytest

TASKS = Path("/proc/self/task")


def thread_names() -> list[str]:
    """What all threads are called."""
    if not sys.platform.startswith("linux"):
        pytest.skip("another system does not tell what threads are called")
    names = []
    for task in TASKS.iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
            names.append((task / "comm").read_text().strip())
    return names


def thread_name() -> str:
    """What this one is called."""
    return (TASKS / str(threading.get_native_id()) / "comm").read_text().strip()
