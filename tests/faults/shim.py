"""The shim from Python: how it is made, and what it is told."""

from __future__ import annotations

import ctypes
import errno
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

SOURCE = Path(__file__).with_name("shim.c")

#: Families of calls, in the order of shim.c.
FAMILIES = (
    "open", "read", "write", "sync", "rename", "remove", "mkdir", "stat", "seek", "map",
    "truncate", "close", "memory", "thread", "aio",
)  # fmt: skip

SHORT = -1


class Fault(NamedTuple):
    """What is done to the n-th call of a family, or to all from there on where it `lasts`."""

    family: str
    error: int
    lasts: bool = False

    def __str__(self) -> str:
        name = "short" if self.error == SHORT else errno.errorcode[self.error]
        return f"{self.family} {name}{' lasting' if self.lasts else ''}"


FAULTS = (
    Fault("open", errno.EIO),
    Fault("open", errno.EMFILE),
    Fault("open", errno.EINTR),
    Fault("read", errno.EIO),
    Fault("read", errno.EINTR),
    Fault("read", SHORT),
    Fault("write", errno.EIO),
    Fault("write", errno.ENOSPC),
    Fault("write", errno.ENOSPC, lasts=True),
    Fault("write", errno.EINTR),
    Fault("write", SHORT),
    Fault("sync", errno.EIO),
    Fault("sync", errno.ENOSPC),
    Fault("rename", errno.EIO),
    Fault("rename", errno.ENOSPC),
    Fault("remove", errno.EIO),
    Fault("mkdir", errno.EIO),
    Fault("mkdir", errno.ENOSPC),
    Fault("stat", errno.EIO),
    Fault("seek", errno.EIO),
    Fault("map", errno.ENOMEM),
    Fault("truncate", errno.ENOSPC),
    Fault("close", errno.EIO),
    Fault("close", errno.ENOSPC),
    Fault("close", errno.EINTR),
    Fault("memory", errno.ENOMEM),
    Fault("memory", errno.ENOMEM, lasts=True),
    Fault("thread", errno.EAGAIN),
    Fault("thread", errno.EAGAIN, lasts=True),
    Fault("aio", errno.EAGAIN),
    Fault("aio", errno.EAGAIN, lasts=True),
    Fault("aio", errno.EIO),
    Fault("aio", errno.EINTR),
    Fault("aio", SHORT),
)

#: A fault that never comes: calls are counted.
NEVER = 1 << 40


def built(folder: Path) -> Path:
    """The shim, compiled into a folder."""
    compiler = shutil.which("cc")
    if not sys.platform.startswith("linux"):
        pytest.skip("the shim takes the place of Linux's C library")
    if compiler is None:
        pytest.skip("there is no C compiler")
    library = folder / "shim.so"
    flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, "-o", library, SOURCE, "-ldl", "-pthread"], check=True)
    return library


class Shim:
    """The shim in a process that was started with it."""

    def __init__(self, library: Path) -> None:
        self._library = ctypes.PyDLL(str(library))  # which keeps the GIL: nothing comes between
        self._library.fault_count.restype = ctypes.c_long
        self._library.fault_arm.argtypes = [
            ctypes.c_int, ctypes.c_long, ctypes.c_int, ctypes.c_int
        ]  # fmt: skip

    def arm(self, fault: Fault, n: int) -> None:
        family = FAMILIES.index(fault.family)
        self._library.fault_arm(family, n, fault.error, fault.lasts)

    def disarm(self) -> None:
        self._library.fault_disarm()

    def counts(self) -> dict[str, int]:
        """Calls since it was armed, by family."""
        return {name: self._library.fault_count(k) for k, name in enumerate(FAMILIES)}
