"""What it takes to write a store in spatial order, beside one in the order given.

    python bench/ordering.py sphere random 1000000 --json order.json

prints the medians of three: seconds of the whole store, and of what follows the last object.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from saved import save

from bfrt.store.ordering._loops import codes_of
from bfrt.store.writer import StoreWriter

BLOCK = 1 << 16


def centers_of(n, local):
    """Random points in a unit cube, along a Morton curve if they are to be local."""
    centers = np.random.default_rng(0).random((n, 3), np.float32)
    if not local:
        return centers
    codes = np.empty(n, np.uint64)
    codes_of(np.hstack([centers, centers]), [0, 0, 0], [1 << 10] * 3, 10, codes)
    return centers[np.argsort(codes)]


def written(path, kind, centers, order):
    """Write a store; return the seconds of all, and of its end."""
    size = np.float32(len(centers) ** (-1 / 3) / 3)
    corners = np.random.default_rng(1).normal(0, float(size), (BLOCK, 3, 3)).astype(np.float32)
    start = time.perf_counter()
    writer = StoreWriter(path, order=order, durable=False)
    for first in range(0, len(centers), BLOCK):
        some = centers[first : first + BLOCK]
        if kind == "sphere":
            writer.spheres(some, size)
        else:
            writer.triangles(some[:, None] + corners[: len(some)])
    given = time.perf_counter()
    writer.complete()
    end = time.perf_counter()
    return end - start, end - given


def measured(kind, shape, count, folder):
    """A row for each order of the store."""
    centers = centers_of(count, shape == "local")
    rows = []
    for order in ("given", "spatial"):
        runs = [written(folder / "a", kind, centers, order) for _ in range(3)]
        whole, closing = (statistics.median(times) for times in zip(*runs, strict=True))
        rate = count / closing / 1e6
        print(f"{order}: {whole:.3f} s, {closing:.3f} s at the end, {rate:.2f} M objects/s")
        row = {"kind": kind, "shape": shape, "objects": count, "order": order}
        rows.append({**row, "seconds": whole, "closing": closing})
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=("sphere", "triangle"))
    parser.add_argument("shape", choices=("local", "random"))
    parser.add_argument("number", type=int)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where stores are made")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        save(given.json, measured(given.kind, given.shape, given.number, Path(folder)))


if __name__ == "__main__":
    main()
