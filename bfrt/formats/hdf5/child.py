"""The process that reads an HDF5 file for another, as long as that asks (bfrt.formats.hdf5)."""

from __future__ import annotations

import contextlib
import io
import itertools
import os
import resource
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

from numpy.typing import NDArray

from bfrt.errors import BfrtError
from bfrt.formats.hdf5.datasets import Datasets
from bfrt.formats.hdf5.messages import Channel, Ended, words_of_type
from bfrt.formats.hdf5.origins import Limits
from bfrt.formats.source import Source
from bfrt.formats.table import Array

Answer = tuple[list[Any], NDArray[Any] | None]


class Server:
    """Answers what is asked of a file's arrays.

    Each array, and each pass over one's rows, has a number by which it is asked for.
    """

    def __init__(self, datasets: Datasets) -> None:
        self._datasets = datasets
        self._arrays: list[Array] = []
        self._passes: dict[int, Iterator[NDArray[Any]]] = {}
        self._numbers = itertools.count()
        self._verbs: dict[str, Callable[..., Answer]] = {
            "has": self.has,
            "open": self.open,
            "frame": self.frame,
            "attributes": self.attributes,
            "begin": self.begin,
            "next": self.next,
            "end": self.end,
        }

    def answer(self, verb: str, *words: Any) -> Answer:
        """Return the answer to a request, or the error that it makes."""
        try:
            return self._verbs[verb](*words)
        except (BfrtError, KeyError) as error:
            return said(error), None
        except MemoryError:
            return ["MemoryError"], None

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


def said(error: BaseException) -> list[Any]:
    """Return an error as words: its kind, and what it is made of."""
    made = error.__reduce__()
    assert isinstance(made, tuple)
    return [type(error).__name__, *made[1]]


def serve(channel: Channel, path: str, limits: Limits) -> None:
    """Say which datasets a file has, and answer until nothing is asked any more."""
    end_after(limits.seconds)
    with Source(path) as source, closing(Datasets(source, limits)) as datasets:
        channel.send(["done", *datasets])
        server = Server(datasets)
        while True:
            request, _ = channel.receive()
            end_after(limits.seconds)
            channel.send(*server.answer(*request))


def end_after(seconds: int) -> None:
    """Have the system end this process when it has had the processor for so many seconds more."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    soft = int(used.ru_utime + used.ru_stime) + 1 + seconds
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    bounded = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (bounded, hard))


def main(path: str, limits: list[Any]) -> None:
    """Serve by the standard streams, of which nothing else may write into the second."""
    with io.FileIO(0, closefd=False) as source, io.FileIO(os.dup(1), "w") as target:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        channel = Channel(source, target)
        with contextlib.suppress(Ended):
            try:
                serve(channel, path, Limits(*limits))
            except BfrtError as error:
                channel.send(said(error))
            except Ended:
                raise
            except Exception:  # ours: the process that asks shows where
                channel.send(["RuntimeError", traceback.format_exc()])
