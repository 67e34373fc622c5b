"""The open files of a stream, which all workers share."""

from __future__ import annotations

from bfrt.errors import StoreError
from bfrt.store.stream import Stream
from bfrt.streams.reader import Reader, SharedFile


def wrong_ends(path: str, first: int, ends: tuple[int, ...]) -> StoreError:
    """Return an error for polygons, from object `first` on, that end where they cannot."""
    found = ", ".join(map(str, ends))
    return StoreError(
        f"{path}: polygon {first} and on: found vertices {found}, expected ascending ones that are "
        "there"
    )


class StreamFiles:
    """Opens each file of a stream when it is first read.

    Parameters
    ----------
    stream : Stream
    lazy : bool
        Whether what is read may be prefetched.
    """

    def __init__(self, stream: Stream, lazy: bool) -> None:
        self.lazy = lazy
        self._stream = stream
        self._files: dict[str, SharedFile] = {}

    def reader(self, name: str, capacity: int) -> Reader:
        """Return a reader of a file, with a buffer of `capacity` bytes.

        Raises
        ------
        StoreError
            If the file is another by now than when the store was opened.
        StreamError
            As the system refuses.
        """
        if name not in self._files:
            self._files[name] = self._stream.opened(name, self.lazy)
        return Reader(self._files[name], capacity, self.lazy)

    def counts(self) -> tuple[int, int]:
        """Count bytes read and seeks since the last call."""
        counts = [file.counts() for file in self._files.values()]
        return sum(c[0] for c in counts), sum(c[1] for c in counts)
