"""Shading: hits in the order of their objects, and the rays that go on from them.

The paper's ``shading()``: intersections that fill memory are sorted by object identifier, and one
sweep over the objects meets them in order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.film import Film
from bfrt.phases._shading import Shader
from bfrt.phases.picking import by_object, each_hit
from bfrt.records import HIT_BYTES, INDEX_BITS, MATERIAL_BYTES, QUEUED, QUEUED_BYTES
from bfrt.stats import Counters
from bfrt.store.model import Light
from bfrt.store.objects import Objects
from bfrt.store.store import Store
from bfrt.store.sweep import Sweep
from bfrt.streams.spool import Spool

#: A hit that is shaded: itself, its sorted copy, its id and its place in the order.
SHADED_HIT_BYTES = 2 * HIT_BYTES + 16


def light_intensity(lights: int) -> float:
    """sqrt(n) / (2 n), for each of n lights and for the ambient one: the SPD text's formula."""
    return math.sqrt(lights) / (2 * lights)


def emit_room(lights: int) -> int:
    """Rays that a worker gathers while it shades: a thousand, or a few hits' worth."""
    return max(1024, 4 * (lights + 2))


class Shading:
    """The shading phase of a render.

    Parameters
    ----------
    lights : sequence of Light
        In world coordinates.
    eye : (3,) float64
        Relative to the store's origin.
    hits : int
        That are shaded at once, at the most.
    threads : int
    """

    def __init__(
        self,
        store: Store,
        lights: Sequence[Light],
        film: Film,
        eye: NDArray[np.float64],
        hits: int,
        threads: int,
    ) -> None:
        self._capacity = hits
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
        self._out = np.empty((threads, emit_room(len(lights))), QUEUED)

    @staticmethod
    def bytes(store: Store, threads: int) -> int:
        """Return the bytes of the palette, and of the rays that so many workers gather."""
        palette = store.palette.bytes // MATERIAL_BYTES * MATERIAL_BYTES * 2
        return palette + threads * emit_room(len(store.lights)) * QUEUED_BYTES

    def shade(
        self,
        groups: list[Objects],
        hits: Spool,
        queue: Spool,
        last: bool,
        counters: Counters,
    ) -> None:
        """Shade all hits, on objects of all groups; the next depth's rays go to `queue`."""
        for load, begins in by_object(hits, groups, self._capacity):
            self._sweep(groups, load, begins, queue.append, last, counters)

    def _sweep(
        self,
        groups: list[Objects],
        hits: NDArray[Any],
        begins: bool,
        emit: Callable[[NDArray[Any]], None],
        last_depth: bool,
        counters: Counters,
    ) -> None:
        ids = np.ascontiguousarray(hits["id"])
        shaders = [
            Shader(
                self._palette,
                self._lights,
                self._ambient,
                self._eye,
                self._origin,
                self._film,
                out,
                emit,
            )
            for out in self._out
        ]

        def loop(worker: int, sweep: Sweep, first: int, last: int) -> None:
            sweep.material_window(first, last)
            stream = sweep.number << INDEX_BITS
            a, b = np.searchsorted(ids, np.array([stream + first, stream + last], np.uint64))
            shaders[worker].shade(sweep, last - first, hits[a:b], last_depth)

        def pick(worker: int, sweep: Sweep, a: int, b: int) -> None:
            shaders[worker].shade_picked(sweep, hits[a:b], last_depth)

        for objects in groups:
            if objects.lazy:
                each_hit(objects, ids, pick)
                counters.sweep(0, objects, begins)
            else:
                counters.sweep(objects.each(loop), objects)
            counters.phases.shading.swept(objects)
        for shader in shaders:
            shader.flush()
            counters.rays.reflection += shader.reflection
            counters.rays.refraction += shader.refraction
            counters.rays.shadow += shader.shadow
