"""The cluster that the tests of shards share with those of clusters."""

from __future__ import annotations

from cluster_fixtures import shared_client  # noqa: F401  # a fixture
