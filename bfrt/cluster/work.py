"""What a task begins with: the store, lent to it, and settings that its worker bears."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import NamedTuple

from bfrt.budget import NO_FRAME
from bfrt.cluster.asked import Asked
from bfrt.cluster.counters import Part
from bfrt.cluster.place import Place
from bfrt.cluster.stores import lent
from bfrt.cluster.worker import this_worker
from bfrt.image.frame import FrameSize
from bfrt.phases.eye import count_eye_rays
from bfrt.refusals import in_memory
from bfrt.rendering import stats_of
from bfrt.session import Session
from bfrt.settings import Settings

#: Bands of a frame for each worker: the fewest that even out their unequal work, and the most.
FEWEST_BANDS = 2
MOST_BANDS = 4


class Prepared(NamedTuple):
    """Tells that a store is ready for all tasks, and what they have in common.

    Attributes
    ----------
    memory : int
        The budget that marks were made for.
    rows : int
        Rows of each band of the frame; 0 without a frame.
    part : Part
        The counters of preparing.
    """

    memory: int
    rows: int
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

    def prepare(self, frame: FrameSize, workers: int) -> Prepared:
        """Make the marks that all tasks need, where there are none, and divide the frame.

        Parameters
        ----------
        frame : FrameSize
        workers : int
            Workers that will share it.
        """
        with self.begun(fresh_marks=True) as (session, settings):
            if frame.width:
                held = session.divide(session.store, settings, frame)
                rows = rows_of_bands(frame, held.rows, held.rays, workers)
                frame = frame._replace(band=rows)
            with session.tracer(settings, frame) as tracer:
                stats = stats_of(tracer)
                tracer.begin(stats)
                return Prepared(settings.memory, frame.band, (this_worker().name, stats))

    def with_budget(self, prepared: Prepared) -> Work:
        """Return the same work, inside the budget that marks were made for."""
        return replace(self, asked=replace(self.asked, memory=prepared.memory))


def rows_of_bands(frame: FrameSize, most: int, rays: int, workers: int) -> int:
    """Return the rows of each band of a frame that workers share.

    A band of fewer rays than fit in memory at once only has the objects stream past more often. So
    there are as many bands as the frame fills memory times, within the limits of what evens out
    the workers' work; one worker has nothing to even out.

    Parameters
    ----------
    most : int
        Rows that fit in memory.
    rays : int
        Rays that fit in memory at once.
    """
    times = math.ceil(count_eye_rays(frame) / rays)
    fewest = FEWEST_BANDS * workers if workers > 1 else 1
    bands = max(fewest, min(MOST_BANDS * workers, times))
    return max(1, min(most, -(-frame.height // bands)))


def ready(work: Work) -> Prepared:
    """Prepare a store for queries."""
    return work.prepare(NO_FRAME, 1)
