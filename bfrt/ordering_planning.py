"""The plan of an ordering: what it takes to make a store's twin in spatial order.

The disk is worked out as by the conversion that brings objects into order, which refuses a disk
that has less.
"""

from __future__ import annotations

from bfrt.memory import BASELINE
from bfrt.planned import ASSUMED, OrderingPlan
from bfrt.records import BOX_BYTES, NODE_BYTES, TREELET_BYTES
from bfrt.store.ordering.parts import WEIGHING, WINDOW
from bfrt.store.ordering.room import NODES, NODES_OBJECTS, room_beside, traffic_of
from bfrt.store.store import Store
from bfrt.store.stream import Stream
from bfrt.workers import WAITING, usable_threads

#: Bytes of an object beside its record: its material, its id, and those of a treelet's build: its
#: reference, its place in the order, and as many nodes and treelets.
BESIDE_BYTES = 4 + 8
BUILD_BYTES = 32 + 4 + NODE_BYTES + TREELET_BYTES


def ordering_of(store: Store) -> OrderingPlan | None:
    """Plan the ordering of a store's objects; None where all of them are in order."""
    if store.ordered:
        return None
    streams = [stream for stream in store.streams if stream.count and not stream.ordered]
    each = [(stream.given(store.origin), stream.local) for stream in streams]
    traffic = [traffic_of(files.layout, files.amount(local)) for files, local in each]
    read = sum(part.read for part in traffic)
    written = sum(part.written for part in traffic)
    threads = usable_threads()
    objects = sum(stream.count for stream in streams)
    seconds = (read + written) / ASSUMED.read_rate + objects / (ASSUMED.order_rate * threads)
    return OrderingPlan(
        disk=room_beside(files.room(local) for files, local in each),
        bytes_read=read,
        bytes_written=written,
        memory=max((memory_of(stream, threads) for stream in streams), default=BASELINE),
        seconds=seconds,
    )


def memory_of(stream: Stream, threads: int) -> int:
    """Return about the most bytes of memory that the ordering of a stream takes, all included.

    Windows wait, as they come and in order, with the nodes of the latter, and threads build some.
    """
    counted = stream.kind.counted
    records = stream.vertices if counted else stream.count
    weight = stream.count + (records // WEIGHING if counted else 0)
    waiting, built = (min(n * WINDOW, weight) for n in (threads + WAITING, threads))
    most = max(waiting * (WEIGHING if counted else 1), (threads + WAITING) * stream.largest)
    geometry = min(records, most) * stream.stride
    nodes = waiting * NODES * NODE_BYTES // NODES_OBJECTS
    windows = 2 * (geometry + waiting * (BESIDE_BYTES + BOX_BYTES)) + nodes
    return BASELINE + windows + built * BUILD_BYTES
