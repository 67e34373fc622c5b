"""All objects of a group, swept by all workers: the paper's ``for (each object on disk)``."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bfrt.records import INDEX_BITS
from bfrt.scene.store import Group, Store, Stream
from bfrt.scene.sweep import Sweep

if TYPE_CHECKING:
    from bfrt.workers import Workers

#: Called with a worker's number, its sweep, and the objects, or ranges of them, [first, last) that
#: are in its window.
Loop = Callable[[int, Sweep, int, int], None]

#: Called with a worker's number; returns ranges (n, 2) of objects, behind all that came before.
Choose = Callable[[int], NDArray[np.int64]]

#: Called with a worker's number, its sweep, and the ranges in its window.
ChosenLoop = Callable[[int, Sweep, NDArray[np.int64]], None]

#: The fewest objects worth handing to a thread.
FEWEST = 128

#: Of objects, the part that is asked for below which they may be lonely, if most are far from the
#: next, too: the system should not read ahead of those (measured: of a hundredth both ways are as
#: fast; of a third of that it takes three quarters of the time, of a twentieth one and a half times
#: as much).
LONELY = 0.01


class Objects:
    """Sweeps over the streams of a group, one set a worker, files shared.

    Parameters
    ----------
    buffer : int
        Bytes of one read buffer; each worker has up to five a stream.
    lazy : bool
        Whether geometry is read only where it is asked for.
    """

    def __init__(
        self, store: Store, group: Group, workers: Workers, buffer: int, lazy: bool
    ) -> None:
        self.group = group
        self.lazy = lazy
        self._workers = workers
        self._sweeps: dict[int, list[Sweep]] = {}
        for stream in group.streams:
            ids = [i for i in group.outliers if i >> INDEX_BITS == stream.number]
            outliers = np.array([i & ((1 << INDEX_BITS) - 1) for i in ids], np.int64)
            first = Sweep(stream, store.origin, outliers, buffer, lazy=lazy)
            others = [
                Sweep(stream, store.origin, outliers, buffer, first.tapes, lazy)
                for _ in range(workers.threads - 1)
            ]
            self._sweeps[stream.number] = [first, *others]

    def each(self, loop: Loop) -> int:
        """One pass: call `loop` for all objects, chunk by chunk; returns how many they were."""
        for stream in self.group.streams:
            self.begin(stream)

            def chunk(worker: int, first: int, last: int, stream: Stream = stream) -> None:
                sweep = self._sweeps[stream.number][worker]
                sweep.window(first, last)
                loop(worker, sweep, first, last)

            self._workers.run(chunk, stream.count, smallest=FEWEST)
        return sum(stream.count for stream in self.group.streams)

    def begin(self, stream: Stream) -> None:
        """Go back to a stream's first object."""
        for sweep in self._sweeps[stream.number]:
            sweep.rewind()
            sweep.expect(0.0)

    def some(self, stream: Stream, ranges: NDArray[np.int64], loop: Loop, *, together: int) -> None:
        """Call `loop` for ranges (n, 2) of a stream's objects, ascending, and behind those that
        were swept since `begin`; for up to so many `together`."""

        sweeps = self._sweeps[stream.number]

        def chunk(worker: int, first: int, last: int) -> None:
            sweeps[worker].window(int(ranges[first, 0]), int(ranges[last - 1, 1]))
            loop(worker, sweeps[worker], first, last)

        if len(ranges):
            _expect(sweeps, stream, ranges)
            self._workers.run(chunk, len(ranges), largest=together)

    def chosen(self, stream: Stream, choose: Choose, loop: ChosenLoop) -> int:
        """Have each worker choose ranges of a stream's objects and call `loop` for them, until
        there are none; returns how many objects they were.

        They choose in turn, so that ranges ascend; when one has failed, no other does.
        """
        sweeps = self._sweeps[stream.number]
        turn = threading.Lock()
        swept, over = 0, False

        def step(worker: int) -> bool:
            nonlocal swept, over
            with turn:
                if over:
                    return False
                over = True  # unless there is more, and no error
                ranges = choose(worker)
                if not len(ranges):
                    return False
                swept += _expect(sweeps[worker : worker + 1], stream, ranges)
                over = False
            sweeps[worker].window(int(ranges[0, 0]), int(ranges[-1, 1]))
            loop(worker, sweeps[worker], ranges)
            return True

        self._workers.repeat(step)
        return swept

    def counts(self) -> tuple[int, int]:
        """Bytes read and seeks since the last call."""
        tapes = [tape for sweeps in self._sweeps.values() for tape in sweeps[0].tapes]
        counts = [tape.counts() for tape in tapes]
        return sum(c[0] for c in counts), sum(c[1] for c in counts)

    def geometry_read(self) -> int:
        """Objects whose geometry was read since the last call."""
        return sum(sweep.counts() for sweeps in self._sweeps.values() for sweep in sweeps)


def _expect(sweeps: list[Sweep], stream: Stream, ranges: NDArray[np.int64]) -> int:
    """Have sweeps know how far apart those ranges are; returns how many objects they have."""
    asked = int((ranges[:, 1] - ranges[:, 0]).sum())
    apart = 0.0
    if asked < LONELY * int(ranges[-1, 1] - ranges[0, 0]):
        apart = float(np.median(np.diff(ranges[:, 0]))) / stream.count
    for sweep in sweeps:
        sweep.expect(apart)
    return asked
