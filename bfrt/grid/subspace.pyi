from bfrt.grid.grid import Grid

class Subspace:
    def __init__(self, grid: Grid, first: int, end: int) -> None: ...
