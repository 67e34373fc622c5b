"""What all plans have in common: rays, hits, spools, the frame."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from bfrt.budget import Capacities
from bfrt.image.frame import IMAGE_BAND
from bfrt.phases.eye import count_eye_rays
from bfrt.planning.ordering import ordering_of
from bfrt.planning.planned import ASSUMED, DiskPlan, GridPlan, PhasePlan, Plan, RayPlan, TreePlan
from bfrt.records import HIT_BYTES, PATH_BYTES, QUEUED_BYTES, RAY_BYTES
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.view import Views

Held = TypeVar("Held", bound=Capacities)

#: Of a checkpoint there are two for a moment: the one that is written, and the one before.
GENERATIONS = 2

#: Bytes of a state's header, with the counters of some depths.
STATE_TABLE_BYTES = 1 << 16

#: No work.
NOTHING = PhasePlan(0, 0, 0, 0, 0.0)


class Wave(NamedTuple):
    """Counts the rays of one round of the depth loop, and the hits that are to be shaded."""

    paths: float
    shadows: float
    hits: float

    @property
    def rays(self) -> float:
        return self.paths + self.shadows


def waves(eye: int, depth: int, *, hits: float, onward: float, shadows: float) -> list[Wave]:
    """Estimate the rounds of eye rays; a hit sends `onward` rays and `shadows` shadow rays."""
    made = [Wave(eye, 0.0, eye * hits)]
    for number in range(1, depth + 1):
        before = made[-1].hits
        paths = before * onward if number < depth else 0.0
        made.append(Wave(paths, before * shadows, paths * hits))
    return [wave for wave in made if wave.rays]


def onward_rays(store: Store) -> int:
    """Return the number of rays that may go on from a hit: reflected, and refracted."""
    palette = store.materials()
    if (palette["transmittance"] > 0).any():
        return 2
    return int((palette["ks"] > 0).any())


class Planner(ABC, Generic[Held]):
    """Works out a plan: that of one band of rows, times the bands.

    Parameters
    ----------
    store : Store
    views : Views
    settings : Settings
    held : Capacities
        What the budget holds.

    Attributes
    ----------
    bands : int
        Bands of rows.
    likely, most : list of Wave
        The rounds of the depth loop in a band, as they are likely, and the most.
    """

    grids: tuple[GridPlan, ...] = ()
    tree: TreePlan | None = None

    def __init__(self, store: Store, views: Views, settings: Settings, held: Held) -> None:
        self.store = store
        self.held = held
        self.refinement = settings.refinement
        self._settings: dict[str, Any] = {
            "refine": settings.refinement.name,
            "memory": settings.memory,
            "threads": settings.threads,
            "depth": views.depth,
            "resolution": list(views.cameras[0].resolution),
            "views": len(views.each),
            "samples": views.samples,
            "aovs": list(views.aovs),
            "ao": views.illumination.ao,
        }
        frame = self._frame = views.frame
        self.bands = held.bands(frame.height)
        self.eye = count_eye_rays(frame)
        # The first band is the largest, by the corners that it does not share.
        band = count_eye_rays(frame, min(held.rows, frame.height))
        onward, light, a = onward_rays(store), views.illumination, ASSUMED
        shadows = a.facing * len(light.lights) + light.ao
        self.likely = waves(
            band, views.depth, hits=a.hits, onward=a.onward[onward], shadows=shadows
        )
        self.most = waves(band, views.depth, hits=1.0, onward=onward, shadows=light.shadow_rays)

    @abstractmethod
    def preprocess(self) -> PhasePlan:
        """Plan what comes before rays."""

    @abstractmethod
    def tracing(self) -> PhasePlan:
        """Plan all other phases."""

    @abstractmethod
    def shaded(self) -> int:
        """Return the bytes read where all objects are shaded."""

    def plan(self, kept: bool = False) -> Plan:
        """Return the whole plan, of a render whose state is kept in a checkpoint, or not."""
        held = self.held
        return Plan(
            objects=self.store.objects,
            scene_bytes=self.store.bytes,
            settings=self._settings,
            rays_in_flight=held.rays,
            candidates=held.candidates,
            hits=held.hits,
            queue=held.queue,
            frame_on_disk=held.frame_on_disk,
            bands=self.bands,
            grids=self.grids,
            tree=self.tree,
            marks_reused=bool(self.grids) and all(g.marks_there for g in self.grids),
            rays=self._rays(),
            preprocess=self.preprocess(),
            tracing=self.tracing(),
            spool_bytes=self.bands * self.spooled(self.most),
            ordering=ordering_of(self.store),
            disk=DiskPlan(
                marks=sum(g.marks_bytes for g in self.grids if not g.marks_there),
                frame=self._frame.image_bytes if held.frame_on_disk else 0,
                spools=self._spools_at_once(),
                checkpoint=GENERATIONS * self._state_bytes() + self.kept_bytes() if kept else 0,
            ),
        )

    def _rays(self) -> RayPlan:
        return RayPlan(
            eye=self.eye, others=self.others(self.likely), others_most=self.others(self.most)
        )

    def others(self, rounds: Sequence[Wave]) -> int:
        return int(self.bands * (sum(wave.rays for wave in rounds) - rounds[0].paths))

    def shading_passes(self, rounds: Sequence[Wave]) -> int:
        """Return the number of times that hits fill memory, in a band."""
        return sum(math.ceil(wave.hits / max(1, self.held.hits)) for wave in rounds)

    def shaded_bytes(self) -> tuple[float, float]:
        """Estimate the bytes read in shading, spools included, and the most bytes."""
        whole = self.shaded()
        read = self.shading_passes(self.likely) * whole
        if self.refinement.lazy:
            hits = sum(wave.hits for wave in self.likely)
            read = min(read, int(hits * ASSUMED.hit_bytes))
        most = self.shading_passes(self.most) * whole
        return (
            self.bands * float(read + self.spooled(self.likely)),
            self.bands * float(most + self.spooled(self.most)),
        )

    def spooled(self, rounds: Sequence[Wave]) -> int:
        """Return the bytes that a band's rounds write to spools."""
        return sum(
            self._hit_bytes(wave.hits)
            + self._parted_bytes(wave.hits)
            + self._queue_bytes(wave.rays if number else 0)  # eye rays are made as they are taken
            + max(0, len(self.grids) - 1) * self._hit_bytes(wave.rays)
            for number, wave in enumerate(rounds)
        )

    def _spools_at_once(self) -> int:
        """Return the most bytes that spools hold at once: hits, rays and next rays of a round."""
        queued = [0, *(self._queue_bytes(wave.rays) for wave in self.most[1:]), 0]
        between = min(2, max(0, len(self.grids) - 1))
        return max(
            self._hit_bytes(wave.hits)
            + self._parted_bytes(wave.hits)
            + between * self._hit_bytes(wave.rays)
            + queued[number]
            + queued[number + 1]
            for number, wave in enumerate(self.most)
        )

    def kept_bytes(self) -> int:
        """Return the most bytes that a checkpoint keeps beside its states."""
        return 0

    def _state_bytes(self) -> int:
        """Return the most bytes of a state between two passes; the film and the picture are whole.

        While a depth is traced each ray is in one place: it waits, or is in flight, or is a hit, or
        waits between groups. While hits are shaded the next rays come.
        """
        film = self._frame.band_bytes(min(self.held.rows, self._frame.height)) - IMAGE_BAND
        flight = RAY_BYTES + PATH_BYTES - HIT_BYTES  # more than anywhere else
        following = [*(wave.rays for wave in self.most[1:]), 0.0]
        rays = max(
            max(
                wave.rays * HIT_BYTES + min(wave.rays, self.held.rays) * flight,
                wave.hits * HIT_BYTES + following[number] * QUEUED_BYTES,
            )
            for number, wave in enumerate(self.most)
        )
        return math.ceil(rays) + film + self._frame.image_bytes + STATE_TABLE_BYTES

    def _hit_bytes(self, records: float) -> int:
        return max(0, math.ceil(records) - self.held.hits) * HIT_BYTES

    def _parted_bytes(self, hits: float) -> int:
        """Return the most bytes of hits that are parted by object, where parting saves reading."""
        parted = self.refinement.lazy and hits > self.held.hits
        return math.ceil(hits) * HIT_BYTES if parted else 0

    def _queue_bytes(self, records: float) -> int:
        return max(0, math.ceil(records) - self.held.queue) * QUEUED_BYTES
