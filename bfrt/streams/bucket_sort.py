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
    records: Spool, numbers: Numbers, first: int, last: int, room: int
) -> Iterator[Spool]:
    """Yield all records in spools, one after another, by ascending ranges of their numbers.

    Each has `room` records at the most, unless they are of one number. No more are in memory at
    once; a spool is empty when the next is asked for.

    Parameters
    ----------
    records : Spool
        Numbers are in [first, last). It is empty at the end.
    """
    if len(records) <= room or last - first <= 1:
        if len(records):
            yield records
        return
    width = _width(first, last)
    parts = parted(records, numbers, first, last, room)
    try:
        for number, part in enumerate(parts):
            begin = first + number * width
            yield from buckets_of(part, numbers, begin, min(last, begin + width), room)
            part.clear()
    finally:
        for part in parts:
            part.close()


def parted(records: Spool, numbers: Numbers, first: int, last: int, room: int) -> list[Spool]:
    """Divide all records among spools of equal ranges of their numbers, ascending; close those.

    Parameters
    ----------
    records : Spool
        Numbers are in [first, last). It is empty afterwards.
    room : int
        Records in memory at once.
    """
    width = _width(first, last)
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
    except BaseException:
        for part in parts:
            part.close()
        raise
    records.clear()
    return parts


def _width(first: int, last: int) -> int:
    """Return the numbers of each part of a range."""
    return -(-(last - first) // PARTS)


def gathered(records: Spool, room: int) -> NDArray[Any]:
    """Return the next records of a spool, `room` at most."""
    found = []
    while len(records) and room:
        found.append(records.read(room))
        room -= len(found[-1])
    return found[0] if len(found) == 1 else np.concatenate(found)
