"""A trial of HDF5 files in a process of its own, which may end at what is broken in them.

HDF5 itself ends the process, or writes where it may not, when it opens a virtual dataset whose
description is damaged. So what may be virtual is opened elsewhere first. Of most datasets a look at
their headers tells that they are not, and no process is made.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from collections.abc import Iterator

from bfrt.errors import SceneError
from bfrt.formats.source import Source

#: What the process does: it opens all, and whatever is said of it does not matter. It has modules
#: from where they are here, not from the working folder, which may have sources of the same names.
TRY = """
import contextlib, sys
sys.path[:] = sys.argv[2:]
from bfrt.errors import BfrtError
from bfrt.formats.datasets import Datasets
from bfrt.formats.source import Source
with contextlib.suppress(BfrtError), Source(sys.argv[1]) as source:
    datasets = Datasets(source, tried=True)
    for name in datasets:
        with contextlib.suppress(BfrtError):
            datasets[name]
"""

#: Messages of an object's header, and the class of a dataset's layout that is virtual.
LAYOUT, CONTINUATION, VIRTUAL = 0x08, 0x10, 3

#: Blocks of a header, and bytes of one, that are looked at: those of datasets are few and small.
MOST_BLOCKS = 64
MOST_BYTES = 1 << 16


def try_file(path: str) -> None:
    """Open all that a file has in another process.

    Raises
    ------
    SceneError
        If that ends the process.
    """
    there = [os.path.abspath(folder) for folder in sys.path]  # noqa: PTH100
    child = [sys.executable, "-c", TRY, os.path.abspath(path), *there]  # noqa: PTH100
    ended = subprocess.run(child, capture_output=True)
    if ended.returncode:
        raise SceneError(
            f"{path}: found what ends HDF5 itself (status {ended.returncode}), expected datasets "
            "that are whole"
        )


def may_be_virtual(source: Source, address: int) -> bool:
    """Tell whether a dataset's header, at an address, says virtual or says nothing clear."""
    try:
        return next(layouts(source, address)) == VIRTUAL
    except (StopIteration, struct.error, IndexError):
        return True


def layouts(source: Source, address: int) -> Iterator[int]:
    """Yield the layout classes that a header names; a sound header names one."""
    head = block_of(source, address, 32)
    if head[:5] == b"OHDR\x02":
        flags = head[5]
        at = 6 + 16 * bool(flags & 0x20) + 4 * bool(flags & 0x10)
        width = 1 << (flags & 3)
        size = int.from_bytes(block_of(source, address + at, width), "little")
        blocks = [(address + at + width, size)]
        form, order = struct.Struct("<BHB"), 2 * bool(flags & 4)
    elif head[:1] == b"\x01":
        (size,) = struct.unpack_from("<I", head, 8)
        blocks = [(address + 16, size)]
        form, order = struct.Struct("<HHB3x"), 0
    else:
        return
    for place, length in blocks:
        block = block_of(source, place, length)
        ahead = 4 * (block[:4] == b"OCHK")
        while ahead + form.size + order <= len(block):
            kind, size, _ = form.unpack_from(block, ahead)
            ahead += form.size + order
            if kind == LAYOUT:
                yield block[ahead + (1 if block[ahead] >= 3 else 2)]
            if kind == CONTINUATION and len(blocks) < MOST_BLOCKS:
                blocks.append(struct.unpack_from("<QQ", block, ahead))
            ahead += size


def block_of(source: Source, place: int, size: int) -> bytes:
    """Return `size` bytes of a file, fewer where it ends."""
    if place >= source.size:
        return b""
    source.seek(place)
    return source.read(min(size, MOST_BYTES))
