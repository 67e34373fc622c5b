"""The memory that a conversion takes, and the room that it leaves for a mesh's vertices.

Beside the process there are blocks: those that are read, that objects are made of, that wait for
threads, and that are written. They are of fixed sizes, and a small file does not fill them::

    memory = BASELINE + libraries + blocks, at most GROWTH times the file + room
"""

from __future__ import annotations

import math
import stat
from pathlib import Path
from typing import NamedTuple

from bfrt.errors import BudgetError, StreamError
from bfrt.memory import BASELINE, format_memory
from bfrt.paths import UNKNOWN, facts_at

#: The fewest bytes of vertices that are worth a pass over a mesh that has more of them.
FEWEST = 8 << 20

#: What blocks and vertices take, at the most, for one byte of a file.
GROWTH = 64
VERTICES = 8


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
        Bytes of the library that reads the format, of HDF5 with the process that does so.
    fewest : int
        Bytes of the least room for vertices.
    packed : bool
        Whether a file holds more than its bytes tell.
    """

    blocks: int
    library: int = 0
    fewest: int = 0
    packed: bool = False


OBJECTS = Taken(48 << 20)
MESH = Taken(84 << 20, fewest=FEWEST)
HDF5 = MESH._replace(library=40 << 20, fewest=2 * FEWEST, packed=True)
LAS = OBJECTS._replace(library=4 << 20)

#: A palette's writer remembers materials that may come again, 65,536 at the most.
MATERIALS = 32 << 20

#: By suffix; all others have objects as they are.
FORMATS = {
    ".nff": OBJECTS._replace(blocks=OBJECTS.blocks + MATERIALS),
    ".ply": MESH,
    ".obj": MESH,
    ".npz": MESH._replace(packed=True),
    ".h5": HDF5,
    ".hdf5": HDF5,
    ".las": LAS,
    ".laz": LAS._replace(packed=True),
}


class Need(NamedTuple):
    """Tells what the conversion of a file takes.

    Attributes
    ----------
    name : str
        Name of the file, or of the scene that is converted.
    blocks : int
        Bytes, beside the room.
    least : int
        Bytes of the least budget that works.
    """

    name: str
    blocks: int
    least: int


def need_of(
    name: str, size: int | None = None, *, colored: bool = False, smooth: bool = False
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
    """
    taken = FORMATS.get(".nff" if name == "-" else Path(name).suffix.lower(), OBJECTS)
    full = math.inf if taken.packed else size_of(name) if size is None else size
    most = taken.blocks + (COLORS if colored else 0) + (SMOOTH if smooth and taken.fewest else 0)
    blocks = BASELINE + taken.library + int(min(most, GROWTH * full))
    return Need(name, blocks, blocks + int(min(taken.fewest, VERTICES * full)))


def rooms_for(needs: list[Need], memory: int) -> list[int]:
    """The bytes that each file's conversion leaves of a budget, for they come one after the other.

    Raises
    ------
    BudgetError
        If the budget is less than the least that works for all, which the message names.
    """
    most = max(needs, key=lambda need: need.least)
    if memory < most.least:
        raise BudgetError(
            f"memory: found {memory >> 20}MiB, expected {format_memory(most.least)} or more to "
            f"convert {most.name}"
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
