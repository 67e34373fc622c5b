"""What tests of formats share."""

from __future__ import annotations

import pytest

from bfrt.formats import arrays


@pytest.fixture
def small_blocks(monkeypatch):
    """Arrays are read by rows so few that a small file has several blocks."""
    monkeypatch.setattr(arrays, "POINTS_AT_ONCE", 3)
