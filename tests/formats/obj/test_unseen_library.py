"""A library that the system refuses to look at is not one that is not there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import obj_files
import pytest

import bfrt


def write(folder):
    (folder / "a.mtl").write_text(obj_files.LIBRARY)
    path = folder / "a.obj"
    path.write_text(obj_files.dressed("a.mtl", ["red one"]))
    return path


def stats(monkeypatch, error):
    """Have the system refuse to examine the library."""
    own = Path.stat

    def stat(path, **how):
        if path.name == "a.mtl":
            raise OSError(error, os.strerror(error))
        return own(path, **how)

    monkeypatch.setattr(Path, "stat", stat)


@pytest.mark.parametrize("error", [errno.EIO, errno.EACCES, errno.ENOMEM])
def test_a_refusal_is_an_error(tmp_path, monkeypatch, error):
    path = write(tmp_path)
    stats(monkeypatch, error)
    with pytest.raises(bfrt.StreamError, match=r"a\.mtl: examining at byte 0"):
        bfrt.convert(path, tmp_path / "a.bfrt", durable=False)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.mtl", "a.obj"]


@pytest.mark.parametrize("error", [errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG])
def test_what_is_not_there_is_told(tmp_path, monkeypatch, caplog, error):
    path = write(tmp_path)
    stats(monkeypatch, error)
    bfrt.convert(path, tmp_path / "a.bfrt", durable=False)
    assert "found no library" in caplog.text
