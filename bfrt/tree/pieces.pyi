from bfrt.store.store import Store
from bfrt.tree.forest import Forest

class PieceReader:
    def __init__(self, forest: Forest) -> None: ...
    @staticmethod
    def bytes(store: Store) -> int: ...
