"""Shading: hits in the order of their objects, and the rays that go on from them.

The paper's ``shading()``: intersections that fill memory are sorted by object identifier, and one
sweep over the objects meets them in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.ids import index_of
from bfrt.image.film import Film
from bfrt.phases._shading import Shader
from bfrt.phases.hit_order import by_object, hits_of, picked
from bfrt.records import HIT_BYTES, MATERIAL_BYTES, QUEUED, QUEUED_BYTES
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.scan.sources import AllRecords, Chunk
from bfrt.stats import Counters
from bfrt.store.model import Light
from bfrt.store.store import Store, Stream
from bfrt.streams.spool import Spool
from bfrt.workers import Workers

#: A hit that is shaded: itself, its sorted copy, its id and its place in the order.
SHADED_HIT_BYTES = 2 * HIT_BYTES + 16


def light_intensity(lights: int) -> float:
    """Return sqrt(n) / (2 n), the intensity of each of n lights and of ambient light (SPD)."""
    return math.sqrt(lights) / (2 * lights)


def emit_room(lights: int) -> int:
    """Return the rays that a worker gathers while it shades: a thousand, or a few hits' rays."""
    return max(1024, 4 * (lights + 2))


class Shading:
    """Shades the hits of a render.

    Parameters
    ----------
    lights : sequence of Light
        In world coordinates.
    eye : (3,) float64
        Relative to the store's origin.
    hits : int
        The most hits that are shaded at once.
    workers : Workers
    """

    def __init__(
        self,
        store: Store,
        lights: Sequence[Light],
        film: Film,
        eye: NDArray[np.float64],
        hits: int,
        workers: Workers,
    ) -> None:
        self._capacity = hits
        self._workers = workers
        self._ambient = light_intensity(len(lights))
        self._palette = store.materials()
        origin = self._origin = np.array(store.origin)
        self._lights = np.array(
            [
                (
                    *(np.array(light.position) - origin),
                    *(self._ambient * np.array(light.color)),
                )
                for light in lights
            ]
        ).reshape(-1, 6)
        self._film = film
        self._eye = eye
        self._out = np.empty((workers.threads, emit_room(len(lights))), QUEUED)

    @staticmethod
    def bytes(store: Store, threads: int) -> int:
        """Return the bytes of the palette, and of the rays that all workers gather."""
        palette = store.palette.bytes // MATERIAL_BYTES * MATERIAL_BYTES * 2
        return palette + threads * emit_room(len(store.lights)) * QUEUED_BYTES

    def shade(
        self,
        groups: list[GroupScans],
        hits: Spool,
        queue: Spool,
        last: bool,
        counters: Counters,
    ) -> None:
        """Shade all hits, on objects of all groups; the next depth's rays go to `queue`.

        Parameters
        ----------
        last : bool
            Whether the maximum depth is reached: then there are shadow rays only.
        """
        shaders = [
            Shader(
                self._palette, self._lights, self._ambient, self._eye, self._origin, self._film,
                out, queue.append,
            )
            for out in self._out
        ]  # fmt: skip
        for load, begins in by_object(hits, groups, self._capacity):
            ids = np.ascontiguousarray(load["id"])
            for scans in groups:
                for stream in scans.streams:
                    part = hits_of(ids, stream)
                    if scans.lazy:
                        self._pick(shaders, scans, stream, load[part], last)
                    else:
                        self._sweep(shaders, scans, stream, load[part], last)
                counters.sweep(0 if scans.lazy else count_of(scans), scans, begins)
                counters.phases.shading.swept(scans)
        for shader in shaders:
            shader.flush()
            counters.rays.reflection += shader.reflection
            counters.rays.refraction += shader.refraction
            counters.rays.shadow += shader.shadow

    def _pick(
        self,
        shaders: list[Shader],
        scans: GroupScans,
        stream: Stream,
        hits: NDArray[Any],
        last: bool,
    ) -> None:
        """Shade the hits on a stream's objects: only those are read."""
        if not len(hits):
            return
        source, starts = picked(scans, stream, np.ascontiguousarray(hits["id"]))

        def shade(worker: int, chunk: tuple[StreamScan, slice]) -> None:
            scan, part = chunk
            some = hits[starts[part.start] : starts[part.stop]]
            shaders[worker].shade_picked(scan, some, last)

        self._workers.drain(source, shade)

    def _sweep(
        self,
        shaders: list[Shader],
        scans: GroupScans,
        stream: Stream,
        hits: NDArray[Any],
        last: bool,
    ) -> None:
        """Shade the hits on a stream's objects: all are read."""
        indices = index_of(np.ascontiguousarray(hits["id"])).astype(np.int64)

        def shade(worker: int, chunk: Chunk) -> None:
            first, end = chunk.ranges[0]
            a, b = np.searchsorted(indices, [first, end])
            shaders[worker].shade(chunk.scan, end - first, hits[a:b], last)

        self._workers.drain(AllRecords(scans, stream), shade)


def count_of(scans: GroupScans) -> int:
    """Count the objects of a group."""
    return sum(stream.count for stream in scans.streams)
