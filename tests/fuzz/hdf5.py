"""HDF5: the process that reads it is forked here, for starting one takes a hundred times longer."""

from __future__ import annotations

import io
import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import hdf5_files
import layout_files
import numpy as np
from fuzz.readers import POINTS, convert
from fuzz.trial import Harness, of_bytes

from bfrt.formats.hdf5 import child
from bfrt.formats.hdf5.origins import Limits
from bfrt.formats.remote import process as remote

#: Seconds that an answer may take here, where files are small.
SECONDS = 5


class Forked:
    """Stands for `subprocess.Popen` of the process that reads."""

    def __init__(self, asked: list[str], **_: Any) -> None:
        work = self.work(asked)
        to_read, to_write = os.pipe(), os.pipe()
        self._id = os.fork()
        if not self._id:
            serve(work, (to_read[0], to_write[1]))
        os.close(to_read[0])
        os.close(to_write[1])
        self.stdin = io.FileIO(to_read[1], "w")
        self.stdout = io.FileIO(to_write[0])
        self._status: int | None = None

    @staticmethod
    def work(asked: list[str]) -> Callable[[], None]:
        """What the process does."""
        path, limits = remote.json.loads(asked[3])
        return lambda: child.main(path, list(Limits(*limits)._replace(seconds=SECONDS)))

    def kill(self) -> None:
        if self._status is None:
            os.kill(self._id, signal.SIGKILL)

    def wait(self) -> int:
        if self._status is None:
            self._status = os.waitstatus_to_exitcode(os.waitpid(self._id, 0)[1])
        return self._status


def serve(work: Callable[[], None], streams: Sequence[int]) -> None:
    """Be the process that reads, and end."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        for number, stream in enumerate((*streams, nowhere)):
            os.dup2(stream, number)
        os.closerange(3, 256)
        work()
    finally:
        os._exit(0)


def hdf5(home: Path) -> Harness:
    seeds = []
    more = {"PartType0/radii": hdf5_files.RADII, "mass": hdf5_files.MASS}
    for layout in hdf5_files.LAYOUTS:
        for libver in (None, "latest"):
            path = home / "seed.h5"
            hdf5_files.write(path, hdf5_files.snapshot(**more), layout, libver)
            seeds.append(path.read_bytes())
    hdf5_files.link(path, soft="/PartType0", other=("part0.h5", "/rows"))
    seeds.append(path.read_bytes())
    parts = {part.name: part.read_bytes() for part in hdf5_files.virtual(home / "virtual.h5")}
    seeds.append((home / "virtual.h5").read_bytes())

    table = np.zeros(9, [("pos", "<f4", 3), ("mass", "<f8")])
    table["pos"], table["mass"] = layout_files.RNG.random((9, 3)), np.arange(9)
    mesh = {"part/vertices": table["pos"], "part/faces": np.array([[0, 1, 2], [2, 3, 4]])}
    for datasets in ({"snap/table": table}, mesh):
        hdf5_files.write(path, datasets)
        seeds.append(path.read_bytes())
    for layout in (layout_files.an_openpmd, layout_files.an_h5md, layout_files.an_h5part):
        seeds.append(layout(home / "layout.h5").read_bytes())

    def run(data: bytes, folder: Path) -> None:
        (folder / "in" / "a.h5").write_bytes(data)
        for name, part in parts.items():
            (folder / "in" / name).write_bytes(part)
        kept = remote.subprocess
        remote.subprocess = SimpleNamespace(
            Popen=Forked, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL
        )
        try:
            convert(data, folder, "a.h5", POINTS)
        finally:
            remote.subprocess = kept

    tokens = (b"TREE", b"SNOD", b"HEAP", b"OHDR", b"FRHP", b"BTHD", b"GCOL", b"\x89HDF\r\n\x1a\n")
    return of_bytes(seeds, tokens, run)
