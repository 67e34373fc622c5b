"""Shading: hits in the order of their objects, and the rays that go on from them.

The paper's ``shading()``: intersections that fill memory are sorted by object identifier, and one
sweep over the objects meets them in order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.ids import index_of
from bfrt.image.film import Film
from bfrt.phases._shading import GATHERED, Shader
from bfrt.phases.hit_order import HitLoads, hits_of, picked
from bfrt.phases.lighting import lighting_of
from bfrt.phases.traversal import Sink
from bfrt.phases.viewpoints import Viewpoints
from bfrt.records import HIT_BYTES, MATERIAL_BYTES, QUEUED_BYTES
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import AllRecords, Chunk
from bfrt.stats import Counters
from bfrt.store.store import Store
from bfrt.store.stream import Stream
from bfrt.streams.spool import Spool
from bfrt.workers import Workers

#: A hit that is shaded: itself, its sorted copy, its id and its place in the order.
SHADED_HIT_BYTES = 2 * HIT_BYTES + 16


class Shading:
    """Shades the hits of a render.

    Parameters
    ----------
    viewpoints : Viewpoints
        Of the views of the frame.
    hits : int
        The most hits that are shaded at once.
    workers : Workers
    """

    def __init__(
        self,
        store: Store,
        viewpoints: Viewpoints,
        film: Film,
        hits: int,
        workers: Workers,
    ) -> None:
        self._capacity = hits
        self._workers = workers
        palette = store.materials()
        lighting = lighting_of(store, viewpoints.illuminations)
        self._shaders = [
            Shader(palette, lighting, viewpoints, store.origin, film)
            for _ in range(workers.threads)
        ]

    @staticmethod
    def bytes(store: Store, threads: int) -> int:
        """Return the bytes of the palette, and of the rays that all workers gather."""
        palette = store.palette.bytes // MATERIAL_BYTES * MATERIAL_BYTES * 2
        return palette + threads * GATHERED * QUEUED_BYTES

    def shade(
        self,
        groups: list[GroupScans],
        hits: Spool,
        queue: Sink,
        last: bool,
        counters: Counters,
        between: Callable[[HitLoads], None],
    ) -> None:
        """Shade all hits, on objects of all groups; the next depth's rays go to `queue`.

        Parameters
        ----------
        last : bool
            Whether the maximum depth is reached: then there are shadow rays only.
        between : callable
            Called after each load, with the hits that are still to come.
        """
        loads = HitLoads(hits, groups, self._capacity)
        for load, begins in loads:
            for shader in self._shaders:
                shader.begin(queue.append, last)
            ids = np.ascontiguousarray(load["id"])
            for scans in groups:
                for stream in scans.streams:
                    part = hits_of(ids, stream)
                    if scans.lazy:
                        self._pick(scans, stream, load[part])
                    else:
                        self._sweep(scans, stream, load[part])
                counters.sweep(0 if scans.lazy else count_of(scans), scans, begins)
                counters.phases.shading.swept(scans)
            for shader in self._shaders:
                shader.flush()
                counters.rays.reflection += shader.reflection
                counters.rays.refraction += shader.refraction
                counters.rays.shadow += shader.shadow
            between(loads)

    def _pick(self, scans: GroupScans, stream: Stream, hits: NDArray[Any]) -> None:
        """Shade the hits on a stream's objects: only those are read."""
        if not len(hits):
            return
        source, starts = picked(scans, stream, np.ascontiguousarray(hits["id"]))

        def shade(worker: int, chunk: tuple[StreamScan, slice]) -> None:
            scan, part = chunk
            some = hits[starts[part.start] : starts[part.stop]]
            self._shaders[worker].shade_picked(scan, some)

        self._workers.drain(source, shade)

    def _sweep(self, scans: GroupScans, stream: Stream, hits: NDArray[Any]) -> None:
        """Shade the hits on a stream's objects: all are read."""
        indices = index_of(np.ascontiguousarray(hits["id"])).astype(np.int64)

        def shade(worker: int, chunk: Chunk) -> None:
            first, end = chunk.ranges[0]
            a, b = np.searchsorted(indices, [first, end])
            self._shaders[worker].shade(chunk.scan, end - first, hits[a:b])

        self._workers.drain(AllRecords(scans, stream), shade)


def count_of(scans: GroupScans) -> int:
    """Count the objects of a group."""
    return sum(stream.count for stream in scans.streams)
