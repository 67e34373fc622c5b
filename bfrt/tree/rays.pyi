from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.film import Film
from bfrt.phases.crossings import CrossingBuffer
from bfrt.phases.in_flight import RaysInFlight
from bfrt.scan.given_order import GivenOrder
from bfrt.tree.forest import Forest

RAYS_AT_ONCE: int
RETIRED_BYTES: int

class TreeRays(RaysInFlight):
    def __init__(self, forest: Forest, capacity: int, candidates: int) -> None: ...
    @property
    def room(self) -> int: ...
    def admit(self, queued: NDArray[Any], first: int, last: int) -> int: ...
    def admit_again(self, asked: NDArray[Any], first: int, last: int) -> int: ...
    def begin_pass(self) -> None: ...
    def collect(self, first: int, last: int, each: int) -> int: ...
    def by_treelet(
        self,
    ) -> tuple[NDArray[np.uint32], NDArray[np.uint32], NDArray[np.int64]]: ...
    def retire(
        self,
        first: int,
        last: int,
        film: Film | None,
        background: NDArray[np.float64],
        hits: NDArray[Any],
    ) -> tuple[int, int, int]: ...

class TreeIntersector:
    def __init__(
        self, forest: Forest, order: GivenOrder, room: tuple[int, int, int, int] | None = None
    ) -> None: ...
    def begin(self, crossings: CrossingBuffer | None = None) -> None: ...
    def meet(
        self,
        rays: TreeRays,
        found: NDArray[np.uint32],
        treelets: NDArray[np.uint32],
        starts: NDArray[np.int64],
    ) -> None: ...
    def descend(self, rays: TreeRays, first: int, last: int) -> None: ...
    def tests(self) -> tuple[int, int]: ...
