from bfrt.tree.forest import Forest

class PieceReader:
    def __init__(self, forest: Forest) -> None: ...
