"""Ids of objects: 64 bits, the stream's number and the object's place in it.

::

    63        48 47                             0
    [ stream    | index                         ]     stream = group << KIND_BITS | kind

A kind more renumbers nothing, and neither does a group.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bfrt.records import INDEX_BITS, KIND_BITS, STREAM_BITS, Kind

#: One id, or an array of them.
Ids = TypeVar("Ids", int, NDArray[np.uint64])

#: Groups of a scene: their streams have numbers of 16 bits.
MOST_GROUPS = 1 << STREAM_BITS - KIND_BITS

_INDEX = (1 << INDEX_BITS) - 1


def stream_number(group: int, kind: Kind) -> int:
    """Return the number of a group's stream of a kind, as in ``geometry_ids``."""
    return group << KIND_BITS | kind


def kind_of(stream: int) -> Kind:
    """Return the kind of a stream's objects."""
    return Kind(stream & ((1 << KIND_BITS) - 1))


def group_of(stream: Ids) -> Ids:
    """Return the group of a stream."""
    return stream >> KIND_BITS if isinstance(stream, int) else stream >> np.uint64(KIND_BITS)


def object_id(stream: int, index: int) -> int:
    """Return the id of an object."""
    return stream << INDEX_BITS | index


def stream_of(id: Ids) -> Ids:
    """Return the number of the stream that an object is in."""
    return id >> INDEX_BITS if isinstance(id, int) else id >> np.uint64(INDEX_BITS)


def index_of(id: Ids) -> Ids:
    """Return an object's place in its stream."""
    return id & _INDEX if isinstance(id, int) else id & np.uint64(_INDEX)
