"""What a picture of 10^11 objects on 100 machines would take, from what travels for a small one.

::

    python bench/cluster_model.py --objects 20000 --pixels 512      count, and the model

A scene of spheres fills a cube of 2 x 2 x 2 cells, a shard and a carrier each. Its picture gives,
for each depth, rays of an eye ray, legs of a ray, hits and bytes of each record (`counted`). The
model then has a cell for each machine, as opaque as these, and the rays of another frame:

- A line through a cube of k x k x k cells meets k of them (by Cauchy's formula: each of its
  3 (k - 1) inner planes has 1/6 of the cube's surface, which a line crosses twice). Whatever the
  rays are, those beyond the first grow like k - 1; hits end some. So legs beyond the first are
  those counted times k - 1, at the most.
- The client sends and gets all records: bytes over its link. Each worker has its share of them.
- The client packs and unpacks records, and works out where each ray meets each shard: seconds of
  one thread.
- A worker traces its share of the legs; and for each block that comes to it all that is near the
  rays streams past, so many times, one block behind another along a ray's way.

Nothing here is timed on a cluster of that size; rates are assumptions, which `Machines` names.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

import bfrt
from bfrt.planning.planned import ASSUMED
from bfrt.records import HIT_BYTES, QUERY_RAY_BYTES, QUEUED_BYTES
from bfrt.shards.joining import join
from bfrt.wavefront.cargo import BLOCK
from bfrt.wavefront.travel import DepthTravel

#: Cells of the counted scene on each axis.
CELLS = 2

#: A sphere's radius, in lengths of a cell, times the square root of their number: so opaque is one.
OPACITY = 0.25


@dataclass(frozen=True)
class Machines:
    """Holds what machines are assumed to do.

    Attributes
    ----------
    count : int
        Machines, a worker and a shard each.
    link : float
        Bytes a second, each way: 10 Gbit/s.
    threads : int
        Of a worker.
    ray_rate : float
        Legs that a thread traces a second (`bfrt.planning.planned.Assumptions`).
    sweep, sweeps : float
        Seconds of a sweep over a billion objects for few rays, from disk, and sweeps of a block
        (rings 368: 40 seconds for 37 of them, in six depths: docs/performance.rst).
    pack, unpack : float
        Plain bytes that the client packs and unpacks a second, by one thread (a block of rays of
        random numbers: 0.16 and 0.08 seconds).
    route : float
        Crossings of a ray and a shard that it works out a second (a block, 125 shards: 0.97
        seconds).
    """

    count: int = 100
    link: float = 1.25e9
    threads: int = 16
    ray_rate: float = ASSUMED.ray_rate
    sweep: float = 40.0 / 37
    sweeps: float = 37 / 6
    pack: float = BLOCK * QUERY_RAY_BYTES / 0.16
    unpack: float = BLOCK * QUERY_RAY_BYTES / 0.08
    route: float = BLOCK * 125 / 0.97


class Depth(NamedTuple):
    """Holds what is counted of a depth.

    Attributes
    ----------
    rays : float
        Of an eye ray.
    legs, hits, following : float
        Of a ray of the depth: ways to a carrier, hits that are shaded, rays that go on.
    leg, found, hit, ray, film : float
        Bytes: of a leg; of what comes back of tracing, a leg; of a hit; of a ray that goes on; of
        the film, a hit.
    """

    rays: float
    legs: float
    hits: float
    following: float
    leg: float
    found: float
    hit: float
    ray: float
    film: float


class Times(NamedTuple):
    """Holds seconds of a depth, by what is at work, and the bytes through the client's link."""

    rays: float
    legs: float
    bytes: float
    client_link: float
    client_work: float
    worker_link: float
    worker_work: float
    way: float

    @property
    def limit(self) -> str:
        """Return the name of what takes longest."""
        names = ("client_link", "client_work", "worker_link", "worker_work", "way")
        return max(names, key=lambda name: float(getattr(self, name)))

    @property
    def seconds(self) -> float:
        """Return the time of the depth: that of what takes longest, as all work at once."""
        return float(getattr(self, self.limit))


def counted(travel: Sequence[DepthTravel]) -> list[Depth]:
    """Return the facts of each depth of a picture that has been made."""
    eye = travel[0].rays
    return [_fact(each, eye) for each in travel if each.rays]


def _fact(each: DepthTravel, eye: int) -> Depth:
    traced, shaded = each.tracing, each.shading
    legs, hits, rays = max(1, traced.rays), max(1, shaded.hits), max(1, shaded.rays)
    return Depth(
        rays=each.rays / eye,
        legs=traced.rays / each.rays,
        hits=shaded.hits / each.rays,
        following=shaded.rays / each.rays,
        leg=traced.bytes_sent / legs,
        found=traced.bytes_received / legs,
        hit=shaded.bytes_sent / hits,
        ray=shaded.bytes_of_rays / rays,
        film=shaded.bytes_of_film / hits,
    )


def cells_met(side: float) -> float:
    """Return the cells of a cube of side^3 that a line through it meets."""
    return 1 + 3 * (side - 1) * 2 / 6


def legs_of(side: float, legs: float) -> float:
    """Return the most legs of a ray among side^3 carriers, if it has so many among `CELLS`^3."""
    return 1 + (legs - 1) * (side - 1) / (CELLS - 1)


def bytes_of(depth: Depth, rays: float, legs: float) -> float:
    """Return the bytes that go through the client's link for so many rays, with legs each."""
    traced = legs * (depth.leg + depth.found)
    shaded = depth.hits * (depth.hit + depth.film) + depth.following * depth.ray
    return rays * (traced + shaded)


def times(depth: Depth, eye: float, machines: Machines, legs: float | None = None) -> Times:
    """Return the seconds of a depth of a frame with so many eye rays."""
    side = machines.count ** (1 / 3)
    legs = legs_of(side, depth.legs) if legs is None else legs
    rays = eye * depth.rays
    moved = bytes_of(depth, rays, legs)
    sent = rays * (legs * QUERY_RAY_BYTES + depth.hits * HIT_BYTES)
    back = rays * depth.following * QUEUED_BYTES
    work = sent / machines.pack + back / machines.unpack + rays * machines.count / machines.route
    blocks = max(1.0, rays * legs / machines.count / BLOCK)
    streamed = machines.sweep * machines.sweeps
    traced = rays * legs / machines.count / (machines.threads * machines.ray_rate)
    return Times(
        rays=rays,
        legs=rays * legs,
        bytes=moved,
        client_link=moved / machines.link,
        client_work=work,
        worker_link=moved / machines.count / machines.link,
        worker_work=traced + blocks * streamed,
        way=legs * streamed,
    )


def scene_of(folder: Path, objects: int, cells: int, pixels: int) -> Path:
    """Write spheres, a fifth of them mirrors and a fifth of glass, in cells^3 shards."""
    stores = []
    for number in range(cells**3):
        corner = np.array([number % cells, number // cells % cells, number // cells**2])
        rng = np.random.default_rng(number)
        path = folder / f"cell{number}.bfrt"
        settings = {"dtype": "float32", "durable": False, "origin": (0, 0, 0)}
        with bfrt.SceneWriter(path, **settings) as writer:
            kinds = [bfrt.Material((0.8, 0.6, 0.4)), bfrt.Material(ks=0.6), bfrt.Material(
                (0.7, 0.8, 1.0), kd=0.2, ks=0.2, transmittance=0.6, ior=1.3)]  # fmt: skip
            names = np.array([writer.material(kind) for kind in kinds])
            centers = corner + rng.uniform(0, 1, (objects, 3))
            which = names[rng.choice(3, objects, p=[0.6, 0.2, 0.2])]
            writer.spheres(centers, OPACITY / np.sqrt(objects), which)
            writer.light(bfrt.Light((3.0 * cells, -2.0 * cells, 4.0 * cells)))
            writer.camera(
                bfrt.Camera((2.6 * cells, -1.4 * cells, 1.9 * cells), (cells / 2,) * 3, (0, 0, 1),
                            12, resolution=(pixels, pixels))
            )  # fmt: skip
        stores.append(bfrt.open(path).store)
    join(folder / "cells.bfrts", stores)
    return folder / "cells.bfrts"


def traffic_table(travel: Sequence[DepthTravel]) -> str:
    """Return what has travelled, in bytes a ray of each depth."""
    head = "depth      rays  legs  trace out  back  hits  shade out  rays back  film back  in all"
    rows = [
        f"{n:5} {int(d.rays * travel[0].rays):9,} {d.legs:5.2f} {d.legs * d.leg:10.1f}"
        f" {d.legs * d.found:5.1f} {d.hits:5.2f} {d.hits * d.hit:10.1f}"
        f" {d.following * d.ray:10.1f} {d.hits * d.film:10.1f} {bytes_of(d, 1, d.legs):7.1f}"
        for n, d in enumerate(counted(travel), 1)
    ]
    return "\n".join([head, *rows])


def model_table(found: Sequence[Times]) -> str:
    """Return the seconds of each depth, and of all."""
    head = "depth   M rays   M legs     GB  link  client  workers' link  workers    way  limit"
    rows = [
        f"{n:5} {t.rays / 1e6:8.2f} {t.legs / 1e6:8.2f} {t.bytes / 1e9:6.2f} {t.client_link:5.2f}"
        f" {t.client_work:7.1f} {t.worker_link:14.3f} {t.worker_work:8.1f} {t.way:6.1f}  {t.limit}"
        for n, t in enumerate(found, 1)
    ]
    return "\n".join([head, *rows, f"in all {sum(t.seconds for t in found):.0f} seconds"])


def main() -> None:
    made = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    made.add_argument("--objects", type=int, default=20_000, help="of each of eight cells")
    made.add_argument("--pixels", type=int, default=512, help="of the counted picture, a side")
    made.add_argument("--frame", type=int, default=1920 * 1080, help="eye rays of the model")
    options = made.parse_args()
    import distributed

    with (
        tempfile.TemporaryDirectory() as folder,
        distributed.LocalCluster(
            n_workers=CELLS**3, threads_per_worker=1, processes=False, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        path = scene_of(Path(folder), options.objects, CELLS, options.pixels)
        image = bfrt.open(path, client=client).render(memory="160MiB", threads=1)
    print(traffic_table(image.stats.travel))
    print()
    print(model_table([times(d, options.frame, Machines()) for d in counted(image.stats.travel)]))


if __name__ == "__main__":
    main()
