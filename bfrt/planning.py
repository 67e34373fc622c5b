"""``bfrt.plan``: what a render would take, told before any work.

Read are the header of the store, its palette and the tables of its marks; of objects nothing. What
a budget decides comes from the code that decides it in a render, and is exact. How many rays go on,
how many passes they need and how much a pass reads depend on what they meet: these are estimates,
from `ASSUMED`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from bfrt.budget import Capacities, GridCapacities
from bfrt.grid.bricks import BRICK_BYTES
from bfrt.grid.marks import marks_path, open_marks
from bfrt.grid.partition import partition_of, subspaces
from bfrt.grid.slabs import Slabs, cuts_of
from bfrt.phases.eye import count_eye_rays
from bfrt.phases.preprocess import grid_of, layout_of
from bfrt.planned import ASSUMED, DiskPlan, GridPlan, PhasePlan, Plan, RayPlan
from bfrt.records import HIT_BYTES, QUEUED_BYTES
from bfrt.settings import Refinement, Settings
from bfrt.store.store import Group, Store
from bfrt.view import View


def plan_of(store: Store, view: View, settings: Settings, held: Capacities) -> Plan:
    """Plan a render of a view with the capacities of its budget, for `bfrt.plan`."""
    told = {
        "refine": settings.refinement.name,
        "memory": settings.memory,
        "threads": settings.threads,
        "depth": view.depth,
        "resolution": list(view.camera.resolution),
        "samples": view.samples,
        "aovs": list(view.aovs),
    }
    grids = tuple(_grid_plan(store, group, held, settings) for group in store.groups)
    return _Planner(store, view, held, settings.refinement, grids, told).plan()


def _grid_plan(store: Store, group: Group, held: Capacities, settings: Settings) -> GridPlan:
    cut = partition_of(group, held.limits)
    layered = grid_of(store, group, cut.shape, cut.axis).layered
    layout = layout_of(group, cut, settings.refinement.hierarchy)
    path = marks_path(store, group, settings.scratch_beside(store.path))
    marks = None if settings.fresh_marks else open_marks(path, store, layout)
    if marks is None:
        layers, *rest = layout.bricks
        most = np.full(layers, math.prod(rest), np.int64)
        slabs = len(cuts_of(most, held.limits.slab // BRICK_BYTES)) - 1
        size = layout.most_bytes(cut.bricks)
    else:
        marks.close()
        slabs = len(Slabs.cuts(marks, held.limits.slab)) - 1
        size = int(marks.at[-1])
    return GridPlan(
        voxels=cut.shape,
        lower=1 << cut.lower_bits,
        blocks=held.blocks if cut.lower_bits else 0,
        subspaces=sum(1 for _ in subspaces(layered, held.subspace)),
        slabs=slabs,
        slabs_known=marks is not None or slabs == 1,
        marks_there=marks is not None,
        marks_bytes=size,
    )


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


class Swept(NamedTuple):
    """Counts a group's bytes by when they are read.

    Attributes
    ----------
    top : int
        Bytes of the hierarchy's last levels, which every pass reads.
    levels : int
        Bytes of all levels.
    boxes : int
        Bytes that tell where objects are: boxes, spheres, ends of polygons.
    coded : int
        The same by quantised boxes, where there are any and the hierarchy is used.
    shapes : int
        Bytes of all other geometry.
    materials : int
    ends : int
        Of the ends of polygons, which are among the boxes: a thread that begins with a polygon
        reads once more where the one before it ends.
    """

    top: int
    levels: int
    boxes: int
    coded: int
    shapes: int
    materials: int
    ends: int

    @property
    def all(self) -> int:
        return self.levels + self.coded + self.shapes


def swept_of(group: Group, refinement: Refinement) -> Swept:
    """Return the bytes that sweeps over a group read; levels only with the hierarchy."""
    top = levels = boxes = coded = shapes = materials = ends = 0
    for stream in group.streams:
        sizes = {name: facts.bytes for name, facts in stream.files.items()}
        geometry = sizes["geometry"]
        ends += sizes.get("offsets", 0)
        own = sizes.get("boxes", geometry)
        boxes += own + sizes.get("offsets", 0)
        coded += sizes.get("quantised", own) if refinement.hierarchy else own
        coded += sizes.get("offsets", 0)
        shapes += geometry if stream.kind.boxed else 0
        materials += sizes.get("materials", 0)
        if refinement.hierarchy and stream.levels:
            above = [sizes[f"level{number}"] for number in range(1, len(stream.levels) + 1)]
            top += above[-1]
            levels += sum(above)
    return Swept(top, levels, boxes, coded, shapes, materials, ends)


class _Planner:
    """Works out a plan: that of one band of rows, times the bands."""

    def __init__(
        self,
        store: Store,
        view: View,
        held: Capacities,
        refinement: Refinement,
        grids: tuple[GridPlan, ...],
        settings: dict[str, Any],
    ) -> None:
        self._store = store
        self._held = held
        self._grids = grids
        self._settings = settings
        self._refinement = refinement
        self._frame = view.frame
        self._swept = [swept_of(group, refinement) for group in store.groups]
        width, height = settings["resolution"]
        samples, depth = settings["samples"], settings["depth"]
        self._bands = held.bands(height)
        self._eye = count_eye_rays(width, height, samples)
        # The first band is the largest, by the corners that it does not share.
        band = count_eye_rays(width, min(held.rows, height), samples)
        onward, lights = onward_rays(store), len(view.lights)
        a = ASSUMED
        self._likely = waves(
            band, depth, hits=a.hits, onward=a.onward[onward], shadows=a.facing * lights
        )
        self._most = waves(band, depth, hits=1.0, onward=onward, shadows=lights)

    def plan(self) -> Plan:
        """Return the whole plan."""
        held = self._held
        return Plan(
            objects=self._store.objects,
            scene_bytes=self._store.bytes,
            settings=self._settings,
            rays_in_flight=held.rays,
            candidates=held.candidates,
            hits=held.hits,
            queue=held.queue,
            frame_on_disk=held.frame_on_disk,
            bands=self._bands,
            grids=self._grids,
            marks_reused=all(grid.marks_there for grid in self._grids),
            rays=self._rays(),
            preprocess=self._preprocess(),
            tracing=self._tracing(),
            spool_bytes=self._bands * self._spooled(self._most),
            disk=DiskPlan(
                marks=sum(g.marks_bytes for g in self._grids if not g.marks_there),
                frame=self._frame.image_bytes if held.frame_on_disk else 0,
                spools=self._spools_at_once(),
            ),
        )

    def _rays(self) -> RayPlan:
        return RayPlan(
            eye=self._eye,
            others=self._others(self._likely),
            others_most=self._others(self._most),
        )

    def _others(self, rounds: Sequence[Wave]) -> int:
        return int(self._bands * (sum(wave.rays for wave in rounds) - rounds[0].paths))

    def _preprocess(self) -> PhasePlan:
        """Plan the preprocess: one pass over a group for each subspace.

        With the hierarchy it leaves out what lies in others, and at best boxes above that too.
        """
        passes = objects = least = read = most = 0
        for group, grid, swept in zip(self._store.groups, self._grids, self._swept, strict=True):
            if grid.marks_there:
                continue
            n = grid.subspaces
            passes += n
            whole = swept.coded + (0 if self._refinement.lazy else swept.shapes)
            near = 1 if self._refinement.hierarchy else n
            objects += group.gridded * near
            least += whole * near + swept.levels + swept.top * (n - 1)
            read += whole * near + swept.levels * n
            most += (whole + swept.ends + swept.levels) * n
        reading = read / ASSUMED.read_rate
        marking = objects / (ASSUMED.mark_rate * self._held.threads)
        return PhasePlan(passes, least, read, most, reading + marking)

    def _tracing(self) -> PhasePlan:
        shading = self._shading_passes(self._likely)
        read, most = self._shaded_bytes()
        passes = self._bands * shading * len(self._grids)
        for grid, swept in zip(self._grids, self._swept, strict=True):
            own = [self._bands * self._passes(wave) for wave in self._likely]
            passes += round(sum(own))
            read += sum(
                n * self._pass_bytes(wave, grid, swept)
                for n, wave in zip(own, self._likely, strict=True)
            )
            most += sum(own) * ASSUMED.passes_off * (swept.all + swept.ends)
            read += self._slab_bytes(grid, sum(own) * ASSUMED.slab_reads)
            # Rays walk twice in a pass, and a walk reads a slab twice at the most.
            most += self._slab_bytes(grid, sum(own) * ASSUMED.passes_off * 4)
        least = min(self._least_bytes(swept) for swept in self._swept)
        rays = self._eye + self._others(self._likely)
        each = 1 / ASSUMED.ray_rate + ASSUMED.tests / ASSUMED.test_rate
        seconds = read / ASSUMED.read_rate + rays * each / self._held.threads
        return PhasePlan(passes, least, max(least, int(read)), int(most), seconds)

    def _passes(self, wave: Wave) -> float:
        """Passes of one group over its objects."""
        return ASSUMED.passes + ASSUMED.passes_full * wave.rays / self._held.rays

    def _pass_bytes(self, wave: Wave, grid: GridPlan, swept: Swept) -> float:
        """Estimate the bytes read in one pass: of objects near rays, and of short gaps between.

        They are a larger part of all bytes than candidates are of all voxels, since parents are
        larger than voxels, and short gaps are read through: the root of that part fits, to a
        billion objects.
        """
        if not self._refinement.lazy:
            return swept.all
        stored = min(self._held.candidates, ASSUMED.candidates * wave.rays)
        near = min(1.0, math.sqrt(stored / math.prod(grid.voxels)))
        if not self._refinement.hierarchy:
            return swept.boxes + near * swept.shapes
        return swept.top + near * (swept.all - swept.top)

    def _least_bytes(self, swept: Swept) -> int:
        """Return the least bytes read in one pass."""
        if self._refinement.hierarchy:
            return swept.top
        return swept.boxes if self._refinement.lazy else swept.all

    def _slab_bytes(self, grid: GridPlan, readings: float) -> float:
        """Return the bytes read of marks: once a grid, or slab by slab, `readings` times."""
        if grid.slabs > 1:
            return grid.marks_bytes * readings
        entered = 1 if len(self._grids) == 1 else self._bands * len(self._likely)
        return grid.marks_bytes * entered

    def _shading_passes(self, rounds: Sequence[Wave]) -> int:
        """Return the number of times that hits fill memory, in a band."""
        return sum(math.ceil(wave.hits / max(1, self._held.hits)) for wave in rounds)

    def _shaded_bytes(self) -> tuple[float, float]:
        """Estimate the bytes read in shading, spools included, and the most bytes."""
        whole = sum(swept.all + swept.ends + swept.materials for swept in self._swept)
        read = self._shading_passes(self._likely) * whole
        if self._refinement.lazy:
            hits = sum(wave.hits for wave in self._likely)
            read = min(read, int(hits * ASSUMED.hit_bytes))
        most = self._shading_passes(self._most) * whole
        return (
            self._bands * float(read + self._spooled(self._likely)),
            self._bands * float(most + self._spooled(self._most)),
        )

    def _spooled(self, rounds: Sequence[Wave]) -> int:
        """Return the bytes that a band's rounds write to spools."""
        return sum(
            self._hit_bytes(wave.hits)
            + self._parted_bytes(wave.hits)
            + self._queue_bytes(wave.rays if number else 0)  # eye rays are made as they are taken
            + (len(self._grids) - 1) * self._hit_bytes(wave.rays)
            for number, wave in enumerate(rounds)
        )

    def _spools_at_once(self) -> int:
        """Return the most bytes that spools hold at once: hits, rays and next rays of a round."""
        queued = [0, *(self._queue_bytes(wave.rays) for wave in self._most[1:]), 0]
        between = min(2, len(self._grids) - 1)
        return max(
            self._hit_bytes(wave.hits)
            + self._parted_bytes(wave.hits)
            + between * self._hit_bytes(wave.rays)
            + queued[number]
            + queued[number + 1]
            for number, wave in enumerate(self._most)
        )

    def _hit_bytes(self, records: float) -> int:
        return max(0, math.ceil(records) - self._held.hits) * HIT_BYTES

    def _parted_bytes(self, hits: float) -> int:
        """Return the most bytes of hits that are parted by object, where parting saves reading."""
        parted = self._refinement.lazy and hits > self._held.hits
        return math.ceil(hits) * HIT_BYTES if parted else 0

    def _queue_bytes(self, records: float) -> int:
        return max(0, math.ceil(records) - self._held.queue) * QUEUED_BYTES
