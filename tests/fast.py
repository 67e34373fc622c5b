"""The fast path as tests drive it: any rays, any capacities; and stores made of test scenes.

::

    rays ─► queue of records.QUEUED, pixel = the ray's index ─► bfrt.scheduler.Tracer
              kind REFLECTION: hits spool ─► t, id by pixel         (nearest)
              kind SHADOW:     film, 1 where light came ─► bool     (occluded)
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bfrt.budget import Capacities, GridCapacities
from bfrt.grid.partition import Limits
from bfrt.grid_tracer import GridTracer
from bfrt.image.film import Film
from bfrt.records import HIT, NO_HIT, QUEUED, Kind, RayKind
from bfrt.reference.exhaustive import advanced
from bfrt.reference.independent import Objects
from bfrt.settings import REFINEMENTS, Settings
from bfrt.stats import Counters
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Order
from bfrt.store.store import Group, Store, open_store
from bfrt.store.writer import StoreWriter
from bfrt.streams.spool import Spool
from bfrt.tracer import Outcome

Array = NDArray[np.float64]

#: The paper's refinements, which take a store in any order: those of a grid.
OF_GRIDS = tuple(name for name, made in REFINEMENTS.items() if not made.tree)

PAGE = 4096

#: Where shadow rays end: they count what is hit at t < this, in lengths of their direction.
SHADOW_END = float(np.nextafter(1.0 - 2.0**-30, 2.0))

#: Room for everything at once.
ROOMY = GridCapacities(
    memory=0,
    rows=1 << 16,
    frame_on_disk=False,
    limits=Limits(voxels=1 << 12, slab=1 << 30, single=1 << 24, uppers=1 << 24),
    blocks=1 << 10,
    subspace=1 << 30,
    rays=1 << 14,
    candidates=1 << 18,
    hits=1 << 14,
    queue=1 << 14,
    read_buffer=1 << 16,
    threads=1,
)


def limited(capacities: GridCapacities, **limits: int) -> Capacities:
    """The same with other limits of the grid."""
    return replace(capacities, limits=capacities.limits._replace(**limits))


#: So little of a query that all goes to disk.
TIGHT = replace(
    ROOMY, rays=61, candidates=150, hits=7, queue=11, threads=2, subspace=5000,
    limits=Limits(voxels=32**3, slab=32 * 32**2, single=8**3, uppers=1 << 24),
)  # fmt: skip

#: What may be tight, all that a budget divides; none of it may change a hit.
VARIATIONS = {
    "roomy": ROOMY,
    "one voxel": limited(ROOMY, voxels=1),
    "a few voxels": limited(replace(ROOMY, candidates=ROOMY.rays), voxels=27),
    "64^3 voxels": limited(replace(ROOMY, threads=2), voxels=64**3),
    "slabs of 8 layers": limited(ROOMY, voxels=40**3, slab=32 * 40**2),
    "slabs, subspaces, threads": limited(
        replace(ROOMY, subspace=10_000, threads=2), voxels=64**3, slab=32 * 64**2
    ),
    "upper voxels of 2": limited(replace(ROOMY, blocks=20), voxels=32**3, single=16**3),
    "upper voxels of 4": limited(replace(ROOMY, blocks=3), voxels=32**3, single=8**3),
    "no blocks": limited(replace(ROOMY, blocks=0), voxels=32**3, single=8**3),
    "one candidate a ray": replace(ROOMY, candidates=ROOMY.rays, read_buffer=PAGE),
    "some rays at a time": replace(ROOMY, rays=61, candidates=150, hits=7, queue=11, threads=2),
    "some rays, slabs, blocks": limited(
        replace(ROOMY, rays=61, candidates=150, subspace=5000), voxels=32**3, slab=32 * 32**2,
        single=8**3,
    ),
    "three threads": limited(replace(ROOMY, threads=3, read_buffer=PAGE), voxels=1 << 15),
}  # fmt: skip

#: One ray at a time, the slowest there is: for few rays.
LONELY = replace(ROOMY, rays=1, candidates=1, hits=1, queue=1, read_buffer=PAGE)


class CrowdedGroup(Group):
    """A group that asks for as many voxels as there may be, however few its objects are."""

    @property
    def gridded(self) -> int:
        return 1 << 30


def gridded(store: Store) -> Store:
    """The store with its outliers in the grid: of a small scene almost every object is one."""
    return replace(
        store,
        checksum=store.checksum ^ 1,  # other marks
        groups=[replace(g, outliers=[], grid_bounds=store.bounds) for g in store.groups],
    )


class Found(NamedTuple):
    """What `nearest` answers; `counters` are those of the trace."""

    t: Array
    ids: NDArray[np.uint64]
    counters: Counters


def nearest(
    store: Store,
    origins: ArrayLike,
    directions: ArrayLike,
    scratch: Path,
    capacities: GridCapacities = ROOMY,
    refine: str = "sgb",
) -> Found:
    """Nearest hits by the fast path.

    Parameters
    ----------
    origins, directions : (n, 3)
        Relative to the store's origin. Far origins are advanced, as eye rays are, t added back.
    """
    origins, moved = advanced(store, origins, directions)
    rays = queued(origins, directions, RayKind.REFLECTION)
    t = np.full(len(rays), np.inf)
    ids = np.full(len(rays), NO_HIT, np.uint64)
    with _traced(store, rays, scratch, capacities, refine) as (hits, film, counters):
        seen = np.zeros(len(rays), np.int64)
        while len(hits):
            some = hits.read(len(hits))
            pixels = some["pixel"]
            t[pixels] = some["t"] + moved[pixels]
            ids[pixels] = some["id"]
            np.add.at(seen, pixels, 1)
            for name in QUEUED.names or ():  # a hit must carry its own ray
                np.testing.assert_array_equal(some[name], rays[name][pixels])
        missed = _light(film) if len(rays) else np.zeros(0)
    np.testing.assert_array_equal(seen + missed, np.ones(len(rays)))  # each ray ends once
    return Found(t, ids, counters)


def occluded(
    store: Store,
    origins: ArrayLike,
    directions: ArrayLike,
    scratch: Path,
    capacities: GridCapacities = ROOMY,
    refine: str = "sgb",
) -> NDArray[np.bool_]:
    """Whether shadow rays are stopped before `SHADOW_END`."""
    rays = queued(origins, directions, RayKind.SHADOW)
    if not len(rays):
        return np.zeros(0, np.bool_)
    with _traced(store, rays, scratch, capacities, refine) as (hits, film, _):
        light = _light(film)
        assert len(hits) == 0, "a shadow ray was sent on to be shaded"
    assert set(np.unique(light)) <= {0.0, 1.0}
    return light == 0.0


def queued(origins: ArrayLike, directions: ArrayLike, kind: RayKind) -> NDArray[Any]:
    """Rays as records.QUEUED; the pixel is the index, the weight one."""
    origins, directions = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    rays = np.zeros(len(origins), QUEUED)
    for k, axis in enumerate("xyz"):
        rays["o" + axis] = origins[:, k]
        rays["d" + axis] = directions[:, k]
    rays["pixel"] = np.arange(len(rays))
    rays["red"] = 1.0
    rays["kind"] = kind
    return rays


def _light(film: Film) -> Array:
    return film.rows(0, 1)["R"][0].astype(np.float64)


@contextmanager
def _traced(
    store: Store, rays: NDArray[Any], scratch: Path, capacities: GridCapacities, refine: str
) -> Iterator[tuple[Spool, Film, Counters]]:
    crowded = replace(
        store,
        groups=[CrowdedGroup(g.number, g.streams, g.grid_bounds, g.outliers) for g in store.groups],
    )
    film = Film(max(1, len(rays)), 1, 1)
    counters = Counters()
    hits = Spool(HIT, capacities.hits, scratch)
    queue = Spool(QUEUED, capacities.queue, scratch)
    told: list[int] = []
    settings = Settings(
        memory=0, threads=capacities.threads, refinement=REFINEMENTS[refine], scratch=scratch
    )
    try:
        with GridTracer(crowded, settings, capacities) as tracer:
            counters.add(tracer.prepared)
            queue.append(rays)
            tracer.trace(
                queue, Outcome(hits, film, background=(1.0, 0.0, 0.0)), counters, told.append
            )
            assert told == sorted(told)
            assert told[-1] == len(rays)
            yield hits, film, counters
    finally:
        hits.close()
        queue.close()


#: A hierarchy that gives scenes of a few objects several levels.
DEEP = Hierarchy(s=2.0, n=6, l=4, t=0.5)

# --- stores of test scenes ---------------------------------------------------------------------


def stored(objects: Objects, dtype: type = np.float64) -> Objects:
    """The objects as a store numbers and rounds them: polygons of three vertices are triangles."""

    def rounded(table: Array) -> Array:
        return table.astype(dtype).astype(np.float64)

    three = objects.counts == 3
    inside = np.repeat(three, objects.counts)
    return Objects(
        spheres=rounded(objects.spheres),
        cones=rounded(objects.cones),
        triangles=rounded(
            np.concatenate([objects.triangles, objects.vertices[inside].reshape(-1, 9)])
        ),
        patches=rounded(objects.patches),
        vertices=rounded(objects.vertices[~inside]),
        counts=objects.counts[~three],
    )


def write(
    objects: Objects,
    path: Path,
    dtype: type = np.float64,
    origin: ArrayLike | None = None,
    order: Order = "given",
) -> Store:
    """A store of the objects, written as they are or rounded to float32."""
    tables = {
        Kind.SPHERE: objects.spheres,
        Kind.CONE: objects.cones,
        Kind.TRIANGLE: objects.triangles,
        Kind.PATCH: objects.patches,
    }
    with StoreWriter(path, origin=origin, hierarchy=DEEP, order=order) as writer:
        for kind, table in tables.items():
            if len(table):
                writer.append(kind, table.astype(dtype))
        if len(objects.counts):
            writer.append_polygons(objects.vertices.astype(dtype), objects.counts)
    return open_store(path)
