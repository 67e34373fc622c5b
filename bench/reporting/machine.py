"""Which version ran on which machine, and how fast disk and processor are at this hour.

The probes are the same everywhere: a file is written and read in order by pieces of a megabyte, as
`dd` does, with the page cache left out; and a loop of a fixed length is run by one process, and by
one for each processor at once.
"""

from __future__ import annotations

import datetime
import os
import platform
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path
from typing import Any

from capped import drop, how_capped

import bfrt

Facts = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]

#: The probes' file and loop.
PIECE = 1 << 20
PIECES = 512
TURNS = 5_000_000

#: A probe stands for this many seconds.
HOUR = 3600.0

LOOP = f"import time\nt = time.perf_counter()\nk = 0\nfor i in range({TURNS}):\n    k += i & 7\n"
LOOP += "print(time.perf_counter() - t)"


def now() -> str:
    """The time of day, to the second, UTC."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def _said(*command: str) -> str:
    """What a command says, or nothing where it is not there or fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def version() -> Facts:
    """bfrt's version; of a checkout its commit, with + where the package differs from that."""
    revision = _said("git", "rev-parse", "--short=10", "HEAD")
    changed = _said("git", "status", "--porcelain", "--", "bfrt", "setup.py")
    return {"version": bfrt.__version__, "revision": revision + ("+" if changed else "")}


def _field(path: str, name: str) -> str:
    """A field of a file of the system's, as cpuinfo; nothing where there is none."""
    if not Path(path).exists():
        return ""
    lines = [line.partition(":") for line in Path(path).read_text().splitlines()]
    return next((value.strip() for key, _, value in lines if key.strip() == name), "")


def machine() -> Facts:
    """Processor, memory and system, and what caps memory."""
    pages = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {
        "processor": _field("/proc/cpuinfo", "model name") or platform.machine(),
        "cores": os.cpu_count(),
        "memory": pages,
        "system": platform.platform(),
        "cap": how_capped(),
    }


def programs(others: list[str]) -> dict[str, str]:
    """Versions of what takes part, as far as it is installed here or in the other Pythons."""
    names = ("numpy", "open3d", "trimesh", "embreex", "mitsuba", "ovito", "distributed")
    found = {"python": platform.python_version()}
    found |= {name: _version_of(name, others) for name in names}
    for name, option in (("povray", "--version"), ("tachyon", ""), ("gdal_viewshed", "--version")):
        found[name] = next(iter(_said(name, *option.split()).splitlines()), "")
    return {name: told for name, told in found.items() if told}


def _version_of(name: str, others: list[str]) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        asked = f"import importlib.metadata as m; print(m.version({name!r}))"
        return next(filter(None, (_said(python, "-c", asked) for python in others)), "")


def probe(folder: Path) -> Facts:
    """Bytes a second in order, written and read, and seconds of the loop, alone and all at once."""
    return {"time": now(), **_disk(folder / "probe"), **_loops()}


def _disk(path: Path) -> Facts:
    piece = bytes(os.urandom(PIECE))
    start = time.perf_counter()
    with path.open("wb", buffering=0) as file:
        for _ in range(PIECES):
            file.write(piece)
        os.fsync(file.fileno())
    written = time.perf_counter()
    drop(path)
    buffer = bytearray(PIECE)
    begun = time.perf_counter()
    with path.open("rb", buffering=0) as file:
        while file.readinto(buffer):
            pass
    read = time.perf_counter() - begun
    path.unlink()
    size = PIECE * PIECES
    return {"disk_write": size / (written - start), "disk_read": size / read}


def _loops() -> Facts:
    def run(count: int) -> float:
        started = [
            subprocess.Popen([sys.executable, "-c", LOOP], stdout=subprocess.PIPE, text=True)
            for _ in range(count)
        ]
        return max(float(process.communicate()[0]) for process in started)

    return {"loop": run(1), "loops": run(os.cpu_count() or 1)}
