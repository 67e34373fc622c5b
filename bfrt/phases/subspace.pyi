from collections.abc import Sequence

from bfrt.geometry.lattice import Lattice

class Subspace:
    def __init__(self, lattice: Lattice, begin: Sequence[int], end: Sequence[int]) -> None: ...
