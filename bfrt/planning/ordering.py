"""The plan of an ordering: what it takes to make a store's twin in spatial order.

Disk and memory are worked out as by the conversion that brings objects into order, which refuses a
disk, or a budget, that has less.
"""

from __future__ import annotations

from bfrt.memory import BASELINE
from bfrt.planning.planned import ASSUMED, OrderingPlan
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.memory import SLOWEST, Pace, memory_of
from bfrt.store.ordering.room import room_beside, traffic_of
from bfrt.store.store import Store
from bfrt.workers import WAITING, usable_threads


def ordering_of(store: Store) -> OrderingPlan | None:
    """Plan the ordering of a store's objects; None where all of them are in order."""
    if store.ordered:
        return None
    streams = [stream for stream in store.streams if stream.count and not stream.ordered]
    each = [
        (GivenFiles.of(stream.folder, stream.kind, vars(stream), store.origin), stream.local)
        for stream in streams
    ]
    known = [(files.layout, files.amount(local)) for files, local in each]
    traffic = [traffic_of(*stream) for stream in known]
    read = sum(part.read for part in traffic)
    written = sum(part.written for part in traffic)
    threads = usable_threads()
    fastest = Pace(threads, WAITING)
    objects = sum(stream.count for stream in streams)
    seconds = (read + written) / ASSUMED.read_rate + objects / (ASSUMED.order_rate * threads)
    return OrderingPlan(
        disk=room_beside(files.room(local) for files, local in each),
        bytes_read=read,
        bytes_written=written,
        memory=max((memory_of(*stream, fastest) for stream in known), default=BASELINE),
        memory_least=max((memory_of(*stream, SLOWEST) for stream in known), default=BASELINE),
        seconds=seconds,
    )
