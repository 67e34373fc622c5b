"""Reading NFF, Haines' Neutral File Format, in bounded memory.

::

    path, "-" or stream --> chunks of 1 MiB --> _nff.Parser --> events --> SceneSink

The text is a sequence of tokens; line ends matter to comments and error messages only. Text that
begins with the byte order mark of UTF-8 or UTF-16 is decoded on the way.

======  ====================================================  =================================
entity  numbers                                               becomes
======  ====================================================  =================================
``v``   from 3, at 3, up 3, angle 1, hither 1, resolution 2   the camera; fields in any order,
                                                              once, hither may be absent
``b``   red green blue                                        the background
``l``   x y z [red green blue]                                a light
``f``   red green blue kd ks shine t ior                      the material of what follows
``s``   center, radius                                        a sphere
``c``   base, its radius, apex, its radius                    a cone or cylinder
``p``   n, then n vertices                                    a triangle or a polygon
``pp``  n, then n vertices, each with its normal              a fan of n - 2 patches
======  ====================================================  =================================

Beyond the letter of the format: view and lights may follow objects; objects before any ``f`` get
the default ``Material``; a file without ``v`` has no camera; radii may be negative, those of a
cone both or none. Whether an object is degenerate is the sink's business.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Callable, Iterator
from typing import BinaryIO

from bfrt.errors import SceneError, StreamError
from bfrt.formats._nff import (
    MAX_RESOLUTION,
    MAX_TOKEN,
    Entity,
    Event,
    Fault,
    Parser,
)
from bfrt.formats.contents import Row, statements_of
from bfrt.formats.encoding import Decoder
from bfrt.formats.gzipped import is_packed
from bfrt.formats.object_writer import SceneSink
from bfrt.formats.room import check_corners
from bfrt.formats.source import CHUNK_BYTES, Source
from bfrt.formats.text import MOST_CORNERS
from bfrt.records import Kind
from bfrt.refusals import calling, closing, refused
from bfrt.store.model import Camera, Light, Material, Vector

BLOCK_OBJECTS = 16384

_XYZ = ("x", "y", "z")
_RGB = ("red", "green", "blue")
_VIEW = ("from", "at", "up", "angle", "hither", "resolution")
_KEYWORDS = "a keyword: v, b, l, f, c, s, p or pp"
_SHOWN_BYTES = 24

#: Entities that count, and what they become.
USES = {
    "v": "the camera", "b": "the background", "l": "lights", "f": "materials", "s": "spheres",
    "c": "cones", "p": "triangles and polygons", "pp": "patches",
}  # fmt: skip

#: Fills whose palette index is remembered here: a scene has few, and repeats them by the million.
_PAINTED = 256

# What the numbers of an entity are called, and the keyword that they belong to.
_FIELDS: dict[int, tuple[str, tuple[str, ...]]] = {
    Entity.VIEW_FROM: ("from", _XYZ),
    Entity.VIEW_AT: ("at", _XYZ),
    Entity.VIEW_UP: ("up", _XYZ),
    Entity.VIEW_ANGLE: ("angle", ("degrees",)),
    Entity.VIEW_HITHER: ("hither", ("distance",)),
    Entity.VIEW_RESOLUTION: ("resolution", ("width", "height")),
    Entity.BACKGROUND_COLOR: ("b", _RGB),
    Entity.LIGHT_POSITION: ("l", _XYZ),
    Entity.LIGHT_COLOR: ("l", (*_XYZ, *_RGB)),
    Entity.MATERIAL_COLOR: ("f", _RGB),
    Entity.MATERIAL_REST: ("f", (*_RGB, "Kd", "Ks", "shine", "T", "index of refraction")),
    Entity.SPHERE: ("s", ("center x", "center y", "center z", "radius")),
    Entity.CONE: (
        "c",
        (*(f"base {i}" for i in _XYZ), "base radius", *(f"apex {i}" for i in _XYZ), "apex radius"),
    ),
    Entity.POLYGON_COUNT: ("p", ("number of vertices",)),
    Entity.PATCH_COUNT: ("pp", ("number of vertices",)),
}
_CORNERS: dict[int, tuple[str, tuple[str, ...]]] = {
    Entity.TRIANGLE: ("p", _XYZ),
    Entity.POLYGON_VERTEX: ("p", _XYZ),
    Entity.PATCH_VERTEX: ("pp", (*_XYZ, *(f"normal {i}" for i in _XYZ))),
}


def read_nff(
    source: str | os.PathLike[str] | BinaryIO,
    writer: SceneSink,
    *,
    progress: Callable[[int], None] | None = None,
    room: int | None = None,
) -> None:
    """Read an NFF scene and hand it to `writer`, block by block.

    Memory does not grow with the file, but for a polygon's vertices, of which there may be
    1,048,576. Numbers are read as the nearest double.

    Parameters
    ----------
    source : str, path or binary stream
        The file; "-" is standard input. A stream is read from where it stands and left open.
    writer : SceneSink
        The receiver of the scene. It must copy the arrays that it keeps.
    progress : callable, optional
        Called after each chunk with the number of bytes consumed so far.
    room : int, optional
        Bytes that polygons of very many corners may take; by default any number.

    Raises
    ------
    BudgetError
        If a polygon takes more.
    SceneError
        If the text is not NFF. The message has file, line, what was found and expected.
    StreamError
        If the system refuses to open or read the file.
    """
    _read(source, writer, progress, CHUNK_BYTES, BLOCK_OBJECTS, room)


def _read(
    source: str | os.PathLike[str] | BinaryIO,
    writer: SceneSink,
    progress: Callable[[int], None] | None,
    chunk_bytes: int,
    block_objects: int,
    room: int | None = None,
) -> None:
    with contextlib.ExitStack() as stack:
        stream, name = _open(source, stack)
        reader = _Reader(name, writer, Parser(chunk_bytes, block_objects), room)
        decoder = Decoder(name)
        consumed = 0
        while chunk := _read_chunk(stream, name, chunk_bytes, consumed):
            for part in _parts(decoder.decode(chunk, final=False), chunk_bytes):
                reader.take_chunk(part)
            consumed += len(chunk)
            if progress is not None:
                progress(stream.done if isinstance(stream, Source) else consumed)
        for part in _parts(decoder.decode(b"", final=True), chunk_bytes):
            reader.take_chunk(part)
        reader.take_chunk(b"")


def _parts(text: bytes, size: int) -> Iterator[bytes]:
    """Cut a text into parts of `size` bytes at most, since decoding may have made it longer."""
    for start in range(0, len(text), size):
        yield text[start : start + size]  # bytes themselves, not a copy, where that is all


def _open(
    source: str | os.PathLike[str] | BinaryIO, stack: contextlib.ExitStack
) -> tuple[BinaryIO | Source, str]:
    """Open a source; return its stream and the name for messages."""
    if source == "-":
        if sys.stdin is None:
            raise StreamError("<stdin>", 0, errno.EBADF, "opening")
        return sys.stdin.buffer, "<stdin>"
    if not isinstance(source, (str, os.PathLike)):
        name = getattr(source, "name", None)
        return source, name if isinstance(name, str) else "<stream>"
    name = os.fspath(source)
    if is_packed(name):
        return stack.enter_context(Source(name)), name
    with calling(name, "opening"):
        # Without a buffer: chunks are large, and it would only copy them.
        file = io.FileIO(name)
    return stack.enter_context(closing(file, name)), name


def _read_chunk(stream: BinaryIO | Source, name: str, size: int, offset: int) -> bytes:
    try:
        chunk = stream.read(size)
    except OSError as error:
        raise refused(name, offset, error, "reading") from error
    if chunk is None:  # a stream that does not block says so
        raise StreamError(name, offset, errno.EAGAIN, "reading")
    if not isinstance(chunk, bytes):
        raise TypeError(f"{name}: found a stream of {type(chunk).__name__}, expected bytes")
    return chunk


class _Reader:
    """Turns a parser's events into calls on a sink."""

    def __init__(self, name: str, sink: SceneSink, parser: Parser, room: int | None) -> None:
        self.name = name
        self.sink = sink
        self.parser = parser
        self.room = room
        self.has_background = False
        self.painted: dict[tuple[float, ...], int] = {}
        self.handlers: dict[int, Callable[[], None]] = {
            Event.CAMERA: self.take_camera,
            Event.LIGHT: self.take_light,
            Event.BACKGROUND: self.take_background,
            Event.MATERIAL: self.take_material,
            Event.UNPAINTED: self.use_default_material,
            Event.BLOCK_FULL: self.take_block,
            Event.FAULT: self.fail,
            Event.DONE: self.finish,
        }

    def take_chunk(self, chunk: bytes) -> None:
        """Parse a chunk; an empty one ends the text."""
        self.parser.feed(chunk)
        event = None
        while event != Event.DONE:
            event = self.parser.advance()
            if event == Event.HUNGRY:
                return
            self.handlers[event]()

    def take_camera(self) -> None:
        v = self.parser.view
        hither = v[10] if self.parser.seen >> Entity.VIEW_HITHER & 1 else Camera.hither
        resolution = int(v[11]), int(v[12])
        try:
            camera = Camera(_vector(v), _vector(v[3:]), _vector(v[6:]), v[9], hither, resolution)
        except SceneError as error:
            raise SceneError(f"{self.name}: line {self.parser.view_line}: {error}") from error
        self.sink.camera(camera)

    def take_light(self) -> None:
        v = self.parser.values
        if len(v) == 3:
            self.sink.light(Light(_vector(v)))
        else:
            self.sink.light(Light(_vector(v), _vector(v[3:])))

    def take_background(self) -> None:
        self.has_background = True
        self.sink.background(_vector(self.parser.values))

    def take_material(self) -> None:
        v = self.parser.values
        index = self.painted.get(v)
        if index is None:
            index = self.sink.material(Material(_vector(v), *v[3:]))
            if len(self.painted) < _PAINTED:
                self.painted[v] = index
        self.parser.paint_with(index)

    def use_default_material(self) -> None:
        self.parser.paint_with(self.sink.material(Material()))

    def take_block(self) -> None:
        self.flush(Kind(self.parser.kind))

    def flush(self, kind: Kind) -> None:
        if kind is Kind.POLYGON:
            vertices, counts, materials = self.parser.take_polygons()
            if len(counts):
                if self.room is not None:
                    check_corners(self.name, int(counts.max()), self.room)
                self.sink.append_polygons(vertices.copy(), counts.copy(), materials.copy())
            return
        records, materials = self.parser.take(kind)
        if len(records):
            self.sink.append(kind, records.copy(), materials.copy())

    def finish(self) -> None:
        for kind in Kind:
            self.flush(kind)
        if not self.has_background:
            self.sink.background((0.0, 0.0, 0.0))

    def fail(self) -> None:
        parser = self.parser
        raise SceneError(
            f"{self.name}: line {parser.line}: found {_found(parser)}, expected {_expected(parser)}"
        )


def _vector(values: tuple[float, ...]) -> Vector:
    return values[0], values[1], values[2]


def _found(parser: Parser) -> str:
    """Describe what a fault found, on one line for any bytes."""
    token = parser.token
    if not token:
        return "end of file"
    shown = token[:_SHOWN_BYTES]
    dots = "..." if len(token) > _SHOWN_BYTES else ""
    if parser.fault == Fault.BINARY:
        return f"bytes that are not ASCII text, {shown!r}{dots}"
    text = repr(shown.decode("ascii")) + dots
    if parser.fault == Fault.TOO_LONG:
        return f"a token of more than {MAX_TOKEN} bytes, {text}"
    if parser.fault in (Fault.SECOND_VIEW, Fault.SECOND_FIELD):
        return f"a second {text}"
    return text


def _expected(parser: Parser) -> str:
    fault = parser.fault
    if fault == Fault.SECOND_VIEW:
        return "one view in a file"
    if fault == Fault.SECOND_FIELD:
        return "each field of v once"
    if fault == Fault.MISSING_FIELD:
        missing = [
            name
            for bit, name in enumerate(_VIEW)
            if bit != Entity.VIEW_HITHER and not parser.seen >> bit & 1
        ]
        return f"{' and '.join(missing)} of v"
    if fault == Fault.MIXED_RADII:
        return "radii of c that are both negative or both not"
    if not parser.awaits_number:
        return _KEYWORDS
    return f"the {_field(parser)}{_qualification(parser)}"


def _field(parser: Parser) -> str:
    """Name the number that comes next."""
    if parser.entity in _FIELDS:
        keyword, names = _FIELDS[parser.entity]
        return f"{names[parser.have]} of {keyword}"
    keyword, names = _CORNERS[parser.entity]
    corner, place = divmod(parser.have, len(names))
    return f"{names[place]} of vertex {parser.vertex + corner + 1} of {keyword}"


def _qualification(parser: Parser) -> str:
    if parser.fault in (Fault.NOT_A_NUMBER, Fault.NOT_FINITE):
        return ", a finite number"
    if parser.fault == Fault.NEGATIVE:
        return ", 0 or more"
    if parser.fault == Fault.NOT_AN_INTEGER:
        low, high = (
            (1, MAX_RESOLUTION) if parser.entity == Entity.VIEW_RESOLUTION else (3, MOST_CORNERS)
        )
        return f", an integer from {low} to {high}"
    return ""


def contents_of_nff(path: str) -> list[Row]:
    """Count the entities that begin an NFF file; else as `statements_of`."""
    return statements_of(path, USES)
