"""The process that reads an HDF5 file for another, as long as that asks (bfrt.formats.hdf5)."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from contextlib import closing
from typing import Any

from numpy.typing import NDArray

from bfrt.formats.hdf5.datasets import Datasets
from bfrt.formats.hdf5.origins import Limits
from bfrt.formats.remote.messages import words_of_type
from bfrt.formats.remote.serving import Answer, Verbs, serve
from bfrt.formats.source import Source
from bfrt.formats.table import Array


class Server:
    """Answers what is asked of a file's arrays.

    Each array, and each pass over one's rows, has a number by which it is asked for.
    """

    def __init__(self, datasets: Datasets) -> None:
        self._datasets = datasets
        self._arrays: list[Array] = []
        self._passes: dict[int, Iterator[NDArray[Any]]] = {}
        self._numbers = itertools.count()
        self.verbs: Verbs = {
            "has": self.has,
            "open": self.open,
            "frame": self.frame,
            "attributes": self.attributes,
            "begin": self.begin,
            "next": self.next,
            "end": self.end,
        }

    def has(self, name: str) -> Answer:
        return ["done", name in self._datasets], None

    def open(self, name: str) -> Answer:
        return self._facts(self._datasets[name])

    def frame(self, number: int, place: int) -> Answer:
        return self._facts(self._arrays[number].frame(place))

    def attributes(self, path: str, *names: str) -> Answer:
        return ["done", self._datasets.attributes(path, *names)], None

    def begin(self, number: int, rows: int) -> Answer:
        """Begin to read an array's rows, `rows` at a time."""
        begun = next(self._numbers)
        self._passes[begun] = iter(self._arrays[number].blocks(rows))
        return ["done", begun], None

    def next(self, begun: int) -> Answer:
        """Return the shape of the next rows, and their numbers; no shape at the end."""
        block = next(self._passes[begun], None)
        return ["done", None if block is None else list(block.shape)], block

    def end(self, begun: int) -> Answer:
        del self._passes[begun]
        return ["done"], None

    def _facts(self, array: Array) -> Answer:
        self._arrays.append(array)
        number = len(self._arrays) - 1
        return ["done", number, array.name, list(array.shape), words_of_type(array.dtype)], None


def main(path: str, limits: list[Any]) -> None:
    """Say which datasets a file has, and answer until nothing is asked any more."""
    given = Limits(*limits)
    with contextlib.ExitStack() as opened:

        def begin() -> tuple[list[Any], Verbs]:
            source = opened.enter_context(Source(path))
            datasets = opened.enter_context(closing(Datasets(source, given)))
            return [*datasets], Server(datasets).verbs

        serve(begin, given.seconds)
