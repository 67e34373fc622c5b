"""What a task begins with: the store, lent to it, and settings that its worker bears."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

from bfrt.budget import NO_FRAME
from bfrt.cluster.asked import Asked
from bfrt.cluster.counters import Part
from bfrt.cluster.division import UNDIVIDED, Division, divided
from bfrt.cluster.place import Place
from bfrt.cluster.stores import lent
from bfrt.cluster.worker import this_worker
from bfrt.image.frame import FrameSize
from bfrt.refusals import in_memory
from bfrt.rendering import stats_of
from bfrt.session import Session
from bfrt.settings import Settings


class Prepared(NamedTuple):
    """Tells that a store is ready for all tasks, and what they have in common.

    Attributes
    ----------
    memory : int
        The budget that marks were made for.
    division : Division
        Of the frame.
    part : Part
        The counters of preparing.
    """

    memory: int
    division: Division
    part: Part


@dataclass(frozen=True)
class Work:
    """Names a store and the settings of work on it, for any worker.

    Attributes
    ----------
    place : Place
    asked : Asked
    """

    place: Place
    asked: Asked

    @contextmanager
    def begun(self, *, fresh_marks: bool = False) -> Iterator[tuple[Session, Settings]]:
        """Yield the session on the store, and the settings of this worker, while a task is done."""
        settings = self.asked.settings(this_worker(), fresh_marks=fresh_marks)
        inside = in_memory(f"{self.place.path}: tracing rays", settings.memory)
        with inside, lent(self.place) as session:
            yield session, settings

    def prepare(self, frame: FrameSize, workers: int = 1, most: int = 0) -> Prepared:
        """Make the marks that all tasks need, where there are none, and divide the frame.

        Parameters
        ----------
        frame : FrameSize
        workers : int
            Workers that will share it.
        most : int
            Pixel rows of it that the client's memory holds.
        """
        division = UNDIVIDED
        with self.begun(fresh_marks=True) as (session, settings):
            if frame.width:
                held = session.divide(session.store, settings, frame)
                division = divided(frame, min(most, workers * held.rows), held.rays, workers)
                frame = frame._replace(band=division.held)
            with session.tracer(settings, frame) as tracer:
                stats = stats_of(tracer)
                tracer.begin(stats)
                return Prepared(settings.memory, division, (this_worker().name, stats))

    def with_budget(self, prepared: Prepared) -> Work:
        """Return the same work, inside the budget that marks were made for."""
        return replace(self, asked=replace(self.asked, memory=prepared.memory))


def ready(work: Work) -> Prepared:
    """Prepare a store for queries."""
    return work.prepare(NO_FRAME)
