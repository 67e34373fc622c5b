"""A terrain of a GeoTIFF: into a store, and what is seen of it, beside GDAL's viewshed.

::

    python bench/terrain.py --sides 1000 10000 --caps 256MiB

A raster of SIDE x SIDE heights is made, a fractal of 10 m pixels, tiled and packed. Each program is
a process of its own inside a memory cgroup, in turn, with its files dropped from the page cache
before: `bfrt convert`, `bfrt viewshed` and `gdal_viewshed`, the latter two without curvature and
with GDAL's usual one. Told are seconds, the cgroup's peak or how it died, and how much is seen.
GDAL's is given all the memory there is. Then: how many pixels the two see otherwise, how many of
those are beside a border of what is seen, and of a sample of them who has a third opinion on his
side: the heights, interpolated between four pixels, along the line of sight. Needs root, for the
cgroup, rasterio and gdal_viewshed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from capped import drop, run_capped
from peers import how
from saved import save

from bfrt.memory import parse_memory

PIXEL = 10.0
HEIGHT, TARGET = 2.0, 0.0
REFRACTION = 1 / 7

#: All the memory that there is.
NO_CAP = 1 << 60

#: Runs another program in place of Python.
OTHER = "import os, sys; os.execvp(sys.argv[1], sys.argv[1:])"

#: Pixels that are looked at a third time, and points of a pixel's length on the way to each.
SAMPLE, POINTS = 2000, 8


def fractal(side: int, seed: int = 7) -> np.ndarray:
    """Heights (side, side) float32 from 0 to 1,500, of a spectrum as mountains have."""
    along, down = np.fft.rfftfreq(side), np.fft.fftfreq(side)
    frequency = np.hypot(down[:, None], along).astype(np.float32)
    frequency[0, 0] = np.inf
    rng = np.random.default_rng(seed)
    turn = np.exp(2j * np.pi * rng.random(frequency.shape, np.float32)).astype(np.complex64)
    heights = np.fft.irfft2(turn * frequency**-2.1, (side, side))
    return ((heights - heights.min()) * (1500 / np.ptp(heights))).astype(np.float32)


def make(path: Path, side: int) -> None:
    profile = {
        "driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "float32",
        "crs": "EPSG:32632", "transform": rasterio.Affine(PIXEL, 0, 5e5, 0, -PIXEL, 54e5),
        "tiled": True, "blockxsize": 512, "blockysize": 512, "compress": "deflate",
    }  # fmt: skip
    with rasterio.open(path, "w", **profile) as file:
        file.write(fractal(side), 1)


def observer(side: int) -> tuple[float, float]:
    """The middle of a pixel near the raster's middle: GDAL's observers are there."""
    return 5e5 + (side * 2 // 5 + 0.5) * PIXEL, 54e5 - (side * 3 // 5 + 0.5) * PIXEL


def timed(what: str, command: list[str], cap: int, folder: Path) -> dict[str, Any]:
    """Run a command, cold; print and return its seconds, peak and end."""
    for file in folder.iterdir():
        drop(file)
    start = time.perf_counter()
    status, peak = run_capped(command, cap)
    seconds = time.perf_counter() - start
    told = how(status) or "done"
    print(f"{what:34} {seconds:9.2f} s {peak >> 20:7} MiB  {told}", flush=True)
    return {"seconds": seconds, "peak": peak, "end": how(status)}


def seen_in(path: Path) -> np.ndarray:
    with rasterio.open(path) as file:
        return file.read(1) == 255


def bordering(seen: np.ndarray) -> np.ndarray:
    """Which pixels have a neighbor that is seen where they are not, or not where they are."""
    edge = np.zeros(seen.shape, bool)
    for there, here in (
        (np.s_[1:], np.s_[:-1]), (np.s_[:, 1:], np.s_[:, :-1]),
        (np.s_[1:, 1:], np.s_[:-1, :-1]), (np.s_[1:, :-1], np.s_[:-1, 1:]),
    ):  # fmt: skip
        other = seen[there] != seen[here]
        edge[there] |= other
        edge[here] |= other
    return edge


def along_the_line(heights: np.ndarray, eye: tuple[int, int], pixel: np.ndarray) -> bool:
    """Whether no height between is above the line of sight, without curvature."""
    eye, pixel = np.array(eye, float), pixel.astype(float)
    count = int(POINTS * np.abs(pixel - eye).max()) + 2
    t = np.linspace(0, 1, count)[1:-1]
    i, j = (eye + t[:, None] * (pixel - eye)).T
    a, b = np.floor(i).astype(int), np.floor(j).astype(int)
    c, d = np.minimum(a + 1, len(heights) - 1), np.minimum(b + 1, len(heights) - 1)
    u, v = i - a, j - b
    upper = heights[a, b] * (1 - v) + heights[a, d] * v
    lower = heights[c, b] * (1 - v) + heights[c, d] * v
    z = [heights[tuple(p.astype(int))] + h for p, h in ((eye, HEIGHT), (pixel, TARGET))]
    return bool((upper * (1 - u) + lower * u <= z[0] + t * (z[1] - z[0]) + 1e-6).all())


def compare(ours: Path, other: Path, raster: Path | None) -> None:
    """Tell where two differ; beside a third opinion where the raster is given."""
    a, b = seen_in(ours), seen_in(other)
    differ = np.argwhere(a != b)
    border = bordering(a) | bordering(b)
    near = np.count_nonzero(border & (a != b))
    print(
        f"    bfrt sees {a.mean():.3%}, GDAL {b.mean():.3%}; they differ at "
        f"{len(differ) / a.size:.3%}, {near / max(len(differ), 1):.1%} of that beside a border"
    )
    if raster is None or not len(differ):
        return
    with rasterio.open(raster) as file:
        heights = file.read(1).astype(np.float64)
    side = len(heights)
    eye = (side * 3 // 5, side * 2 // 5)
    rng = np.random.default_rng(1)
    for what, some in (("otherwise", differ), ("alike", np.argwhere(a == b))):
        chosen = some[rng.permutation(len(some))[:SAMPLE]]
        third = [along_the_line(heights, eye, pixel) for pixel in chosen]
        with_ours = np.mean([a[tuple(p)] == t for p, t in zip(chosen, third, strict=True)])
        print(f"    of {len(chosen)} seen {what} a profile sees {with_ours:.1%} as bfrt does")


def measure(side: int, caps: list[str], folder: Path, runs: int) -> list[dict[str, Any]]:
    """A row for each run of a program."""
    rows = []

    def note(work: str, name: str, cap: str, found: dict[str, Any]) -> None:
        rows.append({"side": side, "work": work, "name": name, "cap": cap, **found})

    raster = folder / "dem.tif"
    make(raster, side)
    x, y = map(str, observer(side))
    print(f"{side} x {side}: {raster.stat().st_size >> 20} MiB")
    for cap in caps * runs:
        store = folder / "dem.bfrt"
        words = ["-m", "bfrt", "convert", str(raster), "-o", str(store), "--memory", cap]
        found = timed(f"bfrt convert, {cap}", words, parse_memory(cap), folder)
        note("convert", "bfrt", cap, found)
        taken = sum(file.stat().st_size for file in store.rglob("*") if file.is_file())
        print(f"    the store has {taken >> 20} MiB")
    for curved in (False, True):
        work = "viewshed, curved" if curved else "viewshed"
        for cap in caps * runs:
            out = folder / "bfrt.tif"
            words = ["-m", "bfrt", "viewshed", str(raster), "-o", str(out), "--memory", cap,
                     "--observer", x, y, "--height", str(HEIGHT), "--target-height", str(TARGET),
                     "--quiet", *(["--curvature"] if curved else [])]  # fmt: skip
            found = timed(f"bfrt viewshed, {cap}", words, parse_memory(cap), folder)
            note(work, "bfrt", cap, found)
            other = folder / "gdal.tif"
            part = 1 - REFRACTION if curved else 0
            words = ["-c", OTHER, "gdal_viewshed", "-q", "-ox", x, "-oy", y, "-oz", str(HEIGHT),
                     "-tz", str(TARGET), "-cc", str(part), str(raster), str(other)]  # fmt: skip
            note(work, "gdal_viewshed", "none", timed("gdal_viewshed", words, NO_CAP, folder))
        print(f"  {'with' if curved else 'without'} curvature:")
        compare(out, other, None if curved else raster)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sides", type=int, nargs="*", default=[1000])
    parser.add_argument("--caps", nargs="*", default=["256MiB"])
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where files are made")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    for side in arguments.sides:
        with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
            rows += measure(side, arguments.caps, Path(name), arguments.runs)
        save(arguments.json, rows)


if __name__ == "__main__":
    main()
