"""Changes of inputs, by a seed: what is drawn is the same on every machine.

It is what runs where there is no atheris, and where it is, half of its inputs.
"""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable, Iterable, Sequence

from fuzz.packing import packed, unpacked

#: Numbers as text: the least and the greatest of types, and what is no number.
TEXTS = (
    b"0", b"1", b"-1", b"-0", b"2", b"3", b"7", b"127", b"255", b"256", b"32768", b"65535",
    b"65536", b"2147483647", b"-2147483648", b"4294967295", b"4294967296",
    b"9223372036854775807", b"18446744073709551616", b"99999999999999999999999", b"1e38", b"3.5e38",
    b"1e300", b"1e999", b"-1e300", b"1e-45", b"1e-320", b"nan", b"inf", b"-inf", b".5", b"1.",
    b"0x10", b"",
)  # fmt: skip

#: Whole numbers, of which a word gets as many bits as it has.
WHOLE = (
    0, 1, 2, 3, 7, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 1 << 20, (1 << 31) - 1, 1 << 31,
    (1 << 32) - 1, 1 << 32, 1 << 48, (1 << 63) - 1, 1 << 63, (1 << 64) - 1,
)  # fmt: skip

REAL = (0.0, -0.0, 1.0, 1e-45, 1e-300, 1e38, -1e38, 1e300, -1e300, 1e18, 0.5, 1000.0,
        float("inf"), float("-inf"), float("nan"))  # fmt: skip

#: A number in text, and how much of an input is searched for one.
NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?")
NEARBY = 400

#: Changes of one input: mostly few, so that it is still nearly right.
CHANGES = (1, 1, 1, 1, 2, 2, 3, 4, 8, 16)

#: Bytes that a span has, at the most, and an input.
SPAN = 64
MOST_BYTES = 1 << 16

#: Names of files that are text, whose size says nothing.
TEXT = re.compile(r".*\.(json|obj|mtl)")

Change = Callable[[bytearray, random.Random], None]


def flip(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def set_byte(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] = rng.randrange(256)


def set_word(data: bytearray, rng: random.Random) -> None:
    """Replace a word, aligned or not, of either byte order, by an extreme."""
    order = rng.choice("<>")
    if rng.random() < 0.5:
        size = rng.choice((1, 2, 4, 8))
        word = (rng.choice(WHOLE) % (1 << 8 * size)).to_bytes(
            size, "little" if order == "<" else "big"
        )
    else:
        form = rng.choice("fd")
        number = rng.choice(REAL)
        if form == "f" and 1e39 < abs(number) < float("inf"):
            number = 3e38
        word = struct.pack(order + form, number)
    at = rng.randrange(len(data))
    if rng.random() < 0.5:
        at -= at % len(word)
    data[at : at + len(word)] = word[: len(data) - at]


def set_number(data: bytearray, rng: random.Random) -> None:
    """Replace a number that is text by an extreme."""
    found = NUMBER.search(data, rng.randrange(len(data)))
    if found is not None and found.end() - found.start() < NEARBY:
        data[found.start() : found.end()] = rng.choice(TEXTS)


def remove(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    del data[at : at + rng.randint(1, SPAN)]


def repeat(data: bytearray, rng: random.Random) -> None:
    """Put a span a second time, somewhere."""
    at, to = rng.randrange(len(data)), rng.randrange(len(data))
    data[to:to] = data[at : at + rng.randint(1, SPAN)] * rng.choice((1, 1, 1, 2, 50))


def overwrite(data: bytearray, rng: random.Random) -> None:
    """Put a span over another."""
    at, to = rng.randrange(len(data)), rng.randrange(len(data))
    span = data[at : at + rng.randint(1, SPAN)]
    data[to : to + len(span)] = span


def truncate(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


#: Changes that leave the size as it is, and all; some come more often.
OF_A_SIZE: tuple[Change, ...] = (flip, flip, set_byte, set_word, set_word, set_word, overwrite)
ALL: tuple[Change, ...] = (*OF_A_SIZE, set_number, set_number, remove, repeat)


class Mutator:
    """Makes inputs of others.

    Parameters
    ----------
    seeds : sequence of bytes
        Inputs that are right.
    tokens : sequence of bytes
        Words of the format.
    """

    def __init__(self, seeds: Sequence[bytes], tokens: Sequence[bytes] = ()) -> None:
        self._seeds = list(seeds)
        self._tokens = tokens

    def learn(self, inputs: Iterable[bytes]) -> None:
        """Begin with these inputs too."""
        self._seeds += inputs

    def made(self, key: str) -> bytes:
        """The input of a key: a seed that was changed."""
        rng = random.Random(key)
        return self.changed(rng.choice(self._seeds), rng)

    def changed(self, data: bytes, rng: random.Random) -> bytes:
        """An input, changed."""
        own = bytearray(data or rng.choice(self._seeds))
        for _ in range(rng.choice(CHANGES)):
            if own:
                self._change(own, rng)
        if own and rng.random() < 0.05:
            truncate(own, rng)
        return bytes(own[:MOST_BYTES])

    def _change(self, data: bytearray, rng: random.Random) -> None:
        chance = rng.random()
        if chance < 0.1 and self._tokens:
            at = rng.randrange(len(data))
            end = at + rng.choice((0, 0, rng.randint(1, SPAN)))
            data[at:end] = rng.choice(self._tokens)
        elif chance < 0.13:
            other = rng.choice(self._seeds)
            cut = rng.randrange(len(other) + 1)
            data[rng.randrange(len(data)) :] = other[cut:]
        else:
            rng.choice(ALL)(data, rng)


class FilesMutator(Mutator):
    """Makes inputs of several files (fuzz.packing), mostly by a change of one of them.

    Parameters
    ----------
    seeds, tokens : sequence of bytes
    names : sequence of str
        Names of files that there may be.
    head : int
        Bytes before the files, each a number of its own.
    """

    def __init__(
        self, seeds: Sequence[bytes], tokens: Sequence[bytes], names: Sequence[str], head: int
    ) -> None:
        super().__init__(seeds, tokens)
        self._names, self._head = names, head

    def changed(self, data: bytes, rng: random.Random) -> bytes:
        files = unpacked(data[self._head :], self._names)
        if not any(files.values()) or rng.random() < 0.05:
            return super().changed(data, rng)
        name = rng.choice(sorted(name for name in files if files[name]))
        if TEXT.fullmatch(name) or rng.random() < 0.2:
            files[name] = super().changed(files[name], rng)
        else:
            own = bytearray(files[name])
            for _ in range(rng.choice(CHANGES)):
                rng.choice(OF_A_SIZE)(own, rng)
            files[name] = bytes(own)
        if rng.random() < 0.02:
            del files[name]
        head = bytearray(data[: self._head])
        if head and rng.random() < 0.1:
            set_byte(head, rng)
        return bytes(head) + packed(files, self._names)
