from typing import Any

from numpy.typing import NDArray

from bfrt.phases.crossings import CrossingBuffer
from bfrt.scan.given_order import GivenOrder
from bfrt.store.store import Group, Store

class Outliers:
    count: int
    def __init__(self, store: Store, group: Group, order: GivenOrder) -> None: ...
    def cross(
        self,
        rays: NDArray[Any],
        first: int,
        last: int,
        padding: float,
        crossings: CrossingBuffer,
    ) -> tuple[int, int]: ...
