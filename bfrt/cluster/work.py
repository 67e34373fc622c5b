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


class Bands(NamedTuple):
    """Tells how a frame is divided into bands of rows.

    Attributes
    ----------
    rows : int
        Of the last bands, one for each worker: the last of them may have less.
    first : int
        Of all bands before these, as many times `rows`.
    small : int
        How many bands of `rows` there are.
    """

    rows: int
    first: int
    small: int

    def starts(self, height: int) -> list[int]:
        """Return the first row of each band, and of what would follow the last."""
        large = max(0, -(-height // self.rows) - self.small) // (self.first // self.rows)
        begin = large * self.first
        return [*range(0, begin, self.first), *range(begin, height, self.rows), height]


#: Of no frame.
NO_BANDS = Bands(0, 0, 0)


class Prepared(NamedTuple):
    """Tells that a store is ready for all tasks, and what they have in common.

    Attributes
    ----------
    memory : int
        The budget that marks were made for.
    bands : Bands
        Of the frame; none without a frame.
    part : Part
        The counters of preparing.
    """

    memory: int
    bands: Bands
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
        bands = NO_BANDS
        with self.begun(fresh_marks=True) as (session, settings):
            if frame.width:
                held = session.divide(session.store, settings, frame)
                bands = bands_of(frame, held.rows, held.rays, workers)
                frame = frame._replace(band=bands.first)
            with session.tracer(settings, frame) as tracer:
                stats = stats_of(tracer)
                tracer.begin(stats)
                return Prepared(settings.memory, bands, (this_worker().name, stats))

    def with_budget(self, prepared: Prepared) -> Work:
        """Return the same work, inside the budget that marks were made for."""
        return replace(self, asked=replace(self.asked, memory=prepared.memory))


def bands_of(frame: FrameSize, most: int, rays: int, workers: int) -> Bands:
    """Return the bands of a frame that workers share.

    A band of fewer rays than fit in memory at once only has the objects stream past more often. So
    there are as many bands as the frame fills memory times, within the limits of what evens out
    the workers' work; one worker has nothing to even out. The last ones, one for each worker, are
    half as high: who is done first takes what another would else be late with.

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
    if bands == 1 and frame.height <= most:
        return Bands(frame.height, frame.height, 1)
    rows = max(1, min(most // 2, -(-frame.height // (2 * bands - workers))))
    return Bands(rows, min(2 * rows, most), workers)


def ready(work: Work) -> Prepared:
    """Prepare a store for queries."""
    return work.prepare(NO_FRAME, 1)
