"""bfrt against POV-Ray and Tachyon: the same NFF scene, the same rays, whole commands in turn.

::

    python bench/renderers.py rings 36 --runs 3

writes the scene as NFF and as a POV-Ray file (beforehand, not timed), then runs the commands in
turn: ``bfrt render X.nff -o X.png``, ``povray X.pov`` and ``tachyon X.nff``, with 513 x 513 eye
rays and depth 5. It prints a table of seconds and peak memory: medians of the runs, and the ratios.
Those that are not installed are left out.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np
from saved import save

import bfrt
from bfrt.formats.nff import read_nff
from bfrt.records import Kind


class PovWriter:
    """Takes a scene as a scene writer does, and writes POV-Ray's language."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._lights: list[bfrt.Light] = []
        self._materials: list[bfrt.Material] = []
        self._declared = 0
        file.write("#version 3.7;\n")

    def camera(self, camera: bfrt.Camera) -> None:
        """POV-Ray is left-handed: x is mirrored. Its rays go through pixel centers, of which the
        outermost of 513 are where SPD wants the corners of 512 pixels."""
        width, height = camera.resolution
        half = math.tan(math.radians(camera.angle) / 2)
        angle = 2 * math.degrees(math.atan(half * (width + 1) / width))
        forward = np.subtract(camera.at, camera.eye)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, camera.up)
        right = right / np.linalg.norm(right)
        up = np.cross(right, forward)
        self.size = (width + 1, height + 1)
        self._file.write(
            f"camera {{ location {vec(camera.eye)} direction {vec(forward)} "
            f"right {vec(right * 2 * math.tan(math.radians(angle) / 2))} "
            f"up {vec(up * 2 * math.tan(math.radians(angle) / 2))} }}\n"
            "global_settings { assumed_gamma 1 max_trace_level 5 adc_bailout 0 }\n"
        )

    def light(self, light: bfrt.Light) -> None:
        self._lights.append(light)

    def background(self, color: tuple[float, float, float]) -> None:
        self._file.write(f"background {{ rgb {vec(color)} }}\n")

    def material(self, material: bfrt.Material) -> int:
        if material in self._materials:
            return self._materials.index(material)
        self._materials.append(material)
        return len(self._materials) - 1

    def append(self, kind: Kind, records: Any, materials: Any) -> None:
        self._declare()
        for r, m in zip(records.tolist(), materials.tolist(), strict=True):
            self._file.write(SHAPES[kind](r) + f" texture {{ M{m} }} }}\n")

    def append_polygons(self, vertices: Any, counts: Any, materials: Any) -> None:
        self._declare()
        at = 0
        for n, m in zip(counts.tolist(), materials.tolist(), strict=True):
            points = [vec(p) for p in vertices[at : at + n]]
            at += n
            outline = ", ".join([*points, points[0]])
            self._file.write(f"polygon {{ {n + 1}, {outline} texture {{ M{m} }} }}\n")

    def finish(self) -> None:
        """Lights come last, when their number is known."""
        n = len(self._lights)
        intensity = math.sqrt(n) / (2 * n)
        for light in self._lights:
            color = vec([c * intensity for c in light.color])
            self._file.write(f"light_source {{ {vec(light.position)} rgb {color} }}\n")

    def _declare(self) -> None:
        for number in range(self._declared, len(self._materials)):
            m = self._materials[number]
            self._file.write(
                f"#declare M{number} = texture {{ pigment {{ rgb {vec(m.color)} "
                f"transmit {m.transmittance} }} finish {{ ambient 0.2 diffuse {m.kd} "
                f"phong {m.ks} phong_size {m.shine} reflection {{ {m.ks} }} }} }}\n"
            )
        self._declared = len(self._materials)


def vec(v: Any) -> str:
    """A vector of POV-Ray's."""
    return f"<{float(v[0]):.9g}, {float(v[1]):.9g}, {float(v[2]):.9g}>"


def _cone(r: list[float]) -> str:
    if r[3] == r[7]:
        return f"cylinder {{ {vec(r)}, {vec(r[4:])}, {r[3]:.9g} open"
    return f"cone {{ {vec(r)}, {r[3]:.9g}, {vec(r[4:])}, {r[7]:.9g} open"


SHAPES = {
    Kind.SPHERE: lambda r: f"sphere {{ {vec(r)}, {r[3]:.9g}",
    Kind.CONE: _cone,
    Kind.TRIANGLE: lambda r: f"triangle {{ {vec(r)}, {vec(r[3:])}, {vec(r[6:])}",
    Kind.PATCH: lambda r: (
        f"smooth_triangle {{ {vec(r)}, {vec(r[9:])}, {vec(r[3:])}, {vec(r[12:])}, "
        f"{vec(r[6:])}, {vec(r[15:])}"
    ),
}


def write_pov(nff: Path, pov: Path) -> tuple[int, int]:
    """Write a scene as POV-Ray has it; returns the picture's size."""
    with pov.open("w") as file:
        writer = PovWriter(file)
        read_nff(nff, writer)
        writer.finish()
    return writer.size


def timed(command: list[str]) -> tuple[float, int]:
    """Seconds and peak bytes of a command that must succeed."""
    start = time.perf_counter()
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=tempfile.gettempdir()
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    if status:
        raise SystemExit(f"{command}: {said.decode(errors='replace')[-500:]}")
    return seconds, usage.ru_maxrss * 1024


class Peer(NamedTuple):
    """A renderer: the suffix of the file that it reads, and the end of its command."""

    suffix: str
    options: str


PEERS = {
    "povray": Peer(".pov", "+I{file} +O{out} +W{width} +H{height} -D -A +WT{threads} +Q9"),
    "tachyon": Peer(
        ".nff",
        "{file} -raydepth 5 -numthreads {threads} -res {width} {height} -format PNG -o {out}",
    ),
}


def compare(
    name: str, size: int, peers: list[str], runs: int, folder: Path, threads: int, memory: str
) -> list[dict[str, Any]]:
    """Rows of the table, a program each; printed are those of the peers."""
    scene = bfrt.spd.scene(name, size)
    nff, pov = folder / f"{name}{size}.nff", folder / f"{name}{size}.pov"
    with nff.open("w") as file:
        scene.write_nff(file)
    width, height = write_pov(nff, pov)
    commands = {
        "bfrt": [
            sys.executable, "-m", "bfrt", "render", str(nff), "-o", str(folder / "ours.png"),
            "--memory", memory, "--threads", str(threads), "--quiet",
        ]
    }  # fmt: skip
    for peer in peers:
        file, out = nff.with_suffix(PEERS[peer].suffix), folder / "theirs.png"
        facts = {"file": file, "out": out, "width": width, "height": height, "threads": threads}
        commands[peer] = [peer, *(o.format(**facts) for o in PEERS[peer].options.split())]
    results = [{who: timed(command) for who, command in commands.items()} for _ in range(runs)]
    rows = []
    for who in commands:
        seconds, peak = (statistics.median(run[who][what] for run in results) for what in (0, 1))
        ratio = statistics.median(run[who][0] / run["bfrt"][0] for run in results)
        row = {"scene": name, "size": size, "objects": scene.objects, "name": who}
        rows.append({**row, "seconds": seconds, "peak": peak, "faster": ratio})
        print(
            f"{name:6} {size:>4}  {who:8} {seconds:8.2f} {peak / 2**20:8.0f}  {ratio:6.2f}",
            flush=True,
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("name")
    parser.add_argument("sizes", type=int, nargs="+")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--memory", default="256MiB", help="bfrt's budget")
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--json", type=Path)
    parser.add_argument("--folder", type=Path, help="where files are made")
    arguments = parser.parse_args()
    peers = [peer for peer in PEERS if shutil.which(peer)]
    for name in set(PEERS) - set(peers):
        print(f"{name} is not installed: it is left out", flush=True)
    print("             program         s      MiB  times bfrt's")
    rows = []
    for size in arguments.sizes:
        with tempfile.TemporaryDirectory(dir=arguments.folder) as name:
            rows += compare(
                arguments.name,
                size,
                peers,
                arguments.runs,
                Path(name),
                arguments.threads,
                arguments.memory,
            )
            save(arguments.json, rows)


if __name__ == "__main__":
    main()
