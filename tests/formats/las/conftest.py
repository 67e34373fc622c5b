"""Where these tests write, and how little is read at once."""

from __future__ import annotations

import pytest

from bfrt.formats import las as las_module


@pytest.fixture(params=[".las", ".laz"])
def file(request, tmp_path):
    return tmp_path / f"a{request.param}"


@pytest.fixture
def laz(tmp_path):
    return tmp_path / "a.laz"


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(las_module, "POINTS_AT_ONCE", 7)
