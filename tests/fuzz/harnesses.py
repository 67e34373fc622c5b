"""All that is fuzzed, by its name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fuzz import readers, stores
from fuzz.e57 import e57
from fuzz.hdf5 import hdf5
from fuzz.states import checkpoint
from fuzz.trial import Harness

#: Each makes a harness in a folder of its own.
HARNESSES: dict[str, Callable[[Path], Harness]] = {
    "nff": readers.nff,
    "ply": readers.ply,
    "stl": readers.stl,
    "obj": readers.obj,
    "npy": readers.npy,
    "npz": readers.npz,
    "npz-members": readers.npz_members,
    "hdf5": hdf5,
    "las": readers.las,
    "laz": readers.laz,
    "raster": readers.raster,
    "lines": readers.lines,
    "gzipped": readers.gzipped,
    "pcd": readers.pcd,
    "off": readers.off,
    "lammps": readers.lammps,
    "e57": e57,
    "rays": stores.rays,
    "store": stores.store,
    "checkpoint": checkpoint,
}
