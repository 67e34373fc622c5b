"""The stores that this process has opened for its tasks: each once, for one task at a time.

A budget is a process's. So the tasks of a process trace one after another, each with all threads
of the worker, and only the session that was used last keeps what it has prepared.
"""

from __future__ import annotations

import atexit
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from bfrt.cluster.place import Place
from bfrt.cluster.worker import at_end_of_worker, this_worker
from bfrt.errors import BfrtError, StoreError, StreamError
from bfrt.session import Session

#: Stores that stay open: a header and a descriptor each.
MOST_OPEN = 16


class OpenStores:
    """Keeps sessions on stores until the process ends, or its worker does."""

    _tracing: threading.Lock
    _sessions: dict[Place, Session]

    def __init__(self) -> None:
        self.renew()

    @contextmanager
    def lent(self, place: Place) -> Iterator[Session]:
        """Yield the session on a store, which no other task of this process has meanwhile.

        Raises
        ------
        StoreError
            If the store cannot be opened or read as the one that is meant; the message names
            worker and path. Other errors of ours have a note with the worker's name.
        """
        with self._tracing:
            try:
                yield self._session(place)
            except StoreError as error:
                self._forget(place)
                raise StoreError(f"{this_worker().name}: {error}") from None
            except BfrtError as error:
                if hasattr(error, "add_note"):  # Python 3.11
                    error.add_note(f"found by {this_worker().name}")
                raise

    def _session(self, place: Place) -> Session:
        at_end_of_worker(self.close)
        for other, session in list(self._sessions.items()):
            if other.path == place.path and other.checksum != place.checksum:
                self._forget(other)
            elif other != place:
                session.make_room()
        if place not in self._sessions:
            if len(self._sessions) >= MOST_OPEN:
                self._forget(next(iter(self._sessions)))
            try:
                self._sessions[place] = Session(place.open())
            except StreamError as error:
                raise StoreError(str(error)) from error
        return self._sessions[place]

    def _forget(self, place: Place) -> None:
        session = self._sessions.pop(place, None)
        if session is not None:
            session.close()

    def close(self) -> None:
        """Close all sessions, unless a task is at work, which the end of the process breaks off."""
        if self._tracing.acquire(blocking=False):
            try:
                for place in list(self._sessions):
                    self._forget(place)
            finally:
                self._tracing.release()

    def renew(self) -> None:
        """Forget all, in a child of the process: it has no other thread that would end a task."""
        self._tracing = threading.Lock()
        self._sessions = {}


_STORES = OpenStores()
lent = _STORES.lent

atexit.register(_STORES.close)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_STORES.renew)
