"""Where these tests write."""

from __future__ import annotations

import pytest


@pytest.fixture
def npy(tmp_path):
    return tmp_path / "a.npy"


@pytest.fixture
def npz(tmp_path):
    return tmp_path / "a.npz"
