"""All objects of a group, swept by all workers: the paper's ``for (each object on disk)``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from bfrt.records import INDEX_BITS
from bfrt.scene.store import Group, Store
from bfrt.scene.sweep import Sweep

if TYPE_CHECKING:
    from bfrt.workers import Workers

#: Called with a worker's number, its sweep, and the objects [first, last) in its window.
Loop = Callable[[int, Sweep, int, int], None]

#: The fewest objects worth handing to a thread.
FEWEST = 128


class Objects:
    """Sweeps over the streams of a group, one set a worker, files shared.

    Parameters
    ----------
    buffer : int
        Bytes of one read buffer; each worker has up to three a stream.
    """

    def __init__(self, store: Store, group: Group, workers: Workers, buffer: int) -> None:
        self.group = group
        self._workers = workers
        self._sweeps: list[list[Sweep]] = []
        for stream in group.streams:
            ids = [i for i in group.outliers if i >> INDEX_BITS == stream.number]
            outliers = np.array([i & ((1 << INDEX_BITS) - 1) for i in ids], np.int64)
            first = Sweep(stream, store.origin, outliers, buffer)
            others = [
                Sweep(stream, store.origin, outliers, buffer, first.tapes)
                for _ in range(workers.threads - 1)
            ]
            self._sweeps.append([first, *others])

    def each(self, loop: Loop, streams: set[int] | None = None) -> int:
        """One pass: call `loop` for all objects, chunk by chunk; returns how many they were.

        With `streams` only those, by number, are swept.
        """
        swept = 0
        for stream, sweeps in zip(self.group.streams, self._sweeps, strict=True):
            if streams is not None and stream.number not in streams:
                continue
            for sweep in sweeps:
                sweep.rewind()

            def chunk(worker: int, first: int, last: int, sweeps: list[Sweep] = sweeps) -> None:
                sweeps[worker].window(first, last)
                loop(worker, sweeps[worker], first, last)

            self._workers.run(chunk, stream.count, smallest=FEWEST)
            swept += stream.count
        return swept

    def counts(self) -> tuple[int, int]:
        """Bytes read and seeks since the last call."""
        counts = [tape.counts() for sweeps in self._sweeps for tape in sweeps[0].tapes]
        return sum(c[0] for c in counts), sum(c[1] for c in counts)
