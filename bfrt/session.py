"""The session on a store that queries share: a tracer that stays ready for the next one."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bfrt.budget import NO_FRAME, Capacities, capacities
from bfrt.image.frame import FrameSize
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tracer import Tracer
from bfrt.tracing import tracer_of

#: Divides the budget of settings, for a store and a frame.
Divide = Callable[[Store, Settings, FrameSize], Capacities]


class Session:
    """Lends tracers of a store, and keeps the last one for who asks with the same settings.

    Threads may share one: while a tracer is lent, another query gets one of its own. Who closes a
    session may go on to ask.

    Parameters
    ----------
    store : Store
    divide : callable
        Divides a memory budget among rays, grid and buffers, as `bfrt.budget.capacities` does.
    """

    _kept: Tracer | None = None

    def __init__(self, store: Store, divide: Divide = capacities) -> None:
        self.store = store
        self.divide = divide
        self._frame = NO_FRAME  # of the one that is kept
        # A query may be asked, and the session closed, by what a query calls: blocks, progress.
        self._busy = threading.RLock()

    @contextmanager
    def tracer(self, settings: Settings, frame: FrameSize = NO_FRAME) -> Iterator[Tracer]:
        """Yield a tracer of these settings: the kept one where it fits and is free.

        One that was broken off is not kept, and neither is one whose marks had to be fresh.

        Parameters
        ----------
        settings : Settings
        frame : FrameSize
            The frame that shares the memory.
        """
        with self.store.folder.session(), self._free_tracer(settings, frame) as tracer:
            yield tracer

    @contextmanager
    def _free_tracer(self, settings: Settings, frame: FrameSize) -> Iterator[Tracer]:
        """Yield a tracer that no other query uses."""
        if not self._busy.acquire(blocking=False):
            with self._made(settings, frame) as other:
                yield other
            return
        try:
            kept = self._kept
            if kept is None or self._frame != frame or not kept.serves(settings):
                self._forget()
                self._kept, self._frame = self._made(settings, frame), frame
            tracer, self._kept = self._kept, None
            assert tracer is not None
            try:
                yield tracer
            except BaseException:
                tracer.close()
                raise
            if settings.fresh_marks:
                tracer.close()
            else:
                self._forget()
                self._kept, self._frame = tracer, frame
        finally:
            self._busy.release()

    def _made(self, settings: Settings, frame: FrameSize) -> Tracer:
        return tracer_of(self.store, settings, self.divide(self.store, settings, frame))

    def make_room(self) -> None:
        """Release what is kept, to make room for other work, unless it is in use."""
        if self._busy.acquire(blocking=False):
            try:
                self._forget()
            finally:
                self._busy.release()

    def close(self) -> None:
        """Release what is kept: threads, memory, open files. May be repeated."""
        with self._busy:
            self._forget()

    def __del__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()
