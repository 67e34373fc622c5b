"""PLY: meshes and points, of bytes in either order or of text.

::

    header --> elements, each with its properties
    vertex --> blocks (n, columns)          whole rows by NumPy where all have one size
    face, tristrips --> corners, counts     by _ply.Rows, as are rows of text

Any element may have any properties in any order; what is not wanted is passed over. Where an
element begins is known once those before it were read, or have rows of one size.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Container, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats._ply import MOST_PROPERTIES, Fault, Rows
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.object_writer import ObjectWriter, SceneSink, cast
from bfrt.formats.points import PointBlock, write_points
from bfrt.formats.reading import COLORS, POINTS, RGB, Reading
from bfrt.formats.source import CHUNK_BYTES, Report, Source, shown
from bfrt.formats.text import MOST_CORNERS
from bfrt.records import INDEX_BITS

log = logging.getLogger(__name__)

#: Types of values by both of their names, in the order of _ply's. Integers of 64 bits are no
#: standard, but there are writers of them.
TYPES = {
    "char": 0, "uchar": 1, "short": 2, "ushort": 3, "int": 4, "uint": 5, "float": 6, "double": 7,
    "int8": 0, "uint8": 1, "int16": 2, "uint16": 3, "int32": 4, "uint32": 5, "float32": 6,
    "float64": 7, "int64": 8, "uint64": 9,
}  # fmt: skip
CODES = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8", "i8", "u8")
WHOLE = (0, 1, 2, 3, 4, 5, 8, 9)
LAYOUTS = {"ascii": "text", "binary_little_endian": "little", "binary_big_endian": "big"}

#: Types that a float32 holds exactly.
NARROW = (0, 1, 2, 3, 6)

#: What full color is.
FULL_COLOR = {1: 255.0, 3: 65535.0}

CORNERS = ("vertex_indices", "vertex_index")
POSITION = ("x", "y", "z")

#: Names that a file's own colors go by; of several the first counts.
COLOR_NAMES = (COLORS, ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))

#: Bytes of a header.
HEADER_BYTES = 1 << 20

#: Rows of one size that are read at once, and their bytes unless one row has more.
ROWS_AT_ONCE = 1 << 16
BLOCK_BYTES = 32 << 20


class Property(NamedTuple):
    """Describes a column; `counted` is the type of a list's count, or -1."""

    name: str
    kind: int
    counted: int = -1


class Element(NamedTuple):
    """Describes an element: a number of rows that have the same properties."""

    name: str
    rows: int
    properties: tuple[Property, ...]

    def least_bytes(self, layout: str) -> int:
        """Return the least bytes of a row: of a list its count; of text two a value."""
        if layout == "text":
            return 2 * len(self.properties)
        kinds = [p.kind if p.counted < 0 else p.counted for p in self.properties]
        return sum(int(CODES[kind][1]) for kind in kinds)

    @property
    def row_bytes(self) -> int | None:
        """Return the bytes of a row, or None where rows differ."""
        if any(p.counted >= 0 for p in self.properties):
            return None
        return sum(int(CODES[p.kind][1]) for p in self.properties)

    def find(self, name: str) -> Property | None:
        """Find a property by its name, unless it is a list."""
        return next((p for p in self.properties if p.name == name and p.counted < 0), None)

    def corners(self) -> Property | None:
        """Find the property that lists a face's vertices."""
        return next((p for p in self.properties if p.name in CORNERS and p.counted >= 0), None)


class Place(NamedTuple):
    """Marks the place where an element begins."""

    offset: int
    line: int


class Ply:
    """Reads an open PLY file: its header, and its elements as often as needed."""

    def __init__(self, path: str | os.PathLike[str], report: Report | None = None) -> None:
        self.source = Source(path, report)
        self.name = self.source.name
        try:
            self.layout, self.elements, first = read_header(self.source)
            self._check_counts(first.offset)
        except BaseException:
            self.source.close()
            raise
        self._places = [first]

    def element(self, name: str) -> Element | None:
        return next((e for e in self.elements if e.name == name), None)

    def _place(self, number: int) -> Place:
        """Return the place where an element begins; read those before it where necessary."""
        while len(self._places) <= number:
            element, place = self.elements[len(self._places) - 1], self._places[-1]
            size = element.row_bytes
            if element.properties and (self.layout == "text" or size is None):
                for _ in self._parsed(len(self._places) - 1, (), None, strips=False):
                    pass
            else:
                end = place.offset + element.rows * (size or 0)
                self._check_size(element, place.offset, end)
                self._places.append(Place(end, place.line))
        return self._places[number]

    def _check_counts(self, start: int) -> None:
        """Refuse counts that no such file has room for, before anything is made for them."""
        for element in self.elements:
            least = element.rows * element.least_bytes(self.layout)
            self._check_size(element, start, start + max(least - 1, 0))  # no blank at the end

    def _check_size(self, element: Element, start: int, end: int) -> None:
        size = self.source.most_text if self.layout == "text" else self.source.size
        if end > size:
            raise SceneError(
                f"{self.name}: byte {start}: found {max(size - start, 0)} bytes, "
                f"expected {end - start} or more for {element.rows} rows of {element.name}: "
                "the file is truncated or its count is wrong"
            )

    def columns(self, element: Element, names: Sequence[str]) -> Iterator[NDArray[Any]]:
        """Yield columns of an element, (n, len(names)), of the type that `dtype_of` tells."""
        number = self.elements.index(element)
        dtype = dtype_of(element, names)
        if self.layout == "text" or element.row_bytes is None:
            for _, _, values in self._parsed(number, names, None, strips=False):
                yield cast(values, dtype)
            return
        start = self._place(number).offset
        self._place(number + 1)  # all of it is there
        rows = self._row_dtype(element, names)
        most = max(1, min(ROWS_AT_ONCE, BLOCK_BYTES // rows.itemsize))
        self.source.seek(start)
        for block in self.source.blocks(rows, element.rows, most):
            out = np.empty((len(block), len(names)), dtype)
            for column, name in enumerate(names):
                out[:, column] = block[name]
            yield out

    def _row_dtype(self, element: Element, names: Sequence[str]) -> np.dtype[Any]:
        """Make the dtype of an element's rows without lists, with the fields that are wanted."""
        order = "<" if self.layout == "little" else ">"
        codes = [CODES[p.kind] for p in element.properties]
        ends = np.cumsum([int(code[1]) for code in codes]).tolist()
        place = {p.name: number for number, p in enumerate(element.properties)}
        wanted = [place[name] for name in dict.fromkeys(names)]
        return np.dtype(
            {
                "names": [element.properties[number].name for number in wanted],
                "formats": [order + codes[number] for number in wanted],
                "offsets": [ends[number] - int(codes[number][1]) for number in wanted],
                "itemsize": ends[-1],
            }
        )

    def faces(
        self, element: Element, names: Sequence[str]
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[Any]]]:
        """Yield the corners of faces or strips, their counts, and columns beside them."""
        strips = element.name == "tristrips"
        return self._parsed(self.elements.index(element), names, element.corners(), strips=strips)

    def _parsed(
        self, number: int, names: Sequence[str], wanted: Property | None, *, strips: bool
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.uint32], NDArray[Any]]]:
        """Parse an element's rows in order; note at the end where the next element begins."""
        element, place = self.elements[number], self._place(number)
        once = list(dict.fromkeys(names))  # a property may be wanted twice, z as color too
        places = [once.index(name) for name in names]
        columns = {element.find(name): column for column, name in enumerate(once)}
        rows = Rows(
            element.rows,
            [p.kind for p in element.properties],
            [p.counted for p in element.properties],
            [len(once) if p is wanted else columns.get(p, -1) for p in element.properties],
            len(once),
            self.layout,
            strips,
            place.line,
        )
        at = place.offset
        for chunk in self.source.text(at) if self.layout == "text" else self._binary(at):
            corners, counts, values, used = rows.parse(chunk)
            if rows.fault:
                raise self._fault(element, rows, at)
            at += used
            if len(corners) or len(counts):
                yield corners, counts, values if once == list(names) else values[:, places]
            if rows.done:
                break
            self._left = len(chunk) - used
        if not rows.done:
            raise SceneError(
                f"{self.name}: found the file's end in row {rows.row} of {element.name}, expected "
                f"{element.rows} rows: the file is truncated or its count is wrong"
            )
        if len(self._places) == number + 1:
            self._places.append(Place(at, rows.line))

    def _binary(self, at: int) -> Iterator[NDArray[np.uint8]]:
        """Yield chunks of bytes from a place on; the unused end of one begins the next."""
        self.source.seek(at)
        buffer = np.empty(8 + CHUNK_BYTES, np.uint8)
        left = 0
        while got := self.source.read_into(buffer.data[left : left + CHUNK_BYTES]):
            end = left + got
            self._left = 0
            yield buffer[:end]
            left = self._left
            buffer[:left] = buffer[end - left : end].copy()

    def check_end(self) -> None:
        """Warn of bytes or text behind the last element."""
        end = self._place(len(self.elements))
        left = self.source.size - end.offset
        if self.layout == "text":
            left = self.source.text_left(end.offset)
        if left:
            log.warning(
                "%s: %d bytes behind the last element were passed over: its counts may be wrong",
                self.name,
                left,
            )

    def _fault(self, element: Element, rows: Rows, at: int) -> SceneError:
        where = f"line {rows.line}: " if self.layout == "text" else ""
        row = f"row {rows.row} of {element.name}"
        found = shown(rows.token) if self.layout == "text" else f"{rows.found:.15g}"
        told = {
            Fault.BAD_NUMBER: f"found {found} in {row}, expected a number",
            Fault.NEGATIVE_COUNT: f"found {found} in {row}, expected a list's count, 0 or more",
            Fault.NO_INDEX: f"found {found} in {row}, expected a vertex's whole number",
            Fault.LONG_FACE: f"found {found} corners in {row}, expected {MOST_CORNERS} or fewer",
        }
        return SceneError(f"{self.name}: {where}{told[Fault(rows.fault)]}")

    def __enter__(self) -> Ply:
        return self

    def __exit__(self, *_: object) -> None:
        self.source.close()


def read_header(source: Source) -> tuple[str, list[Element], Place]:
    """Read the header: the layout, the elements, and the place where the first begins."""
    text = source.head(HEADER_BYTES)
    end_of_line = line_end(text)
    layout = ""
    elements: dict[str, Begun] = {}
    at, number = 0, 0
    while True:
        end = text.find(end_of_line, at)
        number += 1
        line = text[at : end if end >= 0 else len(text)]
        words = line.decode("ascii", "backslashreplace").split()
        where = f"{source.name}: line {number}: found {shown(line.rstrip())}, expected"
        if number == 1 and words != ["ply"]:
            raise SceneError(f"{where} ply")
        if end < 0:
            raise SceneError(f"{where} a header that end_header ends, of at most 1 MiB")
        at = end + 1
        if words == ["end_header"]:
            break
        if not words or words[0] in ("comment", "obj_info") or number == 1:
            continue
        if words[0] == "format":
            layout = _layout(words, layout, source, where)
        elif words[0] == "element":
            begun = elements.setdefault(*_element(words, elements, where))
        elif words[0] == "property" and elements:
            begun.properties[words[-1]] = _property(words, begun, where)
        else:
            raise SceneError(f"{where} format, element, property, comment or end_header")
    if not layout:
        raise SceneError(f"{source.name}: found a header without format, expected one")
    done = [Element(name, e.rows, tuple(e.properties.values())) for name, e in elements.items()]
    return layout, done, Place(at if layout == "text" else len(source.mark) + at, number + 1)


def line_end(text: bytes) -> bytes:
    """Return the end of the header's lines, judged by the first: CR, or LF, after a CR or not."""
    carriage, feed = text.find(b"\r"), text.find(b"\n")
    return b"\r" if carriage >= 0 and (feed < 0 or carriage + 1 < feed) else b"\n"


def _layout(words: list[str], before: str, source: Source, where: str) -> str:
    if len(words) != 3 or words[1] not in LAYOUTS or words[2] != "1.0" or before:
        raise SceneError(f"{where} one format, {' or '.join(LAYOUTS)}, and 1.0")
    layout = LAYOUTS[words[1]]
    if layout != "text" and not source.is_utf8:
        raise SceneError(f"{where} format ascii, as the file is UTF-16")
    return layout


class Begun(NamedTuple):
    """Collects an element's properties by their names while the header is read."""

    rows: int
    properties: dict[str, Property]


def _element(words: list[str], before: Container[str], where: str) -> tuple[str, Begun]:
    fits = len(words) == 3 and words[2].isascii() and words[2].isdigit() and len(words[2]) < 20
    if not fits or int(words[2]) >= 1 << INDEX_BITS:
        raise SceneError(f"{where} element, a name, and a count of 0 to 2^{INDEX_BITS}")
    if words[1] in before:
        raise SceneError(f"{where} each element once")
    return words[1], Begun(int(words[2]), {})


def _property(words: list[str], element: Begun, where: str) -> Property:
    listed = len(words) == 5 and words[1] == "list"
    if not listed and len(words) != 3:
        raise SceneError(f"{where} property, a type and a name, or list and two types and a name")
    kinds = words[2:4] if listed else words[1:2]
    for kind in kinds:
        if kind not in TYPES:
            raise SceneError(f"{where} types of {' '.join(TYPES)}")
    if listed and TYPES[kinds[0]] not in WHOLE:
        raise SceneError(f"{where} a list with a count of whole numbers")
    if words[-1] in element.properties:
        raise SceneError(f"{where} each property of an element once")
    if len(element.properties) == MOST_PROPERTIES:
        raise SceneError(f"{where} at most {MOST_PROPERTIES} properties of an element")
    return Property(words[-1], TYPES[kinds[-1]], TYPES[kinds[0]] if listed else -1)


class PlyMesh:
    """Reads a PLY file's faces: a `bfrt.formats.mesh.Mesh`."""

    def __init__(self, ply: Ply, vertex: Element, faces: list[Element], reading: Reading) -> None:
        self.ply = ply
        self.name = ply.name
        self.vertices = vertex.rows
        self._vertex = vertex
        self._faces = faces
        asked = painting(vertex, reading)
        self.painted = bool(asked)
        of_vertices = all(vertex.find(name) for name in asked)
        self._of_vertex = asked if of_vertices else ()
        self._of_face = () if of_vertices else painting(faces[0], reading)
        for element in faces if self._of_face else ():
            if element.name == "tristrips" or not all(element.find(n) for n in self._of_face):
                raise missing(ply, reading.columns, "vertex or face")
        self.columns = 3 + len(self._of_vertex)
        self.coordinates = dtype_of(vertex, POSITION)
        self.row = dtype_of(vertex, (*POSITION, *self._of_vertex))

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        scale = scale_of(self._vertex, self._of_vertex)
        for block in self.ply.columns(self._vertex, (*POSITION, *self._of_vertex)):
            block[:, 3:] /= scale
            yield block

    def face_blocks(self) -> Iterator[Faces]:
        for element in self._faces:
            scale = scale_of(element, self._of_face)
            for corners, counts, values in self.ply.faces(element, self._of_face):
                yield Faces(corners, counts, own(values / scale) if self._of_face else None)

    def numbers(self) -> Iterator[NDArray[Any]]:
        if self._of_vertex:
            return (block[:, 3] for block in self.vertex_blocks())
        return (faces.values for faces in self.face_blocks() if faces.values is not None)


class PlyPoints:
    """Reads a PLY file's vertices: a `bfrt.formats.points.Points`."""

    def __init__(self, ply: Ply, vertex: Element, reading: Reading) -> None:
        self.ply = ply
        self.name = ply.name
        self._vertex = vertex
        self._asked = painting(vertex, reading)
        self.painted = bool(self._asked)
        radius = reading.radius
        if radius is None and vertex.find("radius"):
            radius = "radius"
        self._radius = (radius,) if isinstance(radius, str) else ()
        for names in (self._radius, self._asked):
            if not all(vertex.find(name) for name in names):
                raise missing(ply, names, "vertex")

    def blocks(self) -> Iterator[PointBlock]:
        scale = scale_of(self._vertex, self._asked)
        dtype = dtype_of(self._vertex, POSITION)
        first = 3 + len(self._radius)
        for block in self.ply.columns(self._vertex, (*POSITION, *self._radius, *self._asked)):
            yield PointBlock(
                cast(block[:, :3], dtype),
                block[:, 3] if self._radius else None,
                own(block[:, first:] / scale) if self._asked else None,
            )

    def numbers(self) -> Iterator[NDArray[Any]]:
        return (block[:, 0] for block in self.ply.columns(self._vertex, self._asked))


def painting(element: Element, reading: Reading) -> tuple[str, ...]:
    """Return the names of the columns that colors are made from, in this element."""
    for names in COLOR_NAMES if reading.color_by == RGB else ():
        if all(element.find(name) for name in names):
            return names
    return reading.columns


def missing(ply: Ply, names: Sequence[str], where: str) -> SettingError:
    """Return an error about columns that are missing."""
    there = sorted({p.name for e in ply.elements for p in e.properties if p.counted < 0})
    return SettingError(
        f"{ply.name}: found no {' '.join(names)} of each {where}, expected one of {' '.join(there)}"
    )


def dtype_of(element: Element, names: Sequence[str]) -> np.dtype[Any]:
    """Return float32 if it holds the columns exactly, else float64."""
    kinds = [found.kind for name in names if (found := element.find(name))]
    return np.dtype("f4" if all(kind in NARROW for kind in kinds) else "f8")


def scale_of(element: Element, names: Sequence[str]) -> float:
    """Return the divisor that scales colors to 0 to 1; 1 for a plain number."""
    found = element.find(names[0]) if len(names) == len(COLORS) else None
    return 1.0 if found is None else FULL_COLOR.get(found.kind, 1.0)


def own(values: NDArray[Any]) -> NDArray[Any]:
    """Return columns in the form that objects are painted by: (n,) numbers, or (n, 3) colors."""
    return values[:, 0] if values.shape[1] == 1 else values


def read_ply(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read a PLY file: faces and strips as they are, or where it has none points as spheres.

    Raises
    ------
    SceneError, ShortReadError
        If it is no PLY, or is not as its header says.
    SettingError
        If a setting does not fit what the file has.
    StreamError
        If the system refuses to read it.
    """
    with Ply(path, report) as ply:
        vertex = ply.element("vertex")
        if vertex is None or not all(vertex.find(name) for name in POSITION):
            raise SceneError(f"{path}: found no vertex with x, y and z, expected it")
        faces = [e for e in ply.elements if e.name in ("face", "tristrips") and e.rows]
        for element in faces:
            if element.corners() is None:
                raise SceneError(
                    f"{path}: found {element.name} without a list vertex_indices, expected it"
                )
        writer = ObjectWriter(sink, path, reading)
        if faces:
            write_mesh(PlyMesh(ply, vertex, faces, reading), writer)
        else:
            reading.refuse_all_but(path, *POINTS)
            write_points(PlyPoints(ply, vertex, reading), writer)
        ply.check_end()
        writer.report()
