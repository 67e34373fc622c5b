import numpy as np
import numpy.typing as npt

from bfrt.formats.text import Tokens

class Facets(Tokens):
    failed: bool
    @property
    def complete(self) -> bool: ...
    @property
    def expected(self) -> str: ...
    def parse(self, chunk: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]: ...
