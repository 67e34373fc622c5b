"""Files of each format as works convert them, and the settings of their conversion."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import array_files
import numpy as np
import obj_files
import pcd_files
import ply_files
import stl_files

import bfrt

Prepare = Callable[[Path], object]


def nff(folder: Path) -> None:
    with (folder / "in" / "a.nff").open("w") as file:
        bfrt.spd.rings(1).write_nff(file)


def put(name: str, data: bytes | str, folder: Path) -> None:
    (folder / "in" / name).write_bytes(data.encode() if isinstance(data, str) else data)


def obj(folder: Path) -> None:
    put("a.obj", obj_files.dressed("a.mtl", ["red one", "glass", "mirror"]), folder)
    put("a.mtl", obj_files.LIBRARY, folder)


def npy(folder: Path) -> None:
    np.save(folder / "in" / "a.npy", array_files.CENTERS)


def npz(folder: Path) -> None:
    np.savez_compressed(
        folder / "in" / "a.npz", centers=array_files.CENTERS, radii=array_files.RADII
    )


def hdf5(layout: str, folder: Path) -> None:
    import hdf5_files

    hdf5_files.write(folder / "in" / "a.h5", hdf5_files.snapshot(), layout)


def virtual(folder: Path) -> None:
    import hdf5_files

    hdf5_files.virtual(folder / "in" / "a.h5")


def las(name: str, folder: Path) -> None:
    import las_files

    las_files.write(folder / "in" / name)


def raster(folder: Path) -> None:
    import raster_files

    raster_files.write(folder / "in" / "a.tif")


#: Points of text, with a number and a color beside.
LINES = "x,y,z,m,red,green,blue\n" + "".join(
    f"{k},{k * k % 7},{k % 5},{k + 1},{k},0,255\n" for k in range(40)
)

ATOMS = "".join(f"{k} {k % 2 + 1} 0.{k} 0.5 0.{9 - k}\n" for k in range(1, 9))
DUMP = (
    "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n8\nITEM: BOX BOUNDS xy xz yz pp pp pp\n"
    f"0 9 1\n0 9 0\n0 9 2\nITEM: ATOMS id type xs ys zs\n{ATOMS}"
)

COFF = (
    "COFF\n4 2 0\n0 0 0 255 0 9 1\n1 0 0 255 0 9 1\n1 1 0.5 0 9 9 1\n0 1 0 0 9 9 1\n"
    "3 0 1 2\n4 0 1 2 3\n"
)


def pcd(layout: str, folder: Path) -> None:
    made = np.zeros(40, [*pcd_files.XYZ, ("rgb", "<u4")])
    for number, name in enumerate(made.dtype.names or ()):
        made[name] = np.arange(40) * (number + 1)
    put("a.pcd", pcd_files.pcd(made, layout), folder)


def e57(folder: Path) -> None:
    import e57_files

    made = e57_files.scan(40, 1, invalid=True)
    e57_files.write(folder / "in" / "a.e57", [made, made], [((1, 0, 0, 1), (1, 2, 3))])


def layout(name: str, folder: Path) -> None:
    import layout_files

    getattr(layout_files, name)(folder / "in" / "a.h5")


def conversion(prepare: Prepare, name: str, **how: Any) -> tuple[tuple[Prepare, str], dict]:
    """A conversion: what makes a file, its name, and how it is converted."""
    return (prepare, name), how


CONVERSIONS = {
    "convert nff": conversion(nff, "a.nff"),
    "convert nff in the given order": conversion(nff, "a.nff", order="given", durable=False),
    "convert nff over a store": conversion(nff, "a.nff", again=True),
    "convert ply, text": conversion(
        partial(put, "a.ply", ply_files.mesh("ascii")), "a.ply", order="given"
    ),
    "convert ply": conversion(
        partial(put, "a.ply", ply_files.mesh("binary_little_endian")), "a.ply"
    ),
    "convert stl, text": conversion(partial(put, "a.stl", stl_files.text()), "a.stl"),
    "convert stl": conversion(partial(put, "a.stl", stl_files.binary()), "a.stl"),
    "convert obj": conversion(obj, "a.obj"),
    "convert npy": conversion(npy, "a.npy", radius=0.1),
    "convert npz": conversion(npz, "a.npz", radius="radii"),
    "convert hdf5": conversion(partial(hdf5, "contiguous"), "a.h5", radius=0.1),
    "convert hdf5, gzip": conversion(partial(hdf5, "gzip"), "a.h5", radius=0.1),
    "convert hdf5, virtual": conversion(virtual, "a.h5", radius=0.1),
    "convert las": conversion(partial(las, "a.las"), "a.las", radius=0.1),
    "convert laz": conversion(partial(las, "a.laz"), "a.laz", radius=0.1),
    "convert raster": conversion(raster, "a.tif"),
    "convert lines": conversion(partial(put, "a.csv", LINES), "a.csv", radius="m", color_by="rgb"),
    "convert lines, gzip": conversion(
        partial(put, "a.csv.gz", gzip.compress(LINES.encode(), mtime=0)), "a.csv.gz", radius="auto"
    ),
    "convert pcd": conversion(partial(pcd, "binary"), "a.pcd", radius=0.1, color_by="rgb"),
    "convert pcd, packed": conversion(
        partial(pcd, "binary_compressed"), "a.pcd", radius=0.1, color_by="rgb"
    ),
    "convert off": conversion(partial(put, "a.off", COFF), "a.off", color_by="rgb"),
    "convert lammps": conversion(partial(put, "a.dump", DUMP), "a.dump", radius="1=0.1,2=0.2"),
    "convert splats": conversion(partial(put, "a.ply", ply_files.splats(9)), "a.ply", opacity=0.3),
    "convert e57": conversion(e57, "a.e57", radius=0.1, color_by="rgb"),
    "convert openpmd": conversion(partial(layout, "an_openpmd"), "a.h5", radius=0.1),
    "convert h5md": conversion(partial(layout, "an_h5md"), "a.h5", radius=0.1, color_by="mass"),
}
