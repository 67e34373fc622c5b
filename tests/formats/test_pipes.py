"""Pipes are for NFF, which is read once; every other format says so, at once."""

from __future__ import annotations

import os
import socket
import threading

import numpy as np
import pytest

import bfrt
from bfrt.conversion.sources import READERS
from bfrt.errors import BudgetError, SettingError
from bfrt.formats.room import need_of

NFF = b"b 0 0 0\nf 1 1 1 1 0 0 0 1\ns 1 2 3 0.5\n"

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")


def said_of(path, **asked):
    with pytest.raises(SettingError) as caught:
        bfrt.convert(path, path.parent / "out.bfrt", **asked)
    assert not [entry for entry in path.parent.iterdir() if entry != path]
    return str(caught.value)


def sentence(path, found):
    return (
        f"{path}: found {found}, expected a file, which can be read more than once: of what can be "
        "read but once NFF alone is read (.nff, or - for standard input)"
    )


@pytest.mark.parametrize("suffix", [suffix for suffix in READERS if suffix != ".nff"])
def test_a_pipe_that_nobody_writes_to_is_not_waited_for(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    os.mkfifo(path)
    assert said_of(path) == sentence(path, "a pipe")


def test_a_pipe_that_somebody_writes_to(tmp_path):
    read, write = os.pipe()
    with os.fdopen(read, "rb"), os.fdopen(write, "wb"):
        path = tmp_path / "a.ply"
        path.symlink_to(f"/proc/self/fd/{read}")
        assert said_of(path) == sentence(path, "a pipe")


def test_a_device_and_a_socket(tmp_path):
    path = tmp_path / "a.stl"
    path.symlink_to("/dev/zero")
    assert said_of(path) == sentence(path, "a device or a socket")
    ours, theirs = socket.socketpair()
    with ours, theirs:
        link = tmp_path / "b" / "a.obj"
        link.parent.mkdir()
        link.symlink_to(f"/proc/self/fd/{ours.fileno()}")
        with pytest.raises(OSError, match="No such device or address"):
            bfrt.convert(link, tmp_path / "out.bfrt")


def test_rays_in_a_pipe(tmp_path):
    path = tmp_path / "rays.npy"
    os.mkfifo(path)
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.spheres([[0, 0, 0]], 1)
    with pytest.raises(SettingError) as caught:
        bfrt.cast_rays(tmp_path / "a.bfrt", path, np.ones((1, 3)))
    assert str(caught.value) == sentence(path, "a pipe")


def test_nff_comes_by_a_pipe(tmp_path):
    path = tmp_path / "a.nff"
    os.mkfifo(path)
    writer = threading.Thread(target=path.write_bytes, args=(NFF,))
    writer.start()
    assert bfrt.convert(path, tmp_path / "out.bfrt").objects == 1
    writer.join()


def test_a_budget_is_refused_before_a_pipe_is_waited_for(tmp_path):
    path = tmp_path / "a.nff"
    os.mkfifo(path)
    with pytest.raises(BudgetError):
        bfrt.convert(path, tmp_path / "out.bfrt", memory=need_of(str(path)).least - 1)
