"""Files of particles as openPMD, H5MD and H5Part have them, and a naive reader's view of them."""

from __future__ import annotations

import numpy as np
import pytest

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")

RNG = np.random.default_rng(8)
AXES = "xyz"


def component(group, name, data, unit=1.0):
    """A record component: of rows, or of a constant and their number."""
    if isinstance(data, tuple):
        value, rows = data
        made = group.create_group(name)
        made.attrs["value"], made.attrs["shape"] = value, np.array([rows], np.uint64)
    else:
        made = group.create_dataset(name, data=data)
    if unit is not None:
        made.attrs["unitSI"] = unit
    return made


def openpmd(path, iterations, base="/data/%T/", particles="particles/"):
    """Iterations by number, of species by name, of records by name: rows, units, of each axis."""
    with h5py.File(path, "w") as made:
        made.attrs["openPMD"], made.attrs["openPMDextension"] = "1.1.0", np.uint32(0)
        made.attrs["basePath"], made.attrs["particlesPath"] = base, np.bytes_(particles)
        for number, species in iterations.items():
            folder = base.replace("%T", str(number)) + particles
            for name, records in species.items():
                group = made.create_group(f"{folder}{name}")
                for record, (data, unit) in records.items():
                    if isinstance(data, dict):
                        inner = group.create_group(record)
                        for axis, own in data.items():
                            component(inner, axis, own, unit)
                    else:
                        component(group, record, data, unit)
    return path


def species_of(rows, unit=1.0, offset=None, offset_unit=1.0, **more):
    """The records of a species whose positions are these, (n, 3)."""
    found = {"position": (dict(zip(AXES, rows.T, strict=True)), unit)}
    if offset is not None:
        columns = offset if isinstance(offset, dict) else dict(zip(AXES, offset.T, strict=True))
        found["positionOffset"] = (columns, offset_unit)
    return {**found, **more}


def rows_of(thing):
    """The rows of a component in SI units, as the standard's text says."""
    if isinstance(thing, h5py.Group):
        rows = np.full(thing.attrs["shape"], thing.attrs["value"])
    else:
        rows = thing[:]
    return rows.astype("f8") * thing.attrs["unitSI"]


def naive_openpmd(path, iteration, species):
    """Positions (n, 3) in meters."""
    with h5py.File(path) as made:
        base = made.attrs["basePath"].replace("%T", str(iteration))
        group = made[base + made.attrs["particlesPath"].decode()][species]
        columns = [
            rows_of(group["position"][axis]) + rows_of(group["positionOffset"][axis])
            for axis in AXES
        ]
    return np.stack(columns, axis=-1)


def h5md(path, groups, version=(1, 1)):
    """Particle groups by name, of elements by name: (frames, n, ...) or rows without frames."""
    with h5py.File(path, "w") as made:
        made.create_group("h5md").attrs["version"] = version
        for name, elements in groups.items():
            for element, (data, framed) in elements.items():
                where = f"particles/{name}/{element}"
                if framed:
                    made[f"{where}/value"] = data
                    made[f"{where}/step"] = np.arange(len(data)) * 10
                    made[f"{where}/time"] = np.arange(len(data)) / 2
                else:
                    made[where] = data
            made[f"particles/{name}/box/edges"] = np.ones(3)
    return path


def h5part(path, steps):
    """Steps by number, of rows (n, 3) and columns by name."""
    with h5py.File(path, "w") as made:
        for number, (rows, more) in steps.items():
            for name, data in {**dict(zip(AXES, rows.T, strict=True)), **more}.items():
                made[f"Step#{number}/{name}"] = data
    return path


# --- small ones of all there is ------------------------------------------------------------------


def an_openpmd(path):
    """Two iterations, units, offsets and constants."""
    rows, cells = RNG.random((9, 3)).astype("f4"), RNG.integers(0, 99, (9, 3))
    own = species_of(rows, 0.5, cells, 0.5, mass=((2.0, 9), 1.0))
    return openpmd(path, {0: {"e": own}, 50: {"e": own}})


def an_h5md(path):
    """Three frames, with a column of as many."""
    frames = RNG.random((3, 9, 3)).astype("f4")
    return h5md(path, {"all": {"position": (frames, True), "mass": (frames[..., 0], True)}})


def an_h5part(path):
    """Two steps."""
    return h5part(path, {n: (RNG.random((9, 3)), {"mass": np.arange(9.0)}) for n in (0, 1)})
