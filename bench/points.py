"""Points of text, scans and openPMD, of any number, under a cap: seconds, MB/s, peak memory.

::

    python bench/points.py --points 50000000 --formats xyz xyz.gz e57 pcd h5 --memory 256MiB

Each file is made here, block by block, and converted by a process of its own inside a memory cgroup
of that size, with the file dropped from the page cache before. Needs root, for the cgroup. What is
told is of the conversion with a radius that is given; ``--radius auto`` adds two passes.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from capped import drop, run_capped
from peers import how
from saved import save

from bfrt.memory import parse_memory

BLOCK = 1 << 18

#: Numbers of a color's part.
FULL = 256


def blocks(count: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield places on hilly ground, (n, 3), millimeters of map coordinates, and colors (n, 3)."""
    random = np.random.default_rng(1)
    side = count**0.5
    for first in range(0, count, BLOCK):
        n = min(BLOCK, count - first)
        x, y = random.random((2, n)) * side
        z = 20 * np.sin(x / 97) * np.cos(y / 71) + random.random(n)
        places = np.round(np.stack([x + 5e5, y + 5.4e6, z], axis=-1), 3)
        yield places, random.integers(0, FULL, (n, 3), np.uint8)


def write_lines(path: Path, count: int) -> None:
    """Lines of x y z red green blue."""
    packed = path.suffix == ".gz"
    with gzip.open(path, "wb", 1) if packed else path.open("wb") as file:
        for places, colors in blocks(count):
            rows = np.column_stack([places, colors])
            np.savetxt(file, rows, "%.3f %.3f %.3f %d %d %d")


def write_pcd(path: Path, count: int) -> None:
    """Records of float64 places, and colors in the bits of a number."""
    head = (
        "VERSION 0.7\nFIELDS x y z rgb\nSIZE 8 8 8 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )
    row = np.dtype([("place", "<f8", 3), ("rgb", "<u4")])
    with path.open("wb") as file:
        file.write(head.encode())
        for places, colors in blocks(count):
            made = np.empty(len(places), row)
            made["place"] = places
            made["rgb"] = colors.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
            file.write(made.tobytes())


def write_e57(path: Path, count: int) -> None:
    """A scan of float32 places around where it stood, with colors."""
    import pye57
    from pye57 import libe57

    stand = np.array([5e5, 5.4e6, 0.0])
    file = pye57.E57(str(path), "w")
    image = file.image_file
    scan, prototype, pose, translation = (libe57.StructureNode(image) for _ in range(4))
    scan.set("guid", libe57.StringNode(image, "{1}"))
    for axis, place in zip("xyz", stand, strict=True):
        translation.set(axis, libe57.FloatNode(image, float(place)))
        name = f"cartesian{axis.upper()}"
        prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_SINGLE, -1e9, 1e9))
    for name in ("Red", "Green", "Blue"):
        prototype.set(f"color{name}", libe57.IntegerNode(image, 0, 0, FULL - 1))
    scan.set("pose", pose)
    pose.set("translation", translation)
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    held = np.empty((6, BLOCK))
    buffers = libe57.VectorSourceDestBuffer()
    for k in range(prototype.childCount()):
        name = prototype.get(k).elementName()
        buffers.append(libe57.SourceDestBuffer(image, name, held[k], BLOCK, True, True))
    writer = points.writer(buffers)
    for places, colors in blocks(count):
        held[:3, : len(places)], held[3:, : len(places)] = (places - stand).T, colors.T
        writer.write(len(places))
    writer.close()
    file.close()


def write_openpmd(path: Path, count: int) -> None:
    """Particles of openPMD: float32 places in cells of a meter, the cells, and colors."""
    import h5py

    with h5py.File(path, "w") as file:
        file.attrs.update({"openPMD": "1.1.0", "basePath": "/data/%T/", "particlesPath": "p/"})
        scan = file.create_group("data/0/p/scan")
        names = [f"{record}/{axis}" for record in ("position", "positionOffset") for axis in "xyz"]
        types = ["f4"] * 3 + ["i4"] * 3 + ["u1"] * 3
        for name, dtype in zip([*names, "red", "green", "blue"], types, strict=True):
            scan.create_dataset(name, (count,), dtype).attrs["unitSI"] = 1.0
        done = 0
        for places, colors in blocks(count):
            rows = slice(done, done + len(places))
            cells = np.floor(places)
            for k, name in enumerate(names):
                scan[name][rows] = (places - cells)[:, k] if k < 3 else cells[:, k - 3]
            for k, name in enumerate(("red", "green", "blue")):
                scan[name][rows] = colors[:, k]
            done += len(places)


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "xyz": write_lines,
    "xyz.gz": write_lines,
    "pcd": write_pcd,
    "e57": write_e57,
    "h5": write_openpmd,
}


def converted(path: Path, memory: str, radius: float | str) -> float:
    """Convert a file, painted by its colors; return the seconds."""
    import bfrt

    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        start = time.monotonic()
        bfrt.convert(
            path,
            Path(folder, "a.bfrt"),
            radius=radius,
            color_by="rgb",
            memory=memory,
            durable=False,
        )
        return time.monotonic() - start


def tell(name: str, path: Path, asked: argparse.Namespace) -> dict[str, Any]:
    """Convert a file under a cap; print and return what it took."""
    drop(path)
    seen = path.with_suffix(".seen")
    command = [__file__, "--one", str(path), asked.memory, asked.radius, str(seen)]
    status, peak = run_capped(command, parse_memory(asked.memory))
    size = path.stat().st_size
    told = how(status)
    row = {"format": name, "points": asked.points, "cap": asked.memory, "radius": asked.radius}
    row |= {"end": told, "bytes": size, "peak": peak}
    if not told:
        seconds = float(seen.read_text())
        row["seconds"] = seconds
        told = f"{seconds:8.2f} s {size / seconds / 1e6:8.1f} MB/s"
    print(
        f"{asked.points:10} points  {name:7} {size / 1e6:9.1f} MB  {told}  {peak >> 20} MiB "
        f"of {asked.memory}",
        flush=True,
    )
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=int, default=50_000_000)
    parser.add_argument("--formats", nargs="+", choices=WRITERS, default=[*WRITERS])
    parser.add_argument("--memory", default="256MiB")
    parser.add_argument("--radius", default="0.5", help="a number, or auto")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="for files: the system's temporary folder")
    parser.add_argument("--one", nargs=4, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.one:
        path, memory, radius, seen = asked.one
        number = radius if radius == "auto" else float(radius)
        Path(seen).write_text(str(converted(Path(path), memory, number)))
        return
    with tempfile.TemporaryDirectory(dir=asked.folder) as folder:
        rows = []
        for name in asked.formats:
            path = Path(folder, f"points.{name}")
            WRITERS[name](path, asked.points)
            rows.append(tell(name, path, asked))
            path.unlink()
            save(asked.json, rows)


if __name__ == "__main__":
    main()
