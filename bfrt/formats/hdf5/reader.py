"""HDF5: datasets of particles, or of a mesh, by h5py, a block of rows at a time.

Of the room that a budget leaves one half is for chunks, which HDF5 holds whole, and one half for a
mesh's vertices.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

from bfrt.errors import SettingError
from bfrt.formats.array_contents import rows_of_arrays
from bfrt.formats.arrays import write_arrays
from bfrt.formats.contents import Row
from bfrt.formats.hdf5.remote import RemoteArrays
from bfrt.formats.layouts.layout import arranged
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.reading import RGB, Reading
from bfrt.formats.remote.process import is_installed
from bfrt.formats.room import need_of
from bfrt.formats.source import Report, Source

#: Bytes of the largest chunks of a dataset that is only told of, which reads none.
CHUNKS = 1 << 62


def read_hdf5(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an HDF5 file, whose datasets' names tell what they are: `bfrt.formats.arrays`.

    Raises
    ------
    SceneError
        If it is no HDF5, or its datasets make no scene.
    SettingError
        If a setting does not fit them, or h5py is missing.
    StreamError
        If the system refuses to read it.
    """
    check_library(path)
    taken = need_of(path, colored=reading.color_by == RGB, smooth=reading.smooth).blocks
    limits = (taken, reading.room // 2, reading.external_storage)
    own = replace(reading, room=reading.room - reading.room // 2)
    reading.uses.known.add("external_storage")
    with Source(path) as source, closing(RemoteArrays(path, limits)) as arrays:
        writer = ObjectWriter(sink, path, own)
        write_arrays(path, arranged(path, arrays, own, arrays.attributes), writer)
        writer.report()
        if report is not None:
            report(source.size)


def contents_of_hdf5(path: str) -> list[Row]:
    """List the datasets, fields and constants of an HDF5 file; else as `read_hdf5`."""
    check_library(path)
    with closing(RemoteArrays(path, (0, CHUNKS, False))) as arrays:
        return rows_of_arrays(path, arrays, arrays.attributes, framed=True)


def check_library(path: str) -> None:
    """Refuse an HDF5 file where h5py is missing."""
    if not is_installed("h5py"):
        raise SettingError(f"{path}: HDF5 needs h5py: install bfrt[hdf5]")
