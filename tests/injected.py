"""Scenes whose budgets hold what a test says."""

from __future__ import annotations

from collections.abc import Callable

from bfrt.budget import Capacities, capacities
from bfrt.scene import Scene


def dividing(scene: Scene, change: Callable[[Capacities], Capacities]) -> Scene:
    """Open the scene once more, with what its budgets hold changed."""
    return Scene(scene.store, lambda *given: change(capacities(*given)))


def holding(scene: Scene, held: Capacities) -> Scene:
    """Open the scene once more, with budgets that all hold the same."""
    return dividing(scene, lambda _: held)
