"""Plans of renders by the paper's grid."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bfrt.budget import GridCapacities
from bfrt.grid.bricks import BRICK_BYTES
from bfrt.grid.marks import open_marks
from bfrt.grid.marks_home import marks_path
from bfrt.grid.partition import partition_of, subspaces
from bfrt.grid.slabs import Slabs, cuts_of
from bfrt.phases.preprocess import grid_of, layout_of
from bfrt.planning.planned import ASSUMED, GridPlan, PhasePlan
from bfrt.planning.planner import Planner, Wave
from bfrt.settings import Refinement, Settings
from bfrt.store.store import Group, Store
from bfrt.view import Views


def _grid_plan(store: Store, group: Group, held: GridCapacities, settings: Settings) -> GridPlan:
    cut = partition_of(group, held.limits)
    layered = grid_of(store, group, cut.shape, cut.axis).layered
    layout = layout_of(group, cut, settings.refinement.hierarchy)
    path = marks_path(store, group, settings.scratch)
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


class GridPlanner(Planner[GridCapacities]):
    """Works out a plan of a render by the paper's grid."""

    def __init__(
        self, store: Store, views: Views, settings: Settings, held: GridCapacities
    ) -> None:
        super().__init__(store, views, settings, held)
        self.grids = tuple(_grid_plan(store, group, held, settings) for group in store.groups)
        self._swept = [swept_of(group, self.refinement) for group in store.groups]

    def shaded(self) -> int:
        """Return the bytes read where all objects are shaded."""
        return sum(swept.all + swept.ends + swept.materials for swept in self._swept)

    def preprocess(self) -> PhasePlan:
        """Plan the preprocess: one pass over a group for each subspace.

        With the hierarchy it leaves out what lies in others, and at best boxes above that too.
        """
        passes = objects = least = read = most = 0
        for group, grid, swept in zip(self.store.groups, self.grids, self._swept, strict=True):
            if grid.marks_there:
                continue
            n = grid.subspaces
            passes += n
            whole = swept.coded + (0 if self.refinement.lazy else swept.shapes)
            near = 1 if self.refinement.hierarchy else n
            objects += group.gridded * near
            least += whole * near + swept.levels + swept.top * (n - 1)
            read += whole * near + swept.levels * n
            most += (whole + swept.ends + swept.levels) * n
        reading = read / ASSUMED.read_rate
        marking = objects / (ASSUMED.mark_rate * self.held.threads)
        return PhasePlan(passes, least, read, most, reading + marking)

    def kept_bytes(self) -> int:
        """Return the bytes of marks that are made in several subspaces, of one group at a time."""
        made = [grid for grid in self.grids if not grid.marks_there and grid.subspaces > 1]
        return max((grid.marks_bytes for grid in made), default=0)

    def tracing(self) -> PhasePlan:
        shading = self.shading_passes(self.likely)
        read, most = self.shaded_bytes()
        passes = self.bands * shading * len(self.grids)
        for grid, swept in zip(self.grids, self._swept, strict=True):
            own = [self.bands * self._passes(wave) for wave in self.likely]
            passes += round(sum(own))
            read += sum(
                n * self._pass_bytes(wave, grid, swept)
                for n, wave in zip(own, self.likely, strict=True)
            )
            most += sum(own) * ASSUMED.passes_off * (swept.all + swept.ends)
            read += self._slab_bytes(grid, sum(own) * ASSUMED.slab_reads)
            # Rays walk twice in a pass, and a walk reads a slab twice at the most.
            most += self._slab_bytes(grid, sum(own) * ASSUMED.passes_off * 4)
        least = min(self._least_bytes(swept) for swept in self._swept)
        rays = self.eye + self.others(self.likely)
        each = 1 / ASSUMED.ray_rate + ASSUMED.tests / ASSUMED.test_rate
        seconds = read / ASSUMED.read_rate + rays * each / self.held.threads
        return PhasePlan(passes, least, max(least, int(read)), int(most), seconds)

    def _passes(self, wave: Wave) -> float:
        """Passes of one group over its objects."""
        return ASSUMED.passes + ASSUMED.passes_full * wave.rays / self.held.rays

    def _pass_bytes(self, wave: Wave, grid: GridPlan, swept: Swept) -> float:
        """Estimate the bytes read in one pass: of objects near rays, and of short gaps between.

        They are a larger part of all bytes than candidates are of all voxels, since parents are
        larger than voxels, and short gaps are read through: the root of that part fits, to a
        billion objects.
        """
        if not self.refinement.lazy:
            return swept.all
        stored = min(self.held.candidates, ASSUMED.candidates * wave.rays)
        near = min(1.0, math.sqrt(stored / math.prod(grid.voxels)))
        if not self.refinement.hierarchy:
            return swept.boxes + near * swept.shapes
        return swept.top + near * (swept.all - swept.top)

    def _least_bytes(self, swept: Swept) -> int:
        """Return the least bytes read in one pass."""
        if self.refinement.hierarchy:
            return swept.top
        return swept.boxes if self.refinement.lazy else swept.all

    def _slab_bytes(self, grid: GridPlan, readings: float) -> float:
        """Return the bytes read of marks: once a grid, or slab by slab, `readings` times."""
        if grid.slabs > 1:
            return grid.marks_bytes * readings
        entered = 1 if len(self.grids) == 1 else self.bands * len(self.likely)
        return grid.marks_bytes * entered
