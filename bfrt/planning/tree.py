"""Plans of renders by treelets."""

from __future__ import annotations

import math

from bfrt.budget import TreeCapacities
from bfrt.planning.planned import ASSUMED, PhasePlan, TreePlan
from bfrt.planning.planner import NOTHING, Planner, Wave
from bfrt.records import NODE_BYTES
from bfrt.settings import Settings
from bfrt.store.store import Store
from bfrt.tree.forest import Forest
from bfrt.view import Views


class TreePlanner(Planner[TreeCapacities]):
    """Works out a plan of a render by treelets."""

    def __init__(
        self, store: Store, views: Views, settings: Settings, held: TreeCapacities
    ) -> None:
        super().__init__(store, views, settings, held)
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
        active = [rays for wave in self.likely for rays in self._passes(wave)]
        passes = self.bands * len(active)
        if self.held.resident:
            read = min(1.0, self._part(self.eye)) * whole
            most = float(whole)
        else:
            # Nodes of treelets that have a sketch are not read again.
            sketched = min(1.0, self.held.kept / Forest.kept_bytes(self.store))
            once = sketched * self.tree.nodes * NODE_BYTES
            streamed = whole - once
            visits = self.bands * sum(map(self._part, active))
            read = once + visits * a.tree_read * streamed
            most = once + passes * a.passes_off * streamed
        shaded, most_shaded = self.shaded_bytes()
        rays = self.eye + self.others(self.likely)
        seconds = read / a.tree_read_rate + shaded / a.read_rate
        seconds += rays / (a.tree_rate * self.held.threads)
        least = NODE_BYTES if self.tree.treelets else 0
        return PhasePlan(
            passes + self.bands * self.shading_passes(self.likely),
            least,
            max(least, int(read + shaded)),
            int(most + most_shaded),
            seconds,
        )

    def _passes(self, wave: Wave) -> list[float]:
        """Estimate the rays of each pass over treelets; none where they stay in memory."""
        if self.held.resident:
            return []
        full = round(ASSUMED.tree_passes_full * wave.rays / self.held.rays)
        active = [float(self.held.rays)] * full
        left = min(wave.rays, self.held.rays) * (ASSUMED.tree_left if full else 1.0)
        while left >= 1.0:
            active.append(left)
            left *= ASSUMED.tree_left
        return active

    def _part(self, rays: float) -> float:
        """Estimate which part of the treelets so many rays enter in a pass."""
        assert self.tree is not None
        if not self.tree.treelets:
            return 0.0
        # Rays of a band see a strip of the scene, and what its mirrors show.
        seen = ASSUMED.seen / math.sqrt(self.bands)
        return -seen * math.expm1(-ASSUMED.entered * rays / self.tree.treelets)
