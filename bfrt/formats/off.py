"""OFF and COFF: meshes of text, a vertex or a face a line.

Numbers are float64, for the text has no types. Colors are of vertices (COFF), else of faces.
Normals (NOFF) and texture coordinates (STOFF) are passed over. Behind its place a vertex has what
the word says: a normal before a color, but where the word is NCOFF, as MeshLab writes it, after.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import full_of
from bfrt.formats.contents import FACES, OWN_COLORS, VERTICES, Row
from bfrt.formats.contents import POINTS as POSITIONS
from bfrt.formats.lines._lines import Ragged
from bfrt.formats.lines.head import Place
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import PointBlock, write_points
from bfrt.formats.reading import AUTO, POINTS, RGB, Reading
from bfrt.formats.source import Report, Source, quoted

log = logging.getLogger(__name__)

#: Bytes in which the header has to end.
HEADER_BYTES = 1 << 16

#: The word that begins a file, of what there is, and of what is read.
WORD = re.compile(rb"(?:ST)?C?N?4?n?OFF|N?C?(?:ST)?OFF")
KNOWN = re.compile(rb"(?:ST)?C?N?OFF|N?C?(?:ST)?OFF")
COLOR, NORMAL = b"C", b"N"

#: A line without its comment, and its end.
LINE = re.compile(rb"([^#\r\n]*)[^\r\n]*(?:\r\n|\r|\n|\Z)")

#: Bytes of a line of a vertex, at the least, and of a face.
VERTEX_BYTES, FACE_BYTES = 6, 2

#: What is a whole number for sure.
EXACT = float(1 << 53)


class Header(NamedTuple):
    """Says what a file contains.

    Attributes
    ----------
    color_at : int, optional
        The column of a vertex at which its color begins.
    vertices, faces : int
    start : Place
        Where vertices begin.
    """

    color_at: int | None
    vertices: int
    faces: int
    start: Place


def read_header(source: Source) -> Header:
    """Read the word that begins a file, and the counts behind it.

    Raises
    ------
    SceneError
        If it is no OFF of those that are read, or counts more than fits.
    """
    words: list[bytes] = []
    word = b""
    for number, found in enumerate(LINE.finditer(source.head(HEADER_BYTES)), 1):
        where = f"{source.name}: line {number}: found {quoted(found[1].strip())}, expected"
        words += found[1].split()
        if words and not word:
            word = words.pop(0)
            if not WORD.fullmatch(word):
                raise SceneError(f"{where} OFF or COFF")
            if not KNOWN.fullmatch(word):
                raise SceneError(f"{where} OFF of three coordinates, without 4 or n")
        if words[:1] == [b"BINARY"]:
            raise SceneError(f"{where} OFF of text")
        if word and words:
            if not 2 <= len(words) <= 3 or not all(w.isdigit() and len(w) < 16 for w in words):
                raise SceneError(f"{where} the numbers of vertices, faces and edges")
            header = Header(
                color_at(word), int(words[0]), int(words[1]), Place(found.end(), number + 1)
            )
            check_counts(source, header)
            return header
    raise SceneError(f"{source.name}: found no counts, expected OFF and the numbers of vertices")


def color_at(word: bytes) -> int | None:
    """Return the column of a vertex at which its color begins, by the word; None if it has none."""
    if COLOR not in word:
        return None
    return 6 if NORMAL in word and word.index(COLOR) < word.index(NORMAL) else 3


def check_counts(source: Source, header: Header) -> None:
    """Refuse counts that the file has no room for."""
    least = header.vertices * VERTEX_BYTES + header.faces * FACE_BYTES
    if least > source.most_text + 1:
        raise SceneError(
            f"{source.name}: found {source.most_text} bytes, expected {least} or more for "
            f"{header.vertices} vertices and {header.faces} faces: the file is truncated or its "
            "count is wrong"
        )


class Off:
    """Reads an open OFF file, its vertices and its faces, as often as needed."""

    def __init__(self, source: Source) -> None:
        self.name = source.name
        self.header = read_header(source)
        self._source = source
        self._behind: Place | None = None  # the vertices, once they were read

    def vertices(self) -> Iterator[NDArray[np.float64]]:
        """Yield the numbers of vertices, all as many, (n, k) at a time."""
        width = 0
        lines = Ragged(self.header.start.line, self.header.vertices)
        for values, counts, numbers in self._lines(lines, self.header.start, "vertices"):
            width = width or int(counts[0])
            other = counts != width
            if width < 3 or other.any():
                bad = int(np.argmax(other)) if width >= 3 else 0
                expected = f"{width} as before" if width >= 3 else "three or more"
                raise SceneError(
                    f"{self.name}: line {numbers[bad]}: found {counts[bad]} numbers of a vertex, "
                    f"expected {expected}"
                )
            yield values.reshape(-1, width)

    def faces(self) -> Iterator[tuple[Faces, NDArray[np.float64] | None]]:
        """Yield faces, and their colors, (n, 3), where all of a block have some."""
        if self._behind is None:
            for _ in self.vertices():
                pass
        start = self._behind or self.header.start
        lines = Ragged(start.line, self.header.faces)
        for values, counts, numbers in self._lines(lines, start, "faces"):
            yield self._faces(values, counts.astype(np.int64), numbers)

    def _faces(
        self, values: NDArray[np.float64], counts: NDArray[np.int64], numbers: NDArray[np.int64]
    ) -> tuple[Faces, NDArray[np.float64] | None]:
        starts = np.cumsum(counts) - counts
        corners = values[starts]
        fits = (corners >= 0) & (corners < counts) & (corners == np.floor(corners))
        if not fits.all():
            bad = int(np.argmin(fits))
            raise SceneError(
                f"{self.name}: line {numbers[bad]}: found {corners[bad]:.15g} and "
                f"{counts[bad] - 1} numbers, expected the number of corners and their vertices"
            )
        place = np.arange(len(values)) - np.repeat(starts, counts)
        indices = values[(place > 0) & (place <= np.repeat(corners, counts))]
        whole = (np.abs(indices) < EXACT) & (indices == np.floor(indices))
        if not whole.all():
            bad = int(np.argmin(whole))
            line = numbers[np.searchsorted(np.cumsum(corners), bad, "right")]
            raise SceneError(
                f"{self.name}: line {line}: found {indices[bad]:.15g}, expected a vertex's number"
            )
        left = counts - 1 - corners
        colors = None
        if ((left == 3) | (left == 4)).all():
            first = (starts + 1 + corners).astype(np.int64)
            colors = values[first[:, None] + np.arange(3)]
        return Faces(indices.astype(np.int64), corners.astype(np.uint32)), colors

    def _lines(
        self, lines: Ragged, start: Place, what: str
    ) -> Iterator[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]:
        """Yield lines of numbers, block by block, as many as there are to be."""
        at = start.at
        for chunk in self._source.text(at, lines=True):
            values, counts, numbers, used = lines.parse(chunk)
            if lines.failed:
                raise SceneError(
                    f"{self.name}: line {lines.line}: found {quoted(lines.token)}, expected a "
                    "number"
                )
            if len(counts):
                yield values, counts, numbers
            at += used
            if lines.done:
                break
        if not lines.done:
            raise SceneError(
                f"{self.name}: found the file's end behind {lines.rows} {what}, expected "
                f"{getattr(self.header, what)}: the file is truncated or its count is wrong"
            )
        if what == "vertices":
            self._behind = Place(at, lines.line)
        elif left := self._source.text_left(at):
            log.warning(
                "%s: %d bytes behind the last face were passed over: its count may be wrong",
                self.name,
                left,
            )


class OffMesh:
    """Presents an OFF file as a `bfrt.formats.mesh.Mesh`, or without faces as points."""

    row = coordinates = np.dtype("f8")
    what = "vertex"
    has_normals = False  # those of NOFF are passed over
    normals = None

    def __init__(self, off: Off, reading: Reading) -> None:
        self.name = off.name
        self.vertices = off.header.vertices
        self._off = off
        self.painted = reading.color_by == RGB
        self._of_vertices = self.painted and off.header.color_at is not None
        self._of_faces = self.painted and not self._of_vertices
        self.columns = 6 if self._of_vertices else 3
        for _ in off.vertices():  # so many there are, before memory is taken for them
            pass

    def _colors(self) -> Iterator[NDArray[np.float64]]:
        """Yield the colors of vertices or of faces as the file has them, (n, 3)."""
        if self._of_vertices:
            at = self._off.header.color_at or 0
            for block in self._off.vertices():
                if block.shape[1] < at + 3:
                    raise SceneError(
                        f"{self.name}: found {block.shape[1]} numbers of a vertex, expected "
                        f"{at + 3} or more, with its color"
                    )
                yield block[:, at : at + 3]
            return
        for _, colors in self._off.faces():
            if colors is None:
                raise SettingError(
                    f"{self.name}: found a face without a color, expected one for each to color by"
                )
            yield colors

    @cached_property
    def _full(self) -> float:
        """Return the number that means full color: 255, or 1 where none is greater."""
        blocks = (np.nan_to_num(block, posinf=0.0) for block in self._colors())
        return full_of(self.name, np.dtype("i8"), blocks)

    def vertex_blocks(self) -> Iterator[NDArray[np.float64]]:
        if not self._of_vertices:
            yield from (block[:, :3] for block in self._off.vertices())
            return
        scale = self._full
        for block, colors in zip(self._off.vertices(), self._colors(), strict=True):
            yield np.hstack([block[:, :3], colors / scale])

    def face_blocks(self) -> Iterator[Faces]:
        scale = self._full if self._of_faces else 1.0
        for faces, colors in self._off.faces():
            values = colors / scale if self._of_faces and colors is not None else None
            yield faces._replace(values=values)

    def blocks(self) -> Iterator[PointBlock]:
        for block in self.vertex_blocks():
            yield PointBlock(block[:, :3], None, block[:, 3:] if self._of_vertices else None)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return iter(())  # colors are all there is, and need no range


def read_off(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an OFF file: its faces, or where it has none its vertices as spheres.

    Raises
    ------
    SceneError
        If it is no OFF of text, or is not as its counts say.
    SettingError
        If a setting does not fit it.
    StreamError
        If the system refuses to read it.
    """
    with Source(path, report) as source:
        if reading.color_by not in (None, RGB) and reading.uses.files == 1:
            raise SettingError(f"{path}: found color_by={reading.color_by!r}, expected {RGB}")
        writer = ObjectWriter(sink, path, reading)
        mesh = OffMesh(Off(source), reading)
        if mesh._off.header.faces:
            write_mesh(mesh, writer)
        else:
            reading.refuse_all_but(path, *POINTS)
            if isinstance(reading.radius, str) and reading.radius != AUTO:
                raise SettingError(
                    f"{path}: found radius={reading.radius!r}, expected a number or {AUTO}"
                )
            mesh.painted = mesh._of_vertices
            write_points(mesh, writer)
        writer.report()


def contents_of_off(path: str) -> list[Row]:
    """Tell how many vertices and faces an OFF file counts; else as `read_off`."""
    with Source(path) as source:
        header = read_header(source)
    use = VERTICES if header.faces else POSITIONS
    colored = "" if header.color_at is None else f", {OWN_COLORS}"
    rows = [Row("vertices", (header.vertices,), "text", use + colored)]
    return rows + ([Row("faces", (header.faces,), "text", FACES)] if header.faces else [])
