"""What scene files contain before they are converted, format by format: ``bfrt info FILE``.

A format has a line in `FORMATS`: its name, and the function that lists what a file of it contains.
Of a format without a line its suffix and the file's size are told.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from bfrt.conversion.sources import READERS, Reader, read_nff_as_is, reader_of
from bfrt.errors import SettingError
from bfrt.formats.contents import Row
from bfrt.formats.e57.reader import contents_of_e57, read_e57
from bfrt.formats.gzipped import suffix_of
from bfrt.formats.hdf5.reader import contents_of_hdf5, read_hdf5
from bfrt.formats.lammps import contents_of_lammps, read_lammps
from bfrt.formats.las import contents_of_las, read_las
from bfrt.formats.lines.reader import contents_of_lines, read_lines
from bfrt.formats.nff import contents_of_nff
from bfrt.formats.npy import contents_of_npy, contents_of_npz, read_npy, read_npz
from bfrt.formats.obj import contents_of_obj, read_obj
from bfrt.formats.off import contents_of_off, read_off
from bfrt.formats.pcd.reader import contents_of_pcd, read_pcd
from bfrt.formats.ply.contents import contents_of_ply
from bfrt.formats.ply.reader import read_ply
from bfrt.formats.raster.reader import contents_of_raster, read_raster
from bfrt.formats.source import Source
from bfrt.formats.stl import contents_of_stl, read_stl


class Format(NamedTuple):
    """Names a format, and what lists the contents of its files."""

    name: str
    contents_of: Callable[[str], list[Row]]


FORMATS: dict[Reader, Format] = {
    read_nff_as_is: Format("NFF", contents_of_nff),
    read_ply: Format("PLY", contents_of_ply),
    read_stl: Format("STL", contents_of_stl),
    read_obj: Format("OBJ", contents_of_obj),
    read_npy: Format("NPY", contents_of_npy),
    read_npz: Format("NPZ", contents_of_npz),
    read_hdf5: Format("HDF5", contents_of_hdf5),
    read_las: Format("LAS", contents_of_las),
    read_raster: Format("raster", contents_of_raster),
    read_lines: Format("points of text", contents_of_lines),
    read_e57: Format("E57", contents_of_e57),
    read_pcd: Format("PCD", contents_of_pcd),
    read_off: Format("OFF", contents_of_off),
    read_lammps: Format("LAMMPS", contents_of_lammps),
}


def is_scene_file(name: str) -> bool:
    """Tell whether a name has the suffix of a format that is read."""
    return suffix_of(name) in READERS


def describe_file(name: str) -> dict[str, Any]:
    """Return what ``info`` shows of a scene file, ready for JSON.

    Raises
    ------
    SceneError, ShortReadError
        If it is damaged as far as it is looked at.
    SettingError
        If it is no file, or the library that reads it is missing.
    StreamError
        If the system refuses to read it.
    """
    if not is_scene_file(name):
        raise SettingError(f"{name}: found no file of {', '.join(READERS)}, expected one")
    reader = reader_of(name)
    assert reader is not None
    with Source(name) as source:
        size = source.size
    form = FORMATS.get(reader, Format(suffix_of(name).removeprefix(".").upper(), nothing))
    return {
        "file": name,
        "format": form.name,
        "bytes": size,
        "contents": [row._asdict() for row in form.contents_of(name)],
    }


def nothing(path: str) -> list[Row]:
    """List nothing, as of a format that does not tell what it contains."""
    return []
