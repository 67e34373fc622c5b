"""Pictures with little memory, by a function that other processes find by its module."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

import bfrt

SMALL: dict[str, Any] = {"memory": "96MiB", "threads": 1}


def rgb(scene: Any, refine: str) -> NDArray[Any]:
    """Render a scene, or a store by its path."""
    return bfrt.render(scene, refine=refine, **SMALL).rgb
