from typing import Any

from numpy.typing import NDArray

from bfrt.store.store import Store
from bfrt.store.stream import Stream

TREELET_SHARE: int
PARTS: tuple[str, ...]

def table_of(stream: Stream) -> NDArray[Any]: ...

class Forest:
    treelets: int
    padding: float
    resident: bool
    plain: bool
    direct: bool
    def __init__(
        self,
        store: Store,
        padding: float,
        resident: bool,
        kept: int = 0,
        direct: bool = False,
        plain: bool = False,
    ) -> None: ...
    @staticmethod
    def bytes(store: Store) -> int: ...
    @staticmethod
    def resident_bytes(store: Store) -> int: ...
    @staticmethod
    def kept_bytes(store: Store) -> int: ...
    def counts(self) -> tuple[int, int, int]: ...
    def load_part(self, first: int, end: int) -> None: ...
