"""What tests of checkpoints share: scenes, and saves that wait for no disk.

What is broken off here is a process's work, not the system's.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from checkpoints import scene_of


@pytest.fixture(scope="module", autouse=True)
def unsynced() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    given = scene_of(folder / "given.bfrt")
    return {"given": given, "tree": scene_of(folder / "ordered.bfrt", groups=1, order="spatial")}
