"""Scenes that the tests of clusters share."""

from __future__ import annotations

import pytest
from cluster_fixtures import build, shared_client  # noqa: F401  # a fixture


@pytest.fixture(scope="session")
def paths(tmp_path_factory):
    """A store in each order."""
    folder = tmp_path_factory.mktemp("cluster")
    for order in ("given", "spatial"):
        build(folder / f"{order}.bfrt", order)
    return {order: folder / f"{order}.bfrt" for order in ("given", "spatial")}
