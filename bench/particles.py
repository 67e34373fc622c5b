"""bfrt beside OVITO: from a file of particles to a picture of them, under caps.

::

    python bench/particles.py --millions 1 4 16 64 --caps 256MiB 1GiB 4GiB 18GiB

Particles are spheres of one size at random in a cube, a NumPy file of positions. Each program is a
process of its own inside a memory cgroup, with its files dropped from the page cache before. OVITO
renders by Tachyon: 512 x 512, hard shadows, one ray a pixel. Told are seconds, the cgroup's peak or
how it died, and how much of the picture is particles, of which both have to see the same. Needs
root, for the cgroup, and ``pip install ovito``, here or in a Python that ``--python`` names;
without it bfrt runs alone.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from capped import drop, run_capped
from particle import PROGRAMS
from peers import how, pythons_of
from saved import save

from bfrt.memory import parse_memory

ONE = str(Path(__file__).with_name("particle.py"))


def cloud(path: Path, count: int) -> None:
    """Positions, one in a unit cube on average, float32."""
    random = np.random.default_rng(1)
    side = count ** (1 / 3)
    file = np.lib.format.open_memmap(path, "w+", np.float32, (count, 3))
    for first in range(0, count, 1 << 20):
        block = file[first : first + (1 << 20)]
        block[:] = random.random(block.shape, np.float32) * side
    file.flush()


def measure(
    millions: float, caps: list[str], folder: Path, pictures: Path, others: list[str]
) -> list[dict[str, Any]]:
    """A row for each cap and program."""
    count = round(millions * 1e6)
    source, seen = folder / "cloud.npy", folder / "seen"
    programs = pythons_of(PROGRAMS, others)
    cloud(source, count)
    rows = []
    for cap in caps:
        for name, python in programs.items():
            drop(source)
            picture = pictures / f"particles-{millions:g}-{name}.png"
            command = [ONE, name, str(source), str(count), str(picture), cap, str(seen)]
            start = time.perf_counter()
            status, peak = run_capped(command, parse_memory(cap), python=python)
            row = {"millions": millions, "cap": cap, "name": name, "end": how(status)}
            row |= {"seconds": time.perf_counter() - start, "peak": peak}
            if not status:
                row["seen"] = float(seen.read_text())
            rows.append(row)
            print(
                f"{millions:6g} M  {cap:>7}  {name:6} {row['seconds']:8.2f} s {peak >> 20:6} MiB  "
                f"{row['end'] or row['seen']}",
                flush=True,
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--millions", type=float, nargs="*", default=[1, 4])
    parser.add_argument("--caps", nargs="*", default=["256MiB", "1GiB", "4GiB"])
    parser.add_argument("--folder", type=Path, help="where files are made")
    parser.add_argument("--pictures", type=Path, help="where pictures are kept")
    parser.add_argument("--python", nargs="*", default=[], help="others, one of which has OVITO")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
        pictures = arguments.pictures or Path(name)
        for millions in arguments.millions:
            rows += measure(millions, arguments.caps, Path(name), pictures, arguments.python)
            save(arguments.json, rows)


if __name__ == "__main__":
    main()
