"""Stars along every line of sight through a galaxy, counted by two worker processes of Dask.

python cluster.py [FOLDER [PIXELS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

import dask
import dask.array as da
import numpy as np
from dask.distributed import Client, LocalCluster

import bfrt

STARS = 60_000


def stars(count: int) -> np.ndarray:
    """Centers (n, 3) in two spiral arms, thinner outwards."""
    rng = np.random.default_rng(1)
    r = rng.exponential(0.3, count) % 1.0
    angle = 5.0 * np.sqrt(r) + np.pi * rng.integers(2, size=count) + rng.normal(0, 0.35, count)
    z = rng.normal(0, 0.05, count) * np.exp(-2 * r)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def sight(pixels: int) -> tuple[da.Array, da.Array]:
    """A ray along z for every pixel, a row of the picture after another, in eight blocks."""
    number = da.arange(pixels * pixels, chunks=pixels * pixels // 8)
    x, y = (2 * (index + 0.5) / pixels - 1 for index in (number % pixels, number // pixels))
    origins = da.stack([x, -y, da.full_like(x, -1.0)], axis=1).rechunk({1: 3})
    return origins, da.broadcast_to([0.0, 0.0, 1.0], origins.shape, chunks=origins.chunks)


def main(folder: Path, pixels: int = 512) -> None:
    with bfrt.SceneWriter(folder / "galaxy.bfrt") as writer:
        writer.spheres(stars(STARS), 0.012)
    scene = bfrt.open(folder / "galaxy.bfrt")

    with LocalCluster(n_workers=2, threads_per_worker=1) as cluster, Client(cluster) as client:
        answer = scene.count_intersections(*sight(pixels), memory="256MiB")  # nothing is done yet
        crossings, stats = dask.compute(answer["counts"], answer.stats)
        for worker, own in stats.workers.items():
            print(f"{worker}: {own.total.rays.eye:,} rays")

        camera = scene.framing_camera(resolution=(pixels, pixels))  # some rows by each
        bfrt.render(scene, camera=camera, client=client).save(folder / "galaxy.png")

    light = np.log1p(crossings / 2).reshape(pixels, pixels).astype(np.float32)
    light /= light.max()
    colors = {"R": light, "G": light**1.3, "B": light**0.7, "A": np.ones_like(light)}
    bfrt.Image(colors).save(folder / "cluster.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
