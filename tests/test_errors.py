"""Every exception says where, survives a pool of processes, and can be caught as what it is."""

from __future__ import annotations

import copy
import errno
import os
import pickle

import pytest

from bfrt import errors

MADE = [
    errors.BfrtError("a"),
    errors.SceneError("a"),
    errors.StoreError("a"),
    errors.BudgetError("a"),
    errors.CheckpointError("a"),
    errors.ResourceError("a"),
    errors.SettingError("a"),
    errors.Cancelled("a"),
    errors.StreamError("X/boxes", 12, errno.EIO, "reading"),
    errors.DiskFullError("X/boxes", 12, errno.ENOSPC, "writing"),
    errors.ShortReadError("X/boxes", 12, 24, 7),
]


def test_none_is_missing_here():
    every = {e for e in vars(errors).values() if isinstance(e, type) and issubclass(e, Exception)}
    assert {type(error) for error in MADE} == every


@pytest.mark.parametrize("error", MADE, ids=lambda e: type(e).__name__)
def test_each_is_ours_and_can_be_handed_over(error):
    assert isinstance(error, errors.BfrtError)
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(again) is type(error)
        assert str(again) == str(error)
        for name in ("path", "offset", "errno"):
            assert getattr(again, name, None) == getattr(error, name, None)


NASTY = "a\nb\x1b[31m\u202e\x9b\udcff\\é.bfrt"
SHOWN = r"a\nb\x1b[31m\u202e\x9b\udcff" "\\é.bfrt"


@pytest.mark.parametrize(
    "error",
    [
        *(type(error)(NASTY) for error in MADE if len(error.args) == 1 and error.args == ("a",)),
        errors.StreamError(NASTY, 12, errno.EIO, "reading"),
        errors.DiskFullError(NASTY, 12, errno.ENOSPC, "writing"),
        errors.ShortReadError(NASTY, 12, 24, 7),
    ],
    ids=lambda error: type(error).__name__,
)
def test_names_do_nothing_to_a_terminal(error):
    """Who names a file, as that of a sharded scene does, writes nothing into ours but letters."""
    assert SHOWN in str(error) and str(error).isprintable()
    assert str(errors.StoreError(f"worker 1: {error}")) == f"worker 1: {error}"
    assert NASTY in error.args or error.path == NASTY


@pytest.mark.parametrize(
    ("kind", "base"),
    [
        (errors.SceneError, ValueError),
        (errors.StoreError, ValueError),
        (errors.SettingError, ValueError),
        (errors.BudgetError, MemoryError),
        (errors.StreamError, OSError),
        (errors.DiskFullError, errors.StreamError),
        (errors.ShortReadError, EOFError),
    ],
)
def test_each_is_what_python_calls_it(kind, base):
    assert issubclass(kind, base)


def test_a_stream_error_says_file_offset_and_reason():
    error = errors.StreamError(os.path.join("X", "boxes"), 12, errno.EIO, "reading")  # noqa: PTH118
    assert str(error) == f"{error.path}: reading at byte 12: {os.strerror(errno.EIO)}"
    assert (error.errno, error.offset) == (errno.EIO, 12)


def test_a_short_read_says_what_was_asked_and_found():
    message = str(errors.ShortReadError("X/boxes", 12, 24, 7))
    assert message.startswith("X/boxes: asked for 24 bytes at byte 12, found 7")
