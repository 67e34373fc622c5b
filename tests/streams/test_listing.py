"""Folders are listed whole, or it is an error: an interrupted call is made again."""

from __future__ import annotations

import errno
import os

import pytest

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.errors import StreamError
from bfrt.paths import names_in, walk
from bfrt.streams.atomic_write import sync_folders


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "b" / "c").mkdir(parents=True)
    (tmp_path / "a").write_bytes(b"")
    (tmp_path / "b" / "d").write_bytes(b"")
    (tmp_path / "l").symlink_to("b")
    return tmp_path


@pytest.fixture
def refuse(monkeypatch):
    """Have the system refuse to list one folder, the first times or ever."""
    scandir = os.scandir

    def refuse(folder, number, times):
        left = [times]

        def refusing(path):
            if os.fspath(path) == os.fspath(folder) and left[0]:
                left[0] -= 1
                raise OSError(number, os.strerror(number))
            return scandir(path)

        monkeypatch.setattr(os, "scandir", refusing)

    return refuse


def test_an_interrupted_listing_is_made_again(folder, refuse):
    refuse(folder, errno.EINTR, 2)
    assert names_in(folder) == ["a", "b", "l"]


def test_a_walk_goes_into_folders_and_not_into_links(folder):
    found = [(str(place.relative_to(folder)), *rest) for place, *rest in walk(folder)]
    assert found == [(".", ["b"], ["a", "l"]), ("b", ["c"], ["d"]), ("b/c", [], [])]


def test_folders_that_cannot_be_listed_are_not_taken_for_durable(folder, refuse):
    refuse(folder / "b", errno.EIO, -1)
    with pytest.raises(StreamError, match="listing at byte 0: Input/output error"):
        sync_folders(folder)


@pytest.mark.parametrize("number", [errno.EINTR, errno.EIO, errno.EMFILE])
def test_a_refusal_at_the_end_leaves_no_empty_checkpoint(tmp_path, refuse, number):
    with Checkpoint(tmp_path / "kept"):
        refuse(tmp_path / "kept", number, 1)
    assert not (tmp_path / "kept").exists()
