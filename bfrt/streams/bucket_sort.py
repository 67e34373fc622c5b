"""Records of a spool, parted by a number in each: a sort of more than memory holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.records import plain
from bfrt.streams.spool import Records, Spool

#: Parts that records are divided into at once; each is a file.
PARTS = 64

#: The numbers of some records.
Numbers = Callable[[Records], NDArray[np.int64]]


def buckets_of(
    records: Spool, numbers: Numbers, first: int, last: int, room: int, *, once: bool = False
) -> Iterator[Spool]:
    """Yield all records in spools, one after another, by ascending ranges of their numbers.

    Each has `room` records at the most, unless they are of one number, or are parted `once` only.
    No more are in memory at once; a spool is empty when the next is asked for.

    Parameters
    ----------
    records : Spool
        Numbers are in [first, last). It is empty at the end.
    """
    if len(records) <= room or last - first <= 1:
        if len(records):
            yield records
        return
    width = -(-(last - first) // PARTS)
    parts = [records.beside() for _ in range(first, last, width)]
    try:
        while len(records):
            some = records.read(-(-room // 2))  # half, for what sorts them takes memory too
            where = (numbers(some) - first) // width
            some = plain(some)[np.argsort(where, kind="stable")].view(some.dtype)
            ends = np.cumsum(np.bincount(where, minlength=len(parts)))
            for part, begin, end in zip(parts, [0, *ends[:-1]], ends, strict=True):
                if begin < end:
                    part.append(some[begin:end])
        records.clear()
        for number, part in enumerate(parts):
            begin = first + number * width
            if once and len(part):
                yield part
            elif not once:
                yield from buckets_of(part, numbers, begin, min(last, begin + width), room)
            part.clear()
    finally:
        for part in parts:
            part.close()


def gathered(records: Spool, room: int) -> NDArray[Any]:
    """Return the next records of a spool, `room` at most."""
    found = []
    while len(records) and room:
        found.append(records.read(room))
        room -= len(found[-1])
    return found[0] if len(found) == 1 else np.concatenate(found)
