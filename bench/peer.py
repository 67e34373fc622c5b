"""One program's way from a PLY file to where a million rays hit it, as a process.

::

    python bench/peer.py open3d terrain.ply rays hits.npy --memory 1GiB

The folder ``rays`` has origins.npy and directions.npy, (n, 3) float32; the answer is each ray's t,
float32, inf where it hits nothing. `--rounds` asks again after the first answer and prints the
seconds of each: what a ray costs where the scene is loaded.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

Ask = Callable[[], np.ndarray]


def bfrt(ply: Path, rays: Path, memory: str) -> Ask:
    """A store is made beside the file, and removed at the end. Rays are read from their files, and
    t goes to one: arrays would be beside the budget."""
    import bfrt

    folder = tempfile.TemporaryDirectory(dir=ply.parent)
    store = Path(folder.name) / "scene.bfrt"
    scene = bfrt.convert(ply, store, memory=memory, durable=False)

    def ask() -> np.ndarray:
        out = tempfile.mkdtemp(dir=folder.name)
        files = rays / "origins.npy", rays / "directions.npy"
        return scene.cast_rays(*files, memory=memory, out=out)["t_hit"]

    return ask


def loaded(rays: Path) -> tuple[np.ndarray, np.ndarray]:
    return np.load(rays / "origins.npy"), np.load(rays / "directions.npy")


def open3d(ply: Path, rays: Path, memory: str) -> Ask:
    import open3d as o3d

    mesh = o3d.t.io.read_triangle_mesh(str(ply))
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh)
    tensor = o3d.core.Tensor(np.hstack(loaded(rays)))
    return lambda: scene.cast_rays(tensor)["t_hit"].numpy()


def trimesh(ply: Path, rays: Path, memory: str) -> Ask:
    """trimesh with embreex: it gives places, of which t is made."""
    import trimesh

    mesh = trimesh.load(ply, process=False)
    assert type(mesh.ray).__module__.endswith("ray_pyembree")

    origins, directions = loaded(rays)

    def ask() -> np.ndarray:
        places, index, _ = mesh.ray.intersects_location(origins, directions, multiple_hits=False)
        t = np.full(len(origins), np.inf)
        along = ((places - origins[index]) * directions[index]).sum(axis=1)
        t[index] = along / (directions[index] ** 2).sum(axis=1)
        return t

    return ask


def mitsuba(ply: Path, rays: Path, memory: str) -> Ask:
    """On the processor, by LLVM and Embree."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    scene = mi.load_dict({"type": "scene", "mesh": {"type": "ply", "filename": str(ply)}})

    o, d = (mi.Point3f(np.ascontiguousarray(part.T)) for part in loaded(rays))

    def ask() -> np.ndarray:
        found = scene.ray_intersect_preliminary(mi.Ray3f(o, mi.Vector3f(d)))
        return np.array(dr.select(found.is_valid(), found.t, dr.inf))

    return ask


PEERS = {"bfrt": bfrt, "open3d": open3d, "trimesh": trimesh, "mitsuba": mitsuba}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("peer", choices=tuple(PEERS))
    parser.add_argument("ply", type=Path)
    parser.add_argument("rays", type=Path)
    parser.add_argument("hits", type=Path)
    parser.add_argument("--memory", default="1GiB", help="of bfrt")
    parser.add_argument("--rounds", type=int, default=0)
    arguments = parser.parse_args()
    ask = PEERS[arguments.peer](arguments.ply, arguments.rays, arguments.memory)
    np.save(arguments.hits, ask().astype(np.float32))
    for _ in range(arguments.rounds):
        start = time.perf_counter()
        ask()
        print(f"{time.perf_counter() - start:.4f}")


if __name__ == "__main__":
    main()
