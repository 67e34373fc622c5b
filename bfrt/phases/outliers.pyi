from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from bfrt.store.store import Group, Store

class Outliers:
    count: int
    def __init__(self, store: Store, group: Group) -> None: ...

def cross_outliers(
    outliers: Outliers,
    rays: NDArray[Any],
    first: int,
    last: int,
    grow: float,
    crossings: NDArray[Any],
    emit: Callable[[int], None],
) -> tuple[int, int]: ...
