"""The memory that ordering takes, and how many windows are in it at once.

::

    reader ─► blocks ─► a window ─► threads build treelets ─► windows wait ─► one is written
                           │                 │                     │                │
                         given         given, made           made, `waiting`      made

With less memory there are fewer threads and fewer windows wait, down to one window at a time. What
a window is does not depend on that, so that the files are the same. Where parts are parted again
that happens while windows wait; blocks are a half of a window, or less.
"""

from __future__ import annotations

from typing import NamedTuple

from bfrt.errors import BudgetError
from bfrt.memory import BASELINE, format_memory
from bfrt.records import BOX_BYTES, NODE_BYTES, PARENT_BYTES, TREELET_BYTES, Kind
from bfrt.store.hierarchy import LEAST_CHILDREN
from bfrt.store.ordering.files import ORDERED_BUFFER, ordered_names
from bfrt.store.ordering.objects import OBJECTS_AT_ONCE, VERTICES_AT_ONCE, Layout
from bfrt.store.ordering.parts import CELLS, LEAST_VERTICES, WEIGHING, WINDOW
from bfrt.store.ordering.regions import COUNT_BYTES
from bfrt.store.ordering.room import NODES, NODES_OBJECTS, OBJECTS_A_TREELET, Amount
from bfrt.streams.writer import BUFFER_BYTES
from bfrt.workers import WAITING

#: Bytes of an object in memory beside its record: its material, its id.
BESIDE_BYTES = 4 + 8

#: Of one in a window that is made: its box, its part of nodes and treelets, and its material and
#: id as they are written.
TREE_BYTES = -(-NODES * NODE_BYTES // NODES_OBJECTS) + -(-TREELET_BYTES // OBJECTS_A_TREELET)
MADE_BYTES = BOX_BYTES + TREE_BYTES + 4 + 8

#: Of one while a window is built: its box again; and what stays with the thread: its reference,
#: its place in the order, nodes and treelets as they are built.
BUILT_BYTES = BOX_BYTES
BUILDER_BYTES = 32 + 4 + TREE_BYTES

#: Of one in a block that is brought to its cells: its box, code, cell, center, part, place twice.
PLACED_BYTES = BOX_BYTES + 8 + 8 + 24 + 2 + 8 + 4

#: Of a cell while cells are counted: weights, objects and records; while parts are made of them,
#: ends, parts, and two copies.
CELL_BYTES = 3 * 8 + 4 * 8


class Pace(NamedTuple):
    """Says how much is done at once.

    Attributes
    ----------
    threads : int
        Threads that each build a window.
    waiting : int
        Windows that wait beside those. Where none does the next is begun when the last is written.
    """

    threads: int
    waiting: int


#: One window at a time.
SLOWEST = Pace(1, 0)


class _Amounts(NamedTuple):
    """Counts objects and records that are in memory."""

    objects: int
    records: int

    def bytes(self, layout: Layout, each: int = 0) -> int:
        """Return the bytes of objects, with so many more for each."""
        counts = COUNT_BYTES if layout.kind.counted else 0
        return self.records * layout.stride + self.objects * (BESIDE_BYTES + counts + each)


def memory_of(layout: Layout, amount: Amount, pace: Pace) -> int:
    """Return the most bytes of memory that the ordering of a stream takes, all included.

    Parameters
    ----------
    layout : Layout
    amount : Amount
    pace : Pace
    """
    threads, waiting = pace
    built = _windows(layout, amount, threads)
    made = _windows(layout, amount, waiting + (waiting > 0), before=threads)
    builders = built.objects * BUILDER_BYTES
    block = _block(layout, amount)
    building = 2 * built.bytes(layout) + built.objects * (MADE_BYTES + BUILT_BYTES)
    windows = building + made.bytes(layout, MADE_BYTES) + block.bytes(layout)
    if amount.local or amount.weight <= WINDOW:
        return BASELINE + _buffers(layout, amount) + builders + windows
    # Parts that are parted again: the window that they are read for is not there yet.
    others = _windows(layout, amount, threads - 1)
    held = 2 * others.bytes(layout) + others.objects * (MADE_BYTES + BUILT_BYTES)
    blocks = (threads + waiting + 1) * (2 * block.bytes(layout) + block.objects * PLACED_BYTES)
    parting = CELLS * CELL_BYTES + blocks + held + made.bytes(layout, MADE_BYTES)
    return BASELINE + _buffers(layout, amount) + builders + max(windows, parting)


def least_memory(kind: Kind, objects: int, *, wide: bool) -> int:
    """Return the least budget with which objects of a kind can be ordered, bytes.

    Polygons have four vertices each; nothing is known of their order.
    """
    layout = Layout(kind, wide, (0.0, 0.0, 0.0))
    corners = LEAST_VERTICES if kind.counted else 1
    either = (Amount(objects, corners * objects, local, corners) for local in (True, False))
    return max(memory_of(layout, amount, SLOWEST) for amount in either)


def pace_for(layout: Layout, amount: Amount, memory: int, threads: int) -> Pace | None:
    """Return the pace at which a stream's ordering stays inside a budget, or None if none does.

    Parameters
    ----------
    layout : Layout
    amount : Amount
    memory : int
        Bytes of the whole process.
    threads : int
        Threads at the most.
    """
    paces = (Pace(t, w) for t in range(threads, 0, -1) for w in range(WAITING, -1, -1))
    fitting = (pace for pace in paces if memory_of(layout, amount, pace) <= memory)
    return next(fitting, None)


def check_memory(least: int, memory: int, name: str) -> None:
    """Refuse a budget that holds not even one window at a time.

    Parameters
    ----------
    least : int
        Bytes that it takes.
    memory : int
        Bytes of the whole process.
    name : str
        Name of the store.

    Raises
    ------
    BudgetError
        If it does; the message has the least that works.
    """
    if memory < least:
        raise BudgetError(
            f"memory: found {memory >> 20}MiB, expected {format_memory(least)} or more to bring "
            f"the objects of {name} into spatial order (--order given, order='given', takes less)"
        )


def _windows(layout: Layout, amount: Amount, number: int, before: int = 0) -> _Amounts:
    """Return the most that some windows have, when `before` others are there."""
    counted = layout.kind.counted
    # A polygon weighs as one object more for each four of its vertices, of which it has so many.
    objects = WINDOW // (1 + LEAST_VERTICES // WEIGHING) if counted else WINDOW
    records = max(WINDOW * WEIGHING, amount.largest) if counted else WINDOW
    return _Amounts(
        max(0, min(number * objects, amount.objects - before * objects)),
        max(0, min(number * records, amount.records - before * records)),
    )


def _block(layout: Layout, amount: Amount) -> _Amounts:
    """Return the most that a block has."""
    objects = min(OBJECTS_AT_ONCE, amount.objects)
    if not layout.kind.counted:
        return _Amounts(objects, objects)
    return _Amounts(objects, min(amount.records, max(VERTICES_AT_ONCE, amount.largest)))


def _buffers(layout: Layout, amount: Amount) -> int:
    """Return the bytes of the buffers of the files, which take memory as they fill."""
    record = layout.stride * amount.largest + BESIDE_BYTES + MADE_BYTES
    names = ordered_names(layout.kind)
    files = min(2 * ORDERED_BUFFER * len(names), amount.objects * record)
    levels = amount.objects * PARENT_BYTES // (LEAST_CHILDREN - 1)
    materials = min(2 * BUFFER_BYTES, amount.objects * layout.material_bytes)
    return files + materials + min(2 * BUFFER_BYTES, levels)
