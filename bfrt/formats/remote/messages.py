"""What is said between a process and one that a library reads in: a few words, and raw bytes.

::

    request   [verb, argument, ...]
    answer    [kind, ...] and bytes

    offset  bytes      what
         0      4      bytes of the text
         4      8      bytes behind it
        12             text: JSON
       ...             an array's numbers, in C order
"""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

SIZES = struct.Struct("<IQ")

#: Bytes of a text, at the most: names of many datasets.
MOST_TEXT = 1 << 28


class Ended(Exception):
    """Tells that the other process has ended, or says what is no message."""


class Channel:
    """Sends and receives messages.

    Parameters
    ----------
    source, target : io.FileIO
        Ends of two pipes, without a buffer.
    """

    def __init__(self, source: io.FileIO, target: io.FileIO) -> None:
        self._source, self._target = source, target

    def send(self, words: list[Any], numbers: NDArray[Any] | None = None) -> None:
        """Send words, and the numbers of an array.

        Raises
        ------
        Ended
            If nobody reads them.
        """
        text = json.dumps(words).encode()
        raw = memoryview(b"") if numbers is None else bytes_of(numbers)
        try:
            for part in (SIZES.pack(len(text), len(raw)) + text, raw):
                left = memoryview(part)
                while left:
                    left = left[self._target.write(left) :]
        except BrokenPipeError as error:
            raise Ended from error

    def receive(self) -> tuple[list[Any], int]:
        """Receive words, and how many bytes are behind them, which `fill` takes.

        Raises
        ------
        Ended
            If there are none to come, or something else comes.
        """
        head = bytearray(SIZES.size)
        self.fill(memoryview(head))
        length, behind = SIZES.unpack(head)
        if length > MOST_TEXT:
            raise Ended
        text = bytearray(length)
        self.fill(memoryview(text))
        try:
            words = json.loads(text)
        except ValueError:
            raise Ended from None
        if not isinstance(words, list) or not words:
            raise Ended
        return words, behind

    def fill(self, buffer: memoryview) -> None:
        """Receive as many bytes as the buffer has; else as `receive`."""
        done = 0
        while done < len(buffer):
            got = self._source.readinto(buffer[done:])
            if not got:
                raise Ended
            done += got


def bytes_of(numbers: NDArray[Any]) -> memoryview:
    """Return the bytes of an array in C order."""
    return memoryview(np.ascontiguousarray(numbers).reshape(-1).view(np.uint8))


def words_of_type(dtype: np.dtype[Any]) -> Any:
    """Return a dtype as JSON has it."""
    if dtype.subdtype is not None:
        return [words_of_type(dtype.base), list(dtype.shape)]
    if dtype.fields is None:
        return dtype.str
    names = list(dtype.names or ())
    return {
        "names": names,
        "formats": [words_of_type(dtype.fields[name][0]) for name in names],
        "offsets": [dtype.fields[name][1] for name in names],
        "itemsize": dtype.itemsize,
    }


def type_of_words(words: Any) -> np.dtype[Any]:
    """Return the dtype that `words_of_type` has put into words."""
    if isinstance(words, list):
        base, shape = words
        return np.dtype((type_of_words(base), tuple(shape)))
    if isinstance(words, str):
        return np.dtype(words)
    formats = [type_of_words(each) for each in words["formats"]]
    whole: Any = {**words, "formats": formats}
    made: np.dtype[Any] = np.dtype(whole)
    return made
