"""What a conversion takes: files, each with the reader of its format, and standard scenes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from bfrt.errors import SettingError
from bfrt.formats.e57.reader import read_e57
from bfrt.formats.gzipped import is_packed, suffix_of
from bfrt.formats.hdf5.reader import read_hdf5
from bfrt.formats.lammps import read_lammps
from bfrt.formats.las import read_las
from bfrt.formats.lines.reader import read_lines
from bfrt.formats.nff import read_nff
from bfrt.formats.npy import read_npy, read_npz
from bfrt.formats.obj import read_obj
from bfrt.formats.object_writer import SceneSink
from bfrt.formats.off import read_off
from bfrt.formats.pcd.reader import read_pcd
from bfrt.formats.ply.reader import read_ply
from bfrt.formats.raster.reader import read_raster
from bfrt.formats.raster.suffixes import DRIVERS
from bfrt.formats.reading import Reading
from bfrt.formats.source import Report
from bfrt.formats.stl import read_stl
from bfrt.paths import is_folder, is_there, path_of, without_links
from bfrt.scene import PathLike
from bfrt.shards.manifest import SUFFIX
from bfrt.spd import scene as spd_scene
from bfrt.spd.recipe import SpdScene
from bfrt.streams.litter import restore

Reader = Callable[[str, SceneSink, Reading, Report | None], None]


class SceneFile(NamedTuple):
    """Names a file, or "-" for standard input, and what reads it."""

    name: str
    reader: Reader


class StandardScene(NamedTuple):
    """Names a scene of SPD, as ``spd:NAME:SIZE``, and what makes it."""

    name: str
    scene: SpdScene


SceneSource = SceneFile | StandardScene


def read_nff_as_is(
    path: str, sink: SceneSink, reading: Reading, report: Report | None = None
) -> None:
    """Read NFF, which has colors of its own and no settings."""
    reading.refuse_all_but(path)
    read_nff(path, sink, progress=report, room=reading.room)


READERS: dict[str, Reader] = {
    ".nff": read_nff_as_is,
    ".ply": read_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".npy": read_npy,
    ".npz": read_npz,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".las": read_las,
    ".laz": read_las,
    **dict.fromkeys(DRIVERS, read_raster),
    **dict.fromkeys((".xyz", ".csv", ".txt", ".pts"), read_lines),
    ".e57": read_e57,
    ".pcd": read_pcd,
    ".off": read_off,
    ".lammpstrj": read_lammps,
    ".dump": read_lammps,
}

#: Readers of what may be text, which gzip may have packed (.nff.gz, ...).
OF_TEXT = (
    read_nff_as_is, read_ply, read_stl, read_obj, read_lines, read_pcd, read_off, read_lammps,
)  # fmt: skip


def sources_of(given: PathLike | Sequence[PathLike]) -> tuple[SceneSource, ...]:
    """Return what each name that is given stands for.

    Raises
    ------
    SettingError
        If there is none, or one that nothing reads or makes.
    """
    each = [given] if isinstance(given, (str, os.PathLike)) else given
    if not isinstance(each, Iterable):
        raise SettingError(f"source: found {type(given).__name__}, expected a path, or several")
    names = [str(path_of("source", one)) for one in each]
    if not names:
        raise SettingError("convert: found no scene, expected one or more")
    readers = [reader_of(name) for name in names]
    return tuple(
        StandardScene(name, parse_spd(name)) if reader is None else SceneFile(name, reader)
        for name, reader in zip(names, readers, strict=True)
    )


def reader_of(name: str) -> Reader | None:
    """Return the reader of a file's format; None for a standard scene.

    Raises
    ------
    SettingError
        If nothing does.
    """
    if name.startswith("spd:"):
        return None
    suffix = ".nff" if name == "-" else suffix_of(name)
    if suffix not in READERS:
        raise SettingError(
            f"{name}: found suffix {Path(name).suffix!r}, expected {', '.join(READERS)}, "
            "spd:NAME:SIZE, or - for NFF from standard input"
        )
    reader = READERS[suffix]
    if is_packed(name) and reader not in OF_TEXT:
        texts = [suffix for suffix, reader in READERS.items() if reader in OF_TEXT]
        raise SettingError(
            f"{name}: found {suffix} that gzip has packed, expected it unpacked: packed are "
            f"{', '.join(texts)}"
        )
    return reader


def parse_spd(name: str, hash: str | None = None) -> SpdScene:
    """Return the scene that ``spd:NAME:SIZE`` names; `hash` is an option of mount."""
    _, _, rest = name.partition(":")
    scene, _, size = rest.partition(":")
    if not (size.isascii() and size.isdigit()):
        raise SettingError(f"{name}: found size {size!r}, expected spd:NAME:SIZE, as spd:rings:7")
    return spd_scene(scene, int(size)) if hash is None else spd_scene(scene, int(size), hash=hash)


def is_store(source: PathLike) -> bool:
    """Tell whether a path is a scene, a store or a sharded one, or has the name of one."""
    path = path_of("source", source)
    return (
        path.suffix in (".bfrt", SUFFIX)
        or is_folder(path)
        or (not is_there(path) and restore(without_links(path)))
    )
