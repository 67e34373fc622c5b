"""The room on disk that ordering takes, told before it begins.

::

    files as given ─────────────────────────┐ go when the stream is in order
    parts, where the order is not local ──┐ │ go when the last window is read
    files in order ──────────────────────┐│ │ stay
                                         ▼▼ ▼
                               all at once, stream by stream
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from bfrt.records import (
    BOX_BYTES,
    NODE_BYTES,
    OFFSET_BYTES,
    PARENT_BYTES,
    TREELET_BYTES,
)
from bfrt.store.ordering.objects import Layout
from bfrt.store.ordering.regions import object_bytes

#: Objects of a node, a treelet and a box of the hierarchy, at the least that is usual: of a node
#: 10 to 14 were measured, of a treelet 700, and of the boxes all levels have one for 200.
OBJECTS_A_NODE = 8
OBJECTS_A_TREELET = 256
OBJECTS_A_PARENT = 100

#: What a stream of few objects takes more: a node, a treelet, and boxes of each level.
LEAST_BYTES = 1 << 10


class Amount(NamedTuple):
    """Counts what a stream has.

    Attributes
    ----------
    objects : int
    records : int
        Objects again, or vertices of polygons.
    local : bool
        Whether its order is local, so that objects are not parted.
    """

    objects: int
    records: int
    local: bool


class Room(NamedTuple):
    """Holds the bytes that a stream takes while it is brought into order.

    Attributes
    ----------
    given : int
        Of its files as given, without a hierarchy.
    parts : int
        Of its parts, at the most: what crowds in one part is parted again, up to once in all.
    ordered : int
        Of its files in order, about, with the hierarchy; rather more than less.
    """

    given: int
    parts: int
    ordered: int


def room_of(layout: Layout, amount: Amount) -> Room:
    """Work out the room of a stream."""
    kind, n = layout.kind, amount.objects
    same = amount.records * layout.stride + n * layout.material_bytes
    same += n * OFFSET_BYTES if kind.counted else 0
    boxes = n * BOX_BYTES
    parts = 0 if amount.local else amount.records * layout.stride + n * object_bytes(layout)
    tree = n // OBJECTS_A_NODE * NODE_BYTES + n // OBJECTS_A_TREELET * TREELET_BYTES
    levels = n // OBJECTS_A_PARENT * PARENT_BYTES
    ordered = same + n * layout.id_bytes + tree + levels + LEAST_BYTES
    ordered += boxes if kind.counted else 0
    return Room(same + (boxes if kind.boxed else 0), 2 * parts, ordered)


def room_beside(rooms: Iterable[Room]) -> int:
    """Return the most bytes that streams in turn take beside all files as given."""
    most = held = 0
    for room in rooms:
        most = max(most, held + room.parts + room.ordered)
        held += room.ordered - room.given
    return most
