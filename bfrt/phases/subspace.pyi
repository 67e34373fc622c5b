from bfrt.geometry.lattice import Lattice

class Subspace:
    def __init__(self, lattice: Lattice, first: int, end: int) -> None: ...
