from bfrt.store.store import Store

class Forest:
    treelets: int
    padding: float
    resident: bool
    def __init__(
        self, store: Store, padding: float, resident: bool, plain: bool = False
    ) -> None: ...
    @staticmethod
    def bytes(store: Store) -> int: ...
    @staticmethod
    def resident_bytes(store: Store) -> int: ...
    def counts(self) -> tuple[int, int]: ...
