"""The memory that a conversion takes, and the room that it leaves for a mesh's vertices.

Beside the process there are blocks: those that are read, that objects are made of, that wait for
threads, and that are written. They are of fixed sizes, and a small file does not fill them::

    memory = BASELINE + libraries + blocks, at most GROWTH times the file + room

When all is read these are gone, and objects are brought into spatial order, unless the order given
is asked for, which takes less than the rest or more (bfrt/store/ordering/memory.py).
"""

from __future__ import annotations

import math
import stat
from pathlib import Path
from typing import NamedTuple

from bfrt.errors import BudgetError, StreamError
from bfrt.formats.gzipped import is_packed, suffix_of
from bfrt.formats.raster.suffixes import DRIVERS
from bfrt.memory import BASELINE, format_memory
from bfrt.paths import UNKNOWN, facts_at
from bfrt.records import Kind
from bfrt.store.ordering.memory import least_memory
from bfrt.store.ordering.objects import SHORT_IDS

#: The fewest bytes of vertices that are worth a pass over a mesh that has more of them.
FEWEST = 8 << 20

#: What blocks and vertices take, at the most, for one byte of a file.
GROWTH = 64
VERTICES = 8

#: Bytes of an object in a file, at the least: a face of three corners, by one byte each.
FEWEST_BYTES = 4

#: Corners of a face that the blocks have room for, and what each more takes: while it is read, in
#: the block that is written, and while it is brought into order (measured: 75 to 100 bytes).
CORNERS = 1 << 18
CORNER_BYTES = 128

#: What patches of float64, which normals make, take more than triangles: 72 bytes each, in blocks
#: and while they are brought into order (measured).
SMOOTH = 144 << 20

#: What the most colors take that a file of its own colors has.
COLORS = 32 << 20


class Taken(NamedTuple):
    """Counts the bytes that a format's reader takes, beside the process.

    Attributes
    ----------
    blocks : int
        Bytes of the blocks, if the file fills them.
    library : int
        Bytes of the library that reads the format; of HDF5, GDAL and E57 with the process that
        does so.
    fewest : int
        Bytes of the least room for vertices, or for a raster's blocks and rows.
    packed : bool
        Whether a file holds more than its bytes tell.
    kind : Kind
        Of the kinds that it may hold, that whose ordering takes most.
    """

    blocks: int
    library: int = 0
    fewest: int = 0
    packed: bool = False
    kind: Kind = Kind.PATCH

    @property
    def is_mesh(self) -> bool:
        """Tell whether a file may have faces that name vertices."""
        return self.fewest > 0 and self.kind == Kind.PATCH


OBJECTS = Taken(48 << 20)
POINTS = OBJECTS._replace(kind=Kind.SPHERE)
MESH = Taken(84 << 20, fewest=FEWEST)
HDF5 = MESH._replace(library=40 << 20, fewest=2 * FEWEST, packed=True)
LAS = POINTS._replace(library=4 << 20)
RASTER = OBJECTS._replace(library=72 << 20, fewest=FEWEST, packed=True, kind=Kind.TRIANGLE)
E57 = POINTS._replace(library=56 << 20, packed=True)

#: A palette's writer remembers materials that may come again, 65,536 at the most.
MATERIALS = 32 << 20

#: By suffix; all others have objects as they are.
FORMATS = {
    ".nff": OBJECTS._replace(blocks=OBJECTS.blocks + MATERIALS),
    ".npy": POINTS,
    ".stl": OBJECTS._replace(kind=Kind.TRIANGLE),
    ".ply": MESH,
    ".obj": MESH,
    ".npz": MESH._replace(packed=True),
    ".h5": HDF5,
    ".hdf5": HDF5,
    ".off": MESH,
    ".las": LAS,
    ".laz": LAS._replace(packed=True),
    **dict.fromkeys(DRIVERS, RASTER),
    ".e57": E57,
    **dict.fromkeys((".xyz", ".csv", ".txt", ".pts", ".pcd", ".lammpstrj", ".dump"), POINTS),
}


class Need(NamedTuple):
    """Tells what the conversion of a file takes.

    Attributes
    ----------
    name : str
        Name of the file, or of the scene that is converted.
    blocks : int
        Bytes, beside the room.
    reading : int
        Bytes of the least budget that works where objects are left in the order given.
    ordering : int
        Bytes of the least budget with which they can be brought into spatial order; 0 where they
        are not.
    """

    name: str
    blocks: int
    reading: int
    ordering: int = 0

    @property
    def least(self) -> int:
        """Return the bytes of the least budget that works."""
        return max(self.reading, self.ordering)


def need_of(
    name: str,
    size: int | None = None,
    *,
    colored: bool = False,
    smooth: bool = False,
    ordering: int = 0,
) -> Need:
    """Work out what a file's conversion takes.

    Parameters
    ----------
    name : str
        Name of the file, or of the scene that is converted.
    size : int, optional
        Bytes that are converted, where they are no file's.
    colored : bool
        Whether the file's own colors are taken.
    smooth : bool
        Whether faces become patches.
    ordering : int
        Bytes of the least budget with which its objects can be brought into spatial order.
    """
    taken = taken_by(name)
    full = full_of(taken, name) if size is None else size
    patches = SMOOTH if smooth and taken.is_mesh else 0
    most = taken.blocks + (COLORS if colored else 0) + patches
    blocks = BASELINE + taken.library + int(min(most, GROWTH * full))
    return Need(name, blocks, blocks + int(min(taken.fewest, VERTICES * full)), ordering)


def taken_by(name: str) -> Taken:
    """Return what the reader of a file's format takes."""
    return FORMATS.get(".nff" if name == "-" else suffix_of(name), OBJECTS)


def full_of(taken: Taken, name: str) -> float:
    """Return the bytes of a file as they count: without end where it holds more than they tell."""
    return math.inf if taken.packed or is_packed(name) else size_of(name)


def ordering_of(name: str, *, wide: bool) -> int:
    """Return the least budget with which any file of a format and size can be ordered, bytes.

    Parameters
    ----------
    name : str
        Name of the file, which is not read.
    wide : bool
        Whether coordinates may be float64.
    """
    taken = taken_by(name)
    full = full_of(taken, name)
    objects = int(min(SHORT_IDS, full // FEWEST_BYTES))
    return least_memory(taken.kind, objects, wide=wide)


def rooms_for(needs: list[Need], memory: int) -> list[int]:
    """The bytes that each file's conversion leaves of a budget, for they come one after the other.

    Raises
    ------
    BudgetError
        If the budget is less than the least that works for all, which the message names.
    """
    most = max(needs, key=lambda need: need.least)
    if memory < most.least:
        given = max(need.reading for need in needs)
        or_given = ""
        if format_memory(given) != format_memory(most.least):
            or_given = f", or {format_memory(given)} in the order given (--order given)"
        raise BudgetError(
            f"memory: found {memory >> 20}MiB, expected {format_memory(most.least)} or more to "
            f"convert {most.name}{or_given}"
        )
    return [memory - need.blocks for need in needs]


def check_corners(name: str, corners: int, room: int) -> None:
    """Refuse a face of more corners than memory holds as often as its conversion has them.

    Parameters
    ----------
    name : str
        Name of the file.
    corners : int
        Corners of the face.
    room : int
        Bytes of the budget that nothing else takes.

    Raises
    ------
    BudgetError
        If it is; the message tells how much is missing.
    """
    short = (corners - CORNERS) * CORNER_BYTES - room
    if short > 0:
        raise BudgetError(
            f"{name}: found a face of {corners} corners, expected a budget of "
            f"{format_memory(short)} more to convert it"
        )


def check_colors(name: str, size: int, room: int) -> None:
    """Refuse colors of a file's own, which nobody asked for, where the budget has no room for them.

    Raises
    ------
    BudgetError
        If it has none; the message tells how much is missing.
    """
    short = min(COLORS, GROWTH * size) - room
    if short > 0:
        raise BudgetError(
            f"{name}: found objects with colors of their own, expected a budget of "
            f"{format_memory(short)} more to convert them"
        )


def size_of(name: str) -> float:
    """Return a file's bytes; infinity for standard input, 0 for a file that cannot be looked at."""
    if name == "-":
        return math.inf
    try:
        found = facts_at(Path(name))
    except StreamError as error:
        if error.errno not in UNKNOWN:
            raise
        found = None
    if found is None:  # which its reader tells
        return 0
    return found.st_size if stat.S_ISREG(found.st_mode) else math.inf
