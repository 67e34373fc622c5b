"""What ordering takes, told before it begins: the room on disk, and the bytes that go through.

::

    files as given ─────────────────────────┐ go when the stream is in order
    parts, where the order is not local ──┐ │ go when the last window is read
    files in order ──────────────────────┐│ │ stay
                                         ▼▼ ▼
                               all at once, stream by stream

The room is a bound, which no scene comes above:

- A treelet's range is parted while it has more than 1,024 objects, for 32 levels as the heuristic
  likes it and halved below. An object is in a range of each level at the most, so there are no more
  ranges than 32 for each 1,024 objects, and of halves one for 512.
- A node that has no nodes below it has five objects or more, unless it is a treelet's root; one
  that has some has eight children, each with an object or more. So with L of the former and U of
  the latter there are 7 U + 4 L + 1 objects or more, and L is 7 U + 1 at the most: eight nodes for
  35 objects.
- A box of the hierarchy has `LEAST_CHILDREN` children or more, but for the last of its level.
- Windows are parts, of which two that follow each other weigh more than `WINDOW`. Where objects
  crowd, a part is parted again, each time in 64 times as small a place: 46 times as far as float32
  goes.
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
from bfrt.store._hierarchy import MOST_LEVELS
from bfrt.store.hierarchy import LEAST_CHILDREN
from bfrt.store.ordering.objects import Layout
from bfrt.store.ordering.parts import WEIGHING, WINDOW
from bfrt.store.ordering.regions import object_bytes

#: Nodes for so many objects at the most; objects of a treelet, but for the last of a window, and
#: weight of a window, at the least: 1 / (1/32 + 1/512), and a third of a 50th of WINDOW.
NODES, NODES_OBJECTS = 8, 35
OBJECTS_A_TREELET = 30
WEIGHT_A_WINDOW = WINDOW // 150

#: What a stream takes however few its objects are: two windows of a node each, levels of a box.
LEAST_BYTES = 2 * (NODE_BYTES + TREELET_BYTES) + MOST_LEVELS * PARENT_BYTES

#: Usual bytes of an object's part of nodes, treelets and levels (8 to 12 were measured).
USUAL_TREE_BYTES = 11


class Amount(NamedTuple):
    """Counts what a stream has.

    Attributes
    ----------
    objects : int
    records : int
        Objects again, or vertices of polygons.
    local : bool
        Whether its order is local, so that objects are not parted.
    largest : int
        Records of an object at the most.
    """

    objects: int
    records: int
    local: bool
    largest: int = 1

    @property
    def weight(self) -> int:
        """Return the most that all of it weighs, as windows do."""
        return self.objects + (self.records // WEIGHING if self.records > self.objects else 0)


class Room(NamedTuple):
    """Holds the bytes that a stream takes while it is brought into order.

    Attributes
    ----------
    given : int
        Of its files as given, without a hierarchy.
    parts : int
        Of its parts, at the most: what crowds in one part is parted again, up to once in all.
    ordered : int
        Of its files in order, at the most, with the hierarchy.
    """

    given: int
    parts: int
    ordered: int


class Traffic(NamedTuple):
    """Estimates the bytes that are read and written while streams are brought into order."""

    read: int
    written: int


def room_of(layout: Layout, amount: Amount) -> Room:
    """Work out the room of a stream."""
    kind, n = layout.kind, amount.objects
    same, boxes = _same_bytes(layout, amount), n * BOX_BYTES
    treelets = n // OBJECTS_A_TREELET + (n + amount.records // WEIGHING) // WEIGHT_A_WINDOW
    nodes = NODES * n // NODES_OBJECTS + treelets
    tree = nodes * NODE_BYTES + treelets * TREELET_BYTES
    tree += n // (LEAST_CHILDREN - 1) * PARENT_BYTES + LEAST_BYTES
    ordered = same + n * layout.id_bytes + tree + (boxes if kind.counted else 0)
    # While materials are written again in wider integers the narrower ones are there.
    ordered += n * (layout.material_bytes // 2)
    return Room(same + (boxes if kind.boxed else 0), 2 * _parted_bytes(layout, amount), ordered)


def traffic_of(layout: Layout, amount: Amount) -> Traffic:
    """Estimate the traffic of a stream, whose objects do not crowd."""
    n, same, parted = amount.objects, _same_bytes(layout, amount), _parted_bytes(layout, amount)
    ordered = same + n * (layout.id_bytes + USUAL_TREE_BYTES)
    ordered += n * BOX_BYTES if layout.kind.counted else 0
    return Traffic(same if amount.local else 2 * same + parted, parted + ordered)


def _same_bytes(layout: Layout, amount: Amount) -> int:
    """Return the bytes of the files that are the same in any order."""
    each = layout.material_bytes + (OFFSET_BYTES if layout.kind.counted else 0)
    return amount.records * layout.stride + amount.objects * each


def _parted_bytes(layout: Layout, amount: Amount) -> int:
    """Return the bytes of the objects in parts."""
    if amount.local:
        return 0
    return amount.records * layout.stride + amount.objects * object_bytes(layout)


def room_beside(rooms: Iterable[Room]) -> int:
    """Return the most bytes that streams in turn take beside all files as given."""
    most = held = 0
    for room in rooms:
        most = max(most, held + room.parts + room.ordered)
        held += room.ordered - room.given
    return most
