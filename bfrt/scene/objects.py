"""All objects of a group, swept by all workers: the paper's ``for (each object on disk)``."""

from __future__ import annotations

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

#: Called with a worker's number; returns ranges (n, 2) of objects, behind all that came before, and
#: whether their boxes were asked for.
Choose = Callable[[int], tuple[NDArray[np.int64], bool]]

#: Called with a worker's number, its sweep, and the ranges in its window.
ChosenLoop = Callable[[int, Sweep, NDArray[np.int64]], None]

#: Called with a worker's number and its sweep, which has come to its end.
End = Callable[[int, Sweep], None]

#: The fewest objects worth handing to a thread.
FEWEST = 128


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
            self.sweep(stream, loop)
        return sum(stream.count for stream in self.group.streams)

    def sweep(self, stream: Stream, loop: Loop) -> None:
        """Call `loop` for all objects of a stream, chunk by chunk."""

        def chunk(worker: int, first: int, last: int) -> None:
            sweep = self._sweeps[stream.number][worker]
            sweep.window(first, last)
            loop(worker, sweep, first, last)

        self._begin(stream, asked=False)
        self._workers.run(chunk, stream.count, smallest=FEWEST)

    def pick(self, stream: Stream, ranges: NDArray[np.int64], loop: Loop, *, together: int) -> None:
        """Call `loop` for ranges (n, 2) of a stream's objects, one in each, ascending; for up to so
        many `together`."""
        sweeps = self._sweeps[stream.number]

        def chunk(worker: int, first: int, last: int) -> None:
            sweeps[worker].picks(ranges[first:last])
            loop(worker, sweeps[worker], first, last)

        # Where everything is read in a pass, files are open for that way only.
        self._begin(stream, asked=self.lazy)
        self._workers.run(chunk, len(ranges), largest=together)

    def chosen(self, stream: Stream, choose: Choose, loop: ChosenLoop) -> int:
        """Have each worker choose ranges of a stream's objects and call `loop` for them, until
        there are none; returns how many objects they were."""
        sweeps = self._sweeps[stream.number]
        swept = [0] * len(sweeps)

        def step(worker: int) -> bool:
            ranges, asked = choose(worker)
            if len(ranges):
                swept[worker] += int((ranges[:, 1] - ranges[:, 0]).sum())
                sweeps[worker].chosen(ranges, asked)
                loop(worker, sweeps[worker], ranges)
            return len(ranges) > 0

        self._workers.repeat(step)
        return sum(swept)

    def begin_chosen(self, stream: Stream) -> Callable[[NDArray[np.int64]], None]:
        """Go back to a stream's first object, to sweep what is chosen; returns what has the system
        begin to read the boxes of ranges that will be."""
        self._begin(stream, asked=True)
        return self._sweeps[stream.number][0].ask

    def _begin(self, stream: Stream, asked: bool) -> None:
        for sweep in self._sweeps[stream.number]:
            sweep.rewind(asked)

    def end(self, stream: Stream, last: End) -> None:
        """Have each worker call `last` for its sweep of a stream."""

        def step(worker: int) -> bool:
            last(worker, self._sweeps[stream.number][worker])
            return False

        self._workers.repeat(step)

    def counts(self) -> tuple[int, int]:
        """Bytes read and seeks since the last call."""
        tapes = [tape for sweeps in self._sweeps.values() for tape in sweeps[0].tapes]
        counts = [tape.counts() for tape in tapes]
        return sum(c[0] for c in counts), sum(c[1] for c in counts)

    def geometry_read(self) -> int:
        """Objects whose geometry was read since the last call."""
        return sum(sweep.counts() for sweeps in self._sweeps.values() for sweep in sweeps)
