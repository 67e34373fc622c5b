"""Windows become treelets, ahead, by several threads."""

from __future__ import annotations

import queue
from collections.abc import Generator, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.store.ordering.objects import Layout, Objects
from bfrt.store.ordering.parts import Means
from bfrt.treelets.build import TreeletBuilder
from bfrt.workers import ahead


class OrderedWindow(NamedTuple):
    """Holds a window's objects in the order of its treelets.

    Attributes
    ----------
    objects : Objects
    boxes : (n, 6) float32
    nodes : (nodes,) NODE
    treelets : (treelets,) TREELET
        Their first objects and nodes count from the window's.
    """

    objects: Objects
    boxes: NDArray[np.float32]
    nodes: NDArray[Any]
    treelets: NDArray[Any]


def ordered(
    windows: Iterator[Objects], layout: Layout, means: Means
) -> Generator[OrderedWindow, None, None]:
    """Yield windows in the order of their treelets."""
    builders: queue.SimpleQueue[TreeletBuilder] = queue.SimpleQueue()

    def order(window: Objects) -> OrderedWindow:
        boxes = window.boxes(layout)
        try:
            builder = builders.get_nowait()
        except queue.Empty:
            builder = TreeletBuilder()
        nodes, treelets, places = builder.build(boxes)
        made = OrderedWindow(
            window.taken(places, layout), boxes[places], nodes.copy(), treelets.copy()
        )
        builders.put(builder)
        return made

    return ahead(order, windows, means.threads, means.waiting)
