"""Dumps of LAMMPS: the atoms of one of their frames.

A frame begins with ``ITEM: TIMESTEP``; a pass over the file finds the one that is asked for. Scaled
coordinates are put into the box, which may be oblique; others are taken as they are.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.column_contents import rows_of_columns
from bfrt.formats.columns import POSITION, ColumnPoints, combined, refuse_repeated
from bfrt.formats.contents import Row
from bfrt.formats.lines._lines import MOST_COLUMNS
from bfrt.formats.lines.head import (
    BLANK,
    COUNT_DIGITS,
    LINE,
    Head,
    Place,
    ends_in,
    is_number,
)
from bfrt.formats.lines.table import LineTable, Names
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import write_points
from bfrt.formats.reading import POINTS, Reading
from bfrt.formats.source import Report, Source, quoted
from bfrt.formats.table import frame_of

#: What each part of a frame begins with, and the part that a frame begins with.
ITEM = b"ITEM:"
FRAME = b"ITEM: TIMESTEP"

#: Names of coordinates that are in the box's lengths, wrapped into it and not.
SCALED = (("xs", "ys", "zs"), ("xsu", "ysu", "zsu"))
PLAIN = (POSITION, ("xu", "yu", "zu"))

#: The byte that ends a line, or begins what ends it.
RETURN = ord("\r")

#: Lines of a frame before its atoms, at the most.
MOST_LINES = 64


class Frame(NamedTuple):
    """Says how a frame's atoms are.

    Attributes
    ----------
    head : Head
        Their columns.
    origin : (3,) float64
        A corner of the box.
    edges : (3, 3) float64
        The box's edges from there, one a row.
    """

    head: Head
    origin: NDArray[np.float64]
    edges: NDArray[np.float64]


def find_frame(source: Source, wanted: int) -> Place:
    """Find where a frame begins, from 0, or from -1 back.

    Raises
    ------
    SceneError
        If there are no frames.
    SettingError
        If there are fewer.
    """
    last: deque[Place] = deque(maxlen=max(-wanted, 1))
    count = 0
    for place in frames_of(source):
        last.append(place)
        count += 1
        if count == wanted + 1:
            return place
    if not count:
        raise SceneError(
            f"{source.name}: found no line {FRAME.decode()}, expected a dump of LAMMPS"
        )
    frame_of(wanted, count, source.name)
    return last[0]


def frames_of(source: Source) -> Iterator[Place]:
    """Yield the places where frames begin."""
    at, line = 0, 1
    for chunk in source.text(lines=True):
        text = chunk[:-1].tobytes()  # with the byte before
        done = begin = 1
        while (begin := text.find(FRAME, begin)) >= 0:
            if begin == 1 or text[begin - 1] in b"\r\n":
                line += ends_in(text, done, begin)
                done = begin
                yield Place(at + begin - 1, line)
            begin += len(FRAME)
        line += ends_in(text, done, len(text))
        at += len(text) - 1


def lines_from(source: Source, place: Place) -> Iterator[tuple[bytes, Place]]:
    """Yield lines from a place on, without their ends, each with the place behind it."""
    at, line = place
    for chunk in source.text(at, lines=True):
        text = chunk[1:-1].tobytes()
        begin = int(chunk[0] == RETURN and text.startswith(b"\n"))  # of a line that was yielded
        while begin < len(text):
            end = LINE.match(text, begin).end()  # type: ignore[union-attr]  # of any text
            line += 1
            yield text[begin:end].strip(), Place(at + end, line)
            begin = end
        at += len(text)


class Lines:
    """Takes the lines of a frame's begin, and says where one is not as expected."""

    def __init__(self, source: Source, place: Place) -> None:
        self.name = source.name
        self.place = place
        self._lines = itertools.islice(lines_from(source, place), MOST_LINES)
        self._last = b""

    def take(self) -> list[bytes]:
        """Return the words of the next line."""
        self._number = self.place.line
        self._last, self.place = next(self._lines, (b"", self.place))
        return self._last.split()

    def numbers(self, count: int, expected: str) -> list[float]:
        """Return the numbers of the next line, `count` of them; those behind count for nothing."""
        words = self.take()
        if len(words) < count or not all(map(is_finite, words[:count])):
            raise self.wrong(expected)
        return [float(word) for word in words[:count]]

    def wrong(self, expected: str) -> SceneError:
        """Return an error about the last line."""
        return SceneError(
            f"{self.name}: line {self._number}: found {quoted(self._last)}, expected {expected}"
        )


def is_finite(word: bytes) -> bool:
    """Tell whether a word is a number that is finite."""
    return is_number(word) and b"_" not in word and bool(np.isfinite(float(word)))


def read_frame(source: Source, place: Place) -> Frame:
    """Read what is before a frame's atoms.

    Raises
    ------
    SceneError
        If it is not as LAMMPS writes it.
    """
    lines = Lines(source, place)
    rows: int | None = None
    box: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    while True:
        words = lines.take()
        item = b" ".join(words[1:])
        if words[:1] != [ITEM]:
            raise lines.wrong("ITEM: and what follows")
        if item == b"NUMBER OF ATOMS":
            rows = count_of(lines)
        elif item.startswith(b"BOX BOUNDS"):
            box = box_of(lines, words[3:])
        elif item.startswith(b"ATOMS"):
            break
        else:  # TIMESTEP, UNITS, TIME
            lines.take()
    names = tuple(word.decode("utf-8", "replace").lower() for word in words[2:])
    if rows is None or box is None or not 3 <= len(names) <= MOST_COLUMNS:
        raise lines.wrong("ITEM: NUMBER OF ATOMS and ITEM: BOX BOUNDS before, and atoms' columns")
    return Frame(Head(names, BLANK, *lines.place, rows), *box)


def count_of(lines: Lines) -> int:
    words = lines.take()
    if len(words) != 1 or not words[0].isdigit() or len(words[0]) > COUNT_DIGITS:
        raise lines.wrong(f"the number of atoms, of {COUNT_DIGITS} digits or fewer")
    return int(words[0])


def box_of(lines: Lines, words: list[bytes]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read a box: its corner and its edges.

    Of an oblique one the bounds are those of the box around it; a general one has its edges as they
    are, each with a part of the corner behind.
    """
    if words[:2] == [b"abc", b"origin"]:
        rows = np.array([lines.numbers(4, "an edge of the box and its origin") for _ in range(3)])
        return rows[:, 3].copy(), rows[:, :3].copy()
    if words[:3] != [b"xy", b"xz", b"yz"]:
        rows = np.array([bounds_of(lines, 2) for _ in range(3)])
        return rows[:, 0].copy(), np.diag(rows[:, 1] - rows[:, 0])
    rows = np.array([bounds_of(lines, 3) for _ in range(3)])
    xy, xz, yz = rows[:, 2]
    low = rows[:, 0] - [min(0.0, xy, xz, xy + xz), min(0.0, yz), 0.0]
    high = rows[:, 1] - [max(0.0, xy, xz, xy + xz), max(0.0, yz), 0.0]
    edges = np.diag(high - low)
    edges[1, 0], edges[2, 0], edges[2, 1] = xy, xz, yz
    return low, edges


def bounds_of(lines: Lines, count: int) -> list[float]:
    """Read a line of two bounds, and of the tilt where there is one."""
    expected = "two bounds of the box, the lesser first" + (", and its tilt" if count == 3 else "")
    found = lines.numbers(count, expected)
    if found[0] > found[1]:
        raise lines.wrong(expected)
    return found


class Atoms:
    """Reads the atoms of a frame: `bfrt.formats.columns.Columns`."""

    dtype = np.dtype("f8")

    def __init__(self, source: Source, frame: Frame) -> None:
        self.name = source.name
        self._frame = frame
        self._table = LineTable(source, frame.head, behind=ITEM)
        there = [three for three in (*PLAIN, *SCALED) if set(three) <= set(frame.head.names)]
        self._from: Sequence[str] = there[0] if there else ()
        refuse_repeated(self.name, frame.head.names, self._from)
        own = [name for name in frame.head.names if not there or name not in POSITION]
        self.names: Sequence[str] = Names((*(POSITION if there else ()), *own))

    def columns(self, names: Sequence[str]) -> Iterator[NDArray[np.float64]]:
        """Yield columns, (n, len(names)), block by block; positions are in the box's units."""
        places = any(name in POSITION for name in names)
        wanted = [name for name in names if name not in POSITION]
        first = self._from if places else ()
        for block in self._table.columns((*first, *wanted)):
            positions = block[:, : len(first)]
            if self._from in SCALED and places:
                with np.errstate(all="ignore"):  # what is too large is refused behind
                    positions = self._frame.origin + combined(positions, self._frame.edges)
            parts = {**dict(zip(POSITION, positions.T, strict=False))}
            parts.update(zip(wanted, block[:, len(first) :].T, strict=True))
            yield np.stack([parts[name] for name in names], axis=-1)

    def full(self, names: Sequence[str]) -> float:
        return self._table.full(names)


def read_lammps(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read a frame of a dump of LAMMPS, the last by default: its atoms as spheres.

    Raises
    ------
    SceneError
        If it is no such dump, or its count is wrong.
    SettingError
        If a setting does not fit it, or there is no such frame.
    StreamError
        If the system refuses to read it.
    """
    reading.refuse_all_but(path, "frame", *POINTS)
    with Source(path, report) as source:
        writer = ObjectWriter(sink, path, reading)
        place = find_frame(source, -1 if reading.frame is None else reading.frame)
        atoms = Atoms(source, read_frame(source, place))
        write_points(ColumnPoints(atoms, reading), writer)
        writer.report()


def contents_of_lammps(path: str) -> list[Row]:
    """List the columns of a dump's first frame; else as `read_lammps`."""
    with Source(path) as source:
        frame = read_frame(source, find_frame(source, 0))
        columns = rows_of_columns(Atoms(source, frame).names, frame.head.rows, "text")
        return [Row("frames", (), "", "of which follows the first: --frame N"), *columns]
