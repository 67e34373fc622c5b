"""Normals and uv of hits, object by object: only the objects that are hit are read."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.phases.hit_order import HitLoads, hits_of, picked
from bfrt.queries._surfaces import surfaces
from bfrt.queries.answers import Fields
from bfrt.queries.extras import NO_EXTRAS, Extras
from bfrt.records import QUERY_RAY
from bfrt.scan.scan import StreamScan
from bfrt.scan.scans import GroupScans
from bfrt.stats import Counters
from bfrt.store.stream import Stream
from bfrt.streams.spool import Spool
from bfrt.tracer import Tracer
from bfrt.workers import Workers

#: A hit with its surface.
SURFACE = np.dtype(
    [
        ("number", "<u8"),
        ("t", "<f8"),
        ("key", "<u8"),
        ("normal", "<f4", 3),
        ("uv", "<f4", 2),
    ]
)


def surfaces_of(
    hits: Spool, tracer: Tracer, room: int, counters: Counters, extras: Extras = NO_EXTRAS
) -> Iterator[NDArray[Any]]:
    """Yield all hits of a spool with their surfaces, (n,) of SURFACE, by ascending id.

    Records have the fields of `extras` too.

    Parameters
    ----------
    hits : Spool
        Of records.HIT, with paths of QUERY_RAY.
    tracer : Tracer
        What it read of the scene's objects is open.
    room : int
        Hits in memory, and as many more for what is found.
    counters : Counters
        It gets what this costs.
    """
    groups = tracer.scans
    parts = 3 if extras.keys else 2
    for records, begins in HitLoads(hits, groups, max(1, room // parts)):
        some = records.view(QUERY_RAY)
        faces = Surfaces(some, tracer.workers, extras)
        for scans in groups:
            faces.find(scans)
            counters.sweep(0, scans, begins)
            counters.phases.shading.swept(scans)
        yield faces.records()
    counters.phases.shading.spooled(hits)


class Surfaces:
    """Finds normals and uv of hits.

    Parameters
    ----------
    hits : (n,) records.QUERY_RAY
        Ascending by id.
    workers : Workers
    extras : Extras
    """

    def __init__(self, hits: NDArray[Any], workers: Workers, extras: Extras) -> None:
        fields: Fields = {
            "primitive_normals": (np.float32, (3,)),
            "primitive_uvs": (np.float32, (2,)),
            **extras.fields,
        }
        self._columns = {
            key: np.empty((len(hits), *row), dtype) for key, (dtype, row) in fields.items()
        }
        self._keys = np.empty(len(hits), np.uint64)
        self._hits = hits
        self._ids = np.ascontiguousarray(hits["id"])
        self._extras = extras
        self._workers = workers

    def find(self, scans: GroupScans) -> None:
        """Find normals and uv of the hits on a group's objects."""
        for stream in scans.streams:
            part = hits_of(self._ids, stream)
            if part.start < part.stop:
                self._find(scans, stream, part)

    def _find(self, scans: GroupScans, stream: Stream, part: slice) -> None:
        source, starts = picked(scans, stream, self._ids[part])
        starts += part.start

        def resolve(_: int, chunk: tuple[StreamScan, slice]) -> None:
            scan, some = chunk
            own = slice(starts[some.start], starts[some.stop])
            columns = {key: values[own] for key, values in self._columns.items()}
            surfaces(scan, self._hits[own], self._keys[own], columns, self._extras.side)

        self._workers.drain(source, resolve)

    def records(self) -> NDArray[Any]:
        """Return the hits with what was found, (n,) of SURFACE; t is that of the rays asked."""
        hits = self._hits
        found = np.empty(len(hits), self._extras.record(SURFACE))
        found["number"], found["key"] = hits["number"], self._keys
        found["t"] = np.ldexp(hits["t"] + hits["moved"], -hits["power"])
        found["normal"] = self._columns["primitive_normals"]
        found["uv"] = self._columns["primitive_uvs"]
        for key in self._extras.keys:
            found[key] = self._columns[key]
        return found
