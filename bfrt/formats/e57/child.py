"""The process that reads an E57 file for another, as long as that asks (bfrt.formats.e57)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.formats.e57.scans import Scans
from bfrt.formats.remote.serving import Answer, Verbs, serve


class Server:
    """Answers for a file.

    Parameters
    ----------
    path : str
    """

    def __init__(self, path: str) -> None:
        self.scans = Scans(path)
        self._blocks: Iterator[NDArray[np.float64]] = iter(())
        self.verbs: Verbs = {"begin": self.begin, "next": self.next}

    def begin(self, *names: str) -> Answer:
        """Begin a pass over columns of all scans."""
        self._blocks = self.scans.blocks(names)
        return ["done"], None

    def next(self) -> Answer:
        """Return the next block of the pass, (n, columns), or None at its end."""
        block = next(self._blocks, None)
        return ["done", None if block is None else list(block.shape)], block


def main(path: str, _: list[Any]) -> None:
    """Say how many points a file has and in which columns, and answer."""

    def begin() -> tuple[list[Any], Verbs]:
        server = Server(path)
        return [server.scans.count, *server.scans.names], server.verbs

    serve(begin)
