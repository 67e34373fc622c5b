"""Which tracer takes rays through a scene: that of the settings' refinement."""

from __future__ import annotations

from bfrt.budget import Capacities
from bfrt.grid_tracer import GridTracer
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tracer import Tracer
from bfrt.tree_tracer import TreeTracer


def tracer_of(store: Store, settings: Settings, capacities: Capacities) -> Tracer:
    """Begin a session on a scene."""
    kind = TreeTracer if settings.refinement.tree else GridTracer
    return kind(store, settings, capacities)
