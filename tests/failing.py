"""A system that refuses reads and writes: at the first, at the second, and so on."""

from __future__ import annotations

import errno
import io
import itertools
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bfrt.errors import DiskFullError, StreamError
from bfrt.formats import source as source_module


class Broken(io.FileIO):
    """A file whose later reads the system refuses."""

    reads = 0

    def readinto(self, buffer):
        Broken.reads -= 1
        if Broken.reads < 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().readinto(buffer)


def alone(file: Path) -> None:
    """Nothing is beside a file."""
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def refuse_reads(
    patch: pytest.MonkeyPatch, file: Path, work: Callable[[], object], check: Callable[[], None]
) -> int:
    """Do `work` again and again, until none of the reads of `file` that it needs is refused.

    Each refusal is one error with its place, after which `check` is called. Returns the reads.
    """
    patch.setattr(source_module.io, "FileIO", Broken)
    for reads in itertools.count():
        Broken.reads = reads
        try:
            work()
            return reads
        except StreamError as error:
            assert error.errno == errno.EIO
            assert str(error).startswith(f"{file}: reading at byte ")
        check()
    raise AssertionError


def refuse_writes(
    patch: pytest.MonkeyPatch, work: Callable[[], object], check: Callable[[], None]
) -> int:
    """Do `work` again and again, until the disk is full at none of its writes.

    Each time is one error, after which `check` is called. Returns the writes.
    """
    write = os.write
    for refused in itertools.count():
        calls = itertools.count()

        def full(*arguments, calls=calls, refused=refused):
            if next(calls) == refused:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write(*arguments)

        with patch.context() as now:
            now.setattr(os, "write", full)
            try:
                work()
                return refused
            except DiskFullError as error:
                assert "writing at byte" in str(error)
        check()
    raise AssertionError
