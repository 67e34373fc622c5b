"""Where rays are traced: some shards, on the worker that runs a task."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from bfrt.cluster.asked import Asked
from bfrt.cluster.stores import lent
from bfrt.cluster.worker import running, this_worker
from bfrt.errors import SettingError
from bfrt.refusals import in_memory
from bfrt.settings import FINEST, TREE
from bfrt.store.store import Store
from bfrt.tracer import Tracer
from bfrt.wavefront.carriers import ShardPlace


@dataclass(frozen=True)
class Site:
    """Names some shards, and the settings of work on them.

    Attributes
    ----------
    place : ShardPlace
    asked : Asked
        Settings; the refinement is that of `refine`.
    refine : str, optional
        None takes the shards' own.
    """

    place: ShardPlace
    asked: Asked
    refine: str | None

    @contextmanager
    def tracer(self, *, fresh_marks: bool = False) -> Iterator[Tracer]:
        """Yield a tracer of the shards, with this worker's budget, while a task is done."""
        with lent(self.place) as session:
            refine = refinement_of(session.store, self.refine, self.asked)
            asked = replace(self.asked, refine=refine, scratch=self.asked.scratch or own_disk())
            settings = asked.settings(this_worker(), fresh_marks=fresh_marks)
            inside = in_memory(f"{self.place.path}: tracing rays", settings.memory)
            with inside, session.tracer(settings) as tracer:
                yield tracer


def own_disk() -> str | None:
    """Return the folder of this worker on its own disk, for what memory does not hold."""
    own = running()
    return None if own is None else str(own.local_directory)


def refinement_of(store: Store, refine: str | None, asked: Asked) -> str:
    """Return the refinement asked for, or that of the shards and of settings of a grid."""
    if refine == TREE and not store.ordered:
        raise SettingError(
            f"refine: found {TREE!r} for {store.path}, which has shards in the order given, "
            "expected base, sg or sgb"
        )
    gridded = asked.grid is not None or asked.max_grid is not None or asked.fresh_marks
    return refine or (TREE if store.ordered and not gridded else FINEST)
