"""Where these tests write, and how little is read at once."""

from __future__ import annotations

import pytest
from ply_files import chunk_bytes


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.ply"


@pytest.fixture
def tiny(monkeypatch):
    """Chunks so small that nothing fits in one."""
    chunk_bytes(monkeypatch, 32)
