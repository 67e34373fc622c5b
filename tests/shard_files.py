"""Files that become shards, and what is looked at of those."""

from __future__ import annotations

import numpy as np
from sharded_scenes import rays

#: Where the objects are.
FAR = np.array([1e5, 2e5, 0.0])

ASKED = {"radius": 0.5, "durable": False}


def snapshots(folder):
    """Five files of spheres, NumPy's, in float64, far from the origin; two are empty."""
    made = []
    for number, count in enumerate([0, 40, 0, 160, 200]):
        rng = np.random.default_rng(number)
        path = folder / f"snapshot{number}.npy"
        np.save(path, rng.uniform(-5, 5, (count, 3)) + FAR)
        made.append(path)
    return made


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def made_at(path):
    """When a store's header, or a file, was written."""
    return (path / "scene.json" if path.is_dir() else path).stat().st_mtime_ns


def rays_here():
    """Rays through the files' spheres."""
    origins, directions = rays()
    return origins + FAR, directions
