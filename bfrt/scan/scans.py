"""The scans of a group: one of each stream for each worker, with shared files."""

from __future__ import annotations

import numpy as np

from bfrt.ids import index_of, stream_of
from bfrt.scan.files import StreamFiles
from bfrt.scan.given_order import GivenOrder
from bfrt.scan.scan import StreamScan
from bfrt.store.store import Group, Store
from bfrt.store.stream import Stream

#: Bytes of one read buffer; a worker has up to three and a few small ones a stream.
READ_BUFFER = 1 << 18


class GroupScans:
    """Reads the objects of a group by several workers.

    Parameters
    ----------
    store : Store
    group : Group
    threads : int
        Workers.
    buffer : int
        Bytes of one read buffer.
    lazy : bool
        Whether geometry is read only where it is needed.

    Attributes
    ----------
    streams : list of Stream
        The streams of the group.
    order : GivenOrder
        Which of two objects of the store comes first.
    """

    def __init__(self, store: Store, group: Group, threads: int, buffer: int, lazy: bool) -> None:
        self.streams = group.streams
        self.lazy = lazy
        self.order = GivenOrder(store.streams)
        self._files = {stream.number: StreamFiles(stream, lazy) for stream in group.streams}
        self._scans: dict[int, list[StreamScan]] = {}
        for stream in group.streams:
            own = [index_of(id) for id in group.outliers if stream_of(id) == stream.number]
            outliers = np.array(own, np.int64)
            files = self._files[stream.number]
            self._scans[stream.number] = [
                StreamScan(stream, store.origin, files, outliers, buffer) for _ in range(threads)
            ]

    @staticmethod
    def bytes(streams: list[Stream], threads: int) -> int:
        """Return the bytes of the read buffers of all workers."""
        largest = max((s.stride * s.largest for s in streams), default=0)
        return len(streams) * threads * (READ_BUFFER * 10 // 4 + largest)

    def of(self, stream: Stream) -> list[StreamScan]:
        """Return the scans of a stream, one a worker."""
        return self._scans[stream.number]

    def begin(self, stream: Stream, prefetched: bool) -> list[StreamScan]:
        """Bring the scans of a stream back to its first object, and return them.

        Parameters
        ----------
        prefetched : bool
            Whether boxes are prefetched.
        """
        scans = self._scans[stream.number]
        for scan in scans:
            scan.rewind(prefetched)
        return scans

    def counts(self) -> tuple[int, int]:
        """Count bytes read and seeks since the last call."""
        counts = [files.counts() for files in self._files.values()]
        return sum(c[0] for c in counts), sum(c[1] for c in counts)

    def geometry_read(self) -> int:
        """Count the objects whose geometry was read since the last call."""
        return sum(scan.counts() for scans in self._scans.values() for scan in scans)
