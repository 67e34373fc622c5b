"""Scenes in treelets as tests want them: small treelets, treelets that stream, few rays at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fast
import numpy as np
import pytest
from injected import dividing
from numpy.typing import ArrayLike, NDArray

from bfrt import tree_tracer
from bfrt.budget import TreeCapacities
from bfrt.reference.independent import Objects
from bfrt.scene import Scene
from bfrt.store.ordering import windows
from bfrt.store.store import Store
from bfrt.tree.forest import Forest
from bfrt.treelets.build import TreeletBuilder

QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")

#: What budgets of small scenes may hold; none of it may change an answer.
FORMS: dict[str, Callable[[TreeCapacities], TreeCapacities]] = {
    "resident": lambda held: replace(held, resident=True),
    "streamed": lambda held: replace(held, resident=False, kept=0),
    "streamed, some kept": lambda held: replace(held, resident=False, kept=5000),
    "streamed past the cache": lambda held: replace(
        held,
        resident=False,
        kept=1 << 16,
        cached=False,  # the first node of each treelet, too
    ),
    "resident, few rays": lambda held: replace(
        held, resident=True, rays=61, candidates=61, hits=7, queue=11
    ),
    "streamed, few rays": lambda held: replace(
        held, resident=False, kept=0, rays=61, candidates=61, hits=7, queue=11
    ),
}


def formed(scene: Scene | Store, form: str) -> Scene:
    """Open a scene once more, in one of the forms."""
    opened = scene if isinstance(scene, Scene) else Scene(scene)
    return dividing(
        opened, lambda held: FORMS[form](held) if isinstance(held, TreeCapacities) else held
    )


@contextmanager
def small_treelets(most: int = 16, leaf: int = 4) -> Iterator[None]:
    """Have stores in spatial order made with other treelets."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(windows, "TreeletBuilder", partial(TreeletBuilder, most, leaf))
        yield


@contextmanager
def plain_vectors() -> Iterator[None]:
    """Have boxes tested without wide vectors."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tree_tracer, "Forest", partial(Forest, plain=True))
        yield


def pair(
    objects: Objects,
    folder: Path,
    dtype: type = np.float64,
    origin: ArrayLike | None = None,
    treelets: tuple[int, int] = (16, 4),
) -> tuple[Store, Store]:
    """Two stores of the same objects: in the order given, and in treelets."""
    objects = fast.stored(objects, dtype)
    given = fast.write(objects, folder / "given.bfrt", dtype, origin)
    with small_treelets(*treelets):
        ordered = fast.write(objects, folder / "ordered.bfrt", dtype, origin, "spatial")
    return given, ordered


def answers(scene: Scene, *rays: Any, **settings: Any) -> dict[str, NDArray[Any]]:
    """The answers of the four queries, by query and key."""
    return {
        f"{query} {key}": values
        for query in QUERIES
        for key, values in getattr(scene, query)(*rays, **settings).items()
    }


def same(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]], why: str = "") -> None:
    """Hold answers to be the same, bit for bit."""
    assert one.keys() == other.keys()
    for key, values in one.items():
        assert values.dtype == other[key].dtype
        assert values.shape == other[key].shape, f"{why} {key}"
        if values.tobytes() != other[key].tobytes():
            np.testing.assert_array_equal(values, other[key], err_msg=f"{why} {key}")
