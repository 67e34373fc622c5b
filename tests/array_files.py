"""Arrays as tests write them to .npy and .npz."""

from __future__ import annotations

import numpy as np
from meshes import objects_of

RNG = np.random.default_rng(5)
CENTERS = RNG.normal(size=(20, 3)).astype(np.float32)
RADII = RNG.uniform(0.1, 1, 20).astype(np.float32)
MASS = np.arange(20.0)
TRIANGLES = RNG.normal(size=(9, 3, 3)).astype(np.float32)
FACES = RNG.integers(0, 20, (12, 3))

#: Whole numbers and floats that all these hold.
DTYPES = ["f2", "f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f4", ">f8", ">i2"]

#: Those that float32 holds without a loss.
NARROW = {"f2", "f4", ">f4", "i1", "u1", "i2", "u2", ">i2"}

SAVES = [np.savez, np.savez_compressed]


def save_as(path, array, version):
    with path.open("wb") as file:
        np.lib.format.write_array(file, array, version, allow_pickle=True)


def header_of(path, text, version=1):
    """A file of a header and nothing behind it."""
    head = text.encode()
    size = len(head).to_bytes(2 if version == 1 else 4, "little")
    path.write_bytes(b"\x93NUMPY" + bytes([version, 0]) + size + head)


def colors(store):
    return [each.color for each in objects_of(store)]


# --- .npy ----------------------------------------------------------------------------------------


def records(**more):
    fields = [(axis, "f4") for axis in "xyz"] + [(name, a.dtype, a.shape[1:]) for name, a in
                                                 more.items()]  # fmt: skip
    rows = np.zeros(20, fields)
    rows["x"], rows["y"], rows["z"] = CENTERS.T
    for name, array in more.items():
        rows[name] = array
    return rows
