"""``bfrt.open``: a store, and what can be done with it."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from typing import Any

from bfrt.image.picture import Image
from bfrt.planned import Plan
from bfrt.planning import plan
from bfrt.queries import casting
from bfrt.queries.casting import Answer
from bfrt.queries.rays import Given
from bfrt.rendering import render
from bfrt.scene.store import Store, open_store


@dataclass(frozen=True)
class Scene(Store):
    """An open scene: its header, not the data, and what can be asked of it."""

    def render(self, **settings: Any) -> Image:
        """Render it: `bfrt.render`."""
        return render(self, **settings)

    def plan(self, **settings: Any) -> Plan:
        """Tell what that would take, before any work: `bfrt.plan`."""
        return plan(self, **settings)

    def cast_rays(self, origins: Given, directions: Given | None = None, **settings: Any) -> Answer:
        """Find the nearest hits of rays: `bfrt.cast_rays`."""
        return casting.cast_rays(self, origins, directions, **settings)

    def occluded(self, origins: Given, directions: Given | None = None, **settings: Any) -> Answer:
        """Find which rays hit anything: `bfrt.occluded`."""
        return casting.occluded(self, origins, directions, **settings)

    def count_intersections(
        self, origins: Given, directions: Given | None = None, **settings: Any
    ) -> Answer:
        """Count all hits of rays: `bfrt.count_intersections`."""
        return casting.count_intersections(self, origins, directions, **settings)

    def list_intersections(
        self, origins: Given, directions: Given | None = None, **settings: Any
    ) -> Answer:
        """Find all hits of rays: `bfrt.list_intersections`."""
        return casting.list_intersections(self, origins, directions, **settings)


def open_scene(path: str | os.PathLike[str]) -> Scene:
    """Open a store: read its header, check the sizes of its files.

    Raises
    ------
    StoreError
        If it is not a store, of another version, damaged or truncated.
    """
    store = open_store(path)
    return Scene(**{field.name: getattr(store, field.name) for field in fields(store)})
