"""Plans of renders by treelets."""

from __future__ import annotations

import math

from bfrt.budget import TreeCapacities
from bfrt.planned import ASSUMED, PhasePlan, TreePlan
from bfrt.planner import NOTHING, Planner, Wave
from bfrt.records import NODE_BYTES
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tree.forest import Forest
from bfrt.view import View


class TreePlanner(Planner[TreeCapacities]):
    """Works out a plan of a render by treelets."""

    def __init__(self, store: Store, view: View, settings: Settings, held: TreeCapacities) -> None:
        super().__init__(store, view, settings, held)
        self.tree = TreePlan(
            treelets=sum(stream.treelets for stream in store.streams),
            nodes=sum(stream.nodes for stream in store.streams),
            bytes=Forest.resident_bytes(store),
            resident=held.resident,
        )

    def preprocess(self) -> PhasePlan:
        """Plan nothing: treelets are made with the store."""
        return NOTHING

    def shaded(self) -> int:
        """Return the bytes read where all objects are shaded."""
        return sum(
            stream.files[name].bytes
            for stream in self.store.streams
            for name in ("geometry", "offsets", "materials", "ids")
            if name in stream.files
        )

    def tracing(self) -> PhasePlan:
        """Plan all other phases."""
        assert self.tree is not None
        a = ASSUMED
        whole = self.tree.bytes
        own = [self._passes(wave) for wave in self.likely]
        passes = round(self.bands * sum(own))
        if self.held.resident:
            read = min(1.0, self._part(self.eye)) * whole
            most = float(whole)
        else:
            near = [self._part(wave.rays) for wave in self.likely]
            read = self.bands * sum(n * part * whole for n, part in zip(own, near, strict=True))
            most = self.bands * sum(own) * a.passes_off * whole
        shaded, most_shaded = self.shaded_bytes()
        rays = self.eye + self.others(self.likely)
        seconds = (read + shaded) / a.read_rate + rays / (a.tree_rate * self.held.threads)
        least = NODE_BYTES if self.tree.treelets else 0
        return PhasePlan(
            passes + self.bands * self.shading_passes(self.likely),
            least,
            max(least, int(read + shaded)),
            int(most + most_shaded),
            seconds,
        )

    def _passes(self, wave: Wave) -> float:
        """Passes over treelets; none where they stay in memory."""
        if self.held.resident:
            return 0.0
        return ASSUMED.tree_passes + ASSUMED.tree_passes_full * wave.rays / self.held.rays

    def _part(self, rays: float) -> float:
        """Estimate which part of the treelets so many rays enter in a pass."""
        assert self.tree is not None
        if not self.tree.treelets:
            return 0.0
        return -math.expm1(-ASSUMED.entered * rays / self.tree.treelets)
