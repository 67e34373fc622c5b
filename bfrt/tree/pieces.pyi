from bfrt.store.store import Store
from bfrt.tree.forest import Forest

NODES_READ: int
RECORDS_READ: int
BOXES_READ: int
ENDS_READ: int

def rooms(store: Store) -> tuple[int, int, int, int]: ...

class PieceReader:
    def __init__(self, forest: Forest, room: tuple[int, int, int, int]) -> None: ...
    @staticmethod
    def bytes(store: Store) -> int: ...
