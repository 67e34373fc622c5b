"""Which tracer takes rays through a scene: that of the settings' refinement."""

from __future__ import annotations

from pathlib import Path

from bfrt.budget import Capacities, GridCapacities, TreeCapacities
from bfrt.grid_tracer import GridTracer
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tracer import Tracer
from bfrt.tree_tracer import TreeTracer


def tracer_of(
    store: Store, settings: Settings, capacities: Capacities, kept: Path | None = None
) -> Tracer:
    """Begin a session on a scene; `kept` is the folder of its checkpoint, if there is one."""
    if isinstance(capacities, TreeCapacities):
        return TreeTracer(store, settings, capacities)
    assert isinstance(capacities, GridCapacities)
    return GridTracer(store, settings, capacities, kept)
