"""HDF5 files as tests write them with h5py."""

from __future__ import annotations

import numpy as np
import pytest

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")


RNG = np.random.default_rng(6)
CENTERS = RNG.normal(size=(20, 3)).astype(np.float32)
RADII = RNG.uniform(0.1, 1, 20).astype(np.float32)
MASS = np.arange(20.0)

#: How datasets are laid out.
LAYOUTS = {
    "contiguous": {},
    "chunked": {"chunks": True},
    "small chunks": {"chunks": (3,)},
    "gzip": {"chunks": (7,), "compression": "gzip", "shuffle": True, "fletcher32": True},
}


def write(path, datasets, layout="contiguous", libver=None):
    """A file of datasets by their names."""
    how = LAYOUTS[layout]
    with h5py.File(path, "w", libver=libver) as made:
        for name, data in datasets.items():
            array = np.asarray(data)
            own = dict(how) if array.ndim and array.dtype.kind in "fiu" else {}
            if isinstance(own.get("chunks"), tuple):
                own["chunks"] = (min(*own["chunks"], len(array)), *array.shape[1:])
            made.create_dataset(name, data=data, **own)


def snapshot(**more):
    """Datasets as simulations name them."""
    return {"PartType0/Coordinates": CENTERS, "PartType0/Masses": MASS, **more}


# --- links ---------------------------------------------------------------------------------------


def link(path, **links):
    """Add links to a file: soft ones to a path, external ones to a file and a path."""
    with h5py.File(path, "a") as made:
        for name, to in links.items():
            made[name] = h5py.SoftLink(to) if isinstance(to, str) else h5py.ExternalLink(*to)


# --- virtual datasets ----------------------------------------------------------------------------


def virtual(path):
    """A dataset over two files of ten rows each; returns these."""
    parts = [path.with_name(f"part{k}.h5") for k in range(2)]
    layout = h5py.VirtualLayout((20, 3), "f4")
    for k, part in enumerate(parts):
        write(part, {"rows": CENTERS[10 * k : 10 * k + 10]})
        layout[10 * k : 10 * k + 10] = h5py.VirtualSource(part.name, "rows", (10, 3))
    with h5py.File(path, "w") as made:
        made.create_virtual_dataset("Coordinates", layout, fillvalue=0)
    return parts
