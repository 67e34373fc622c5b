"""HDF5: datasets of particles, or of a mesh, by h5py, a block of rows at a time."""

from __future__ import annotations

from contextlib import closing

from bfrt.errors import SettingError
from bfrt.formats.arrays import write_arrays
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report, Source


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
    try:
        import h5py  # noqa: F401
    except ImportError:
        raise SettingError(f"{path}: HDF5 needs h5py: install bfrt[hdf5]") from None
    from bfrt.formats.datasets import Datasets

    with Source(path) as source, closing(Datasets(source)) as datasets:
        writer = ObjectWriter(sink, path, reading)
        write_arrays(path, datasets, writer)
        writer.report()
        if report is not None:
            report(source.size)
