"""OBJ: vertices, faces of any number of corners, and the colors of their materials.

Vertices are read first, in one pass over the text, then faces in another; numbers are float64, for
the text has no types. Normals, where they are asked for, are read alike, in passes of their own.
Texture coordinates, lines and curves are passed over. A file of vertices alone has points.
"""

from __future__ import annotations

import errno
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError, StreamError
from bfrt.formats._obj import Fault, Lines, Statement
from bfrt.formats.contents import FACES, NORMALS, VERTICES, Row, statements_of
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.mtl import read_mtl
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.points import PointBlock, write_points
from bfrt.formats.reading import AUTO, POINTS, RGB, Reading
from bfrt.formats.source import Report, Source, quoted
from bfrt.formats.text import MOST_CORNERS
from bfrt.paths import is_file
from bfrt.store.model import Material

log = logging.getLogger(__name__)

WORDS = {
    Fault.NO_NUMBER: "found {}, expected a number",
    Fault.FEW_NUMBERS: "found the line's end, expected three numbers of a vertex",
    Fault.NO_INDEX: "found {}, expected a vertex's number, as 7, -1, 7/1, 7//2 or 7/1/2",
    Fault.NO_VERTEX: "found vertex {}, expected one from 1, or from -1 back to the first",
    Fault.FEW_CORNERS: "found the line's end, expected three corners or more",
    Fault.MANY_CORNERS: f"found more than {MOST_CORNERS} corners, expected fewer",
    Fault.BINARY: "found {} and a NUL byte in the line, expected text",
    Fault.FAR_VERTEX: "found vertex {}, expected one of the file's",
    Fault.NO_NORMAL: "found {}, expected a normal's number from 1, or from -1 back to the first",
}

#: Statements that count, and what they become.
USES = {"v": VERTICES, "vn": NORMALS, "f": FACES, "usemtl": "materials"}

#: Blanks that part names of libraries; one that belongs to a name has a backslash before it.
PARTING = re.compile(r"(?<!\\)\s+")


class ObjVertices:
    """Reads the vertices of an OBJ file; a first pass finds out what the file contains.

    Attributes
    ----------
    count : int
    columns : int
        Numbers of each: three, and three of its color where that is wanted.
    has_faces : bool
    normals : int
        How many there are.
    """

    def __init__(self, source: Source, reading: Reading) -> None:
        self.name = source.name
        self.columns = 6 if reading.color_by == RGB else 3
        self._source = source
        self._keeping = reading.room // 2
        self._kept: list[NDArray[Any]] | None = []
        lines = Lines(of_faces=False)
        for block in self._parsed(lines):
            self._keep(block)
        self.count, self.has_faces = lines.vertices, lines.faces > 0
        self.normals = lines.normals
        self._check(lines)

    def _keep(self, block: NDArray[Any]) -> None:
        """Keep a block, if there are few."""
        self._keeping -= block.nbytes
        if self._keeping < 0:
            self._kept = None
        elif self._kept is not None:
            self._kept.append(block)

    def _check(self, lines: Lines) -> None:
        """Refuse a file that is no OBJ, has nothing to draw, or lacks the colors asked for."""
        known = lines.vertices + lines.faces + lines.passed
        if lines.unknown > known:
            number, word = lines.stranger
            raise SceneError(
                f"{self.name}: line {number}: found {quoted(word)}, expected v, f or another "
                f"statement of OBJ, as in {known} of {known + lines.unknown} lines only"
            )
        if known and not lines.vertices and not lines.faces:
            raise SceneError(f"{self.name}: found no v and no f, expected vertices and faces")
        if lines.strokes and not lines.faces:
            raise SceneError(
                f"{self.name}: found lines (l) without a face (f), expected faces, or vertices "
                "alone, which are points"
            )
        if lines.unknown:
            log.warning(
                "%s: %d lines of unknown statements were passed over", self.name, lines.unknown
            )
        if self.columns > 3 and lines.colored < lines.vertices:
            raise SettingError(
                f"{self.name}: found {lines.colored} colors for {lines.vertices} vertices, "
                "expected one for each to color by"
            )

    def blocks(self) -> Iterator[NDArray[Any]]:
        """Yield all vertices, (n, columns) at a time."""
        return self._parsed(Lines(of_faces=False)) if self._kept is None else iter(self._kept)

    def _parsed(self, lines: Lines) -> Iterator[NDArray[Any]]:
        for chunk in self._source.text(lines=True):
            vertices = lines.parse(chunk)[0]
            refuse_fault(lines, self.name)
            yield vertices[:, : self.columns].copy()


def refuse_fault(lines: Lines, name: str) -> None:
    """Raise the fault that the parser found."""
    if lines.fault:
        told = WORDS[Fault(lines.fault)].format(quoted(lines.token))
        raise SceneError(f"{name}: line {lines.line}: {told}")


class ObjPoints:
    """Reads the vertices of an OBJ file without faces: a `bfrt.formats.points.Points`."""

    def __init__(self, vertices: ObjVertices) -> None:
        self.name = vertices.name
        self.painted = vertices.columns > 3
        self._vertices = vertices

    def blocks(self) -> Iterator[PointBlock]:
        for block in self._vertices.blocks():
            yield PointBlock(block[:, :3], None, block[:, 3:] if self.painted else None)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return iter(())  # colors are all there is, and need no range


class ObjNormals:
    """Reads the normals of an OBJ file's corners: a `bfrt.formats.mesh.Mesh`.

    The first is of all zeros, and that of corners without a normal.
    """

    row = coordinates = np.dtype("f8")
    what = "normal"
    columns = 3
    painted = has_normals = False
    normals = None

    def __init__(self, source: Source, count: int, fewest: int) -> None:
        """Read from a source of its own, for vertices are read in between."""
        self.name = source.name
        self.vertices = 1 + count
        self._source = source
        self._fewest = fewest

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        yield np.zeros((1, 3))
        lines = Lines(of_faces=False, of_normals=True)
        for chunk in self._source.text(lines=True):
            normals = lines.parse(chunk)[0]
            refuse_fault(lines, self.name)
            yield normals[:, :3].copy()

    def face_blocks(self) -> Iterator[Faces]:
        lines = Lines(of_faces=True, fewest=self._fewest, of_normals=True)
        for chunk in self._source.text(lines=True):
            _, numbers, counts, _ = lines.parse(chunk)
            refuse_fault(lines, self.name)
            yield Faces(numbers, counts)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return iter(())


class ObjMesh:
    """Reads an OBJ file as a mesh: a `bfrt.formats.mesh.Mesh`."""

    row = coordinates = np.dtype("f8")
    what = "vertex"

    def __init__(
        self, vertices: ObjVertices, source: Source, sink: SceneSink, reading: Reading
    ) -> None:
        self.name = source.name
        self.vertices = vertices.count
        self.columns = vertices.columns
        self.painted = vertices.columns > 3
        self.vertex_blocks = vertices.blocks
        self.has_normals = vertices.normals > 0
        self._source = source
        self._sink = sink
        self._fewest = fewest_of(reading)
        self.normals: ObjNormals | None = None
        self._materials: dict[bytes, int] = {}
        self._unknown: set[bytes] = set()
        self._missing: set[str] = set()

    def face_blocks(self) -> Iterator[Faces]:
        lines = Lines(of_faces=True, fewest=self._fewest)
        plain = material = self._sink.material(Material())
        for chunk in self._source.text(lines=True):
            _, corners, counts, statements = lines.parse(chunk)
            refuse_fault(lines, self.name)
            materials = np.empty(len(counts), np.uint32)
            done = 0
            for before, kind, text in statements:
                materials[done:before] = material
                done = before
                if kind == Statement.LIBRARY:
                    self._open_library(text)
                else:
                    material = self._material(text, plain)
            materials[done:] = material
            yield Faces(corners, counts, None, materials)

    def _material(self, name: bytes, plain: int) -> int:
        """Return the index of a material by its name; plain if it has no name or is unknown."""
        if name and name not in self._materials and name not in self._unknown:
            self._unknown.add(name)
            log.warning(
                "%s: material %s is in no library that was found, and is plain",
                self.name,
                quoted(name),
            )
        return self._materials.get(name, plain)

    def _open_library(self, text: bytes) -> None:
        """Read one library, whose name may have blanks, or several that blanks part."""
        folder = Path(self.name).parent
        whole = text.decode("utf-8", "surrogateescape")
        bare = unescaped(whole)
        names = [name for name in (whole, bare) if is_library(folder / name)][:1]
        names = names or [unescaped(name) for name in PARTING.split(whole) if name]
        missing = [name for name in names if not is_library(folder / name)]
        for name in [bare] if len(missing) == len(names) > 0 else missing:
            if name not in self._missing:
                self._missing.add(name)
                told = quoted(name.encode("utf-8", "surrogateescape"))
                log.warning("%s: found no library %s", self.name, told)
        for name in names:
            if name not in missing:
                for key, material in read_mtl(folder / name).items():
                    self._materials[key] = self._sink.material(material)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return iter(())  # colors are all there is, and need no range


def fewest_of(reading: Reading) -> int:
    """Return the corners that a face has at the least; the writer drops those of fewer."""
    return 0 if reading.skip_invalid else 3


def unescaped(name: str) -> str:
    """Return a name without the backslashes before its blanks."""
    return name.replace("\\ ", " ")


def is_library(path: Path) -> bool:
    """Tell whether a path is a file; a name that no file can have is none.

    Raises
    ------
    StreamError
        If the system refuses to say it: then there may be one.
    """
    if "\0" in str(path):
        return False
    try:
        return is_file(path)
    except StreamError as error:
        if error.errno == errno.ENAMETOOLONG:
            return False
        raise


def read_obj(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an OBJ file: faces, or where it has none its vertices as spheres.

    Raises
    ------
    SceneError
        If it is no OBJ, a line is not what it should be, or a face names a vertex that is not
        there.
    SettingError
        If a setting has no meaning here.
    StreamError
        If the system refuses to read it.
    """
    with Source(path, report) as source:
        if reading.color_by not in (None, RGB) and reading.uses.files == 1:
            raise SettingError(f"{path}: found color_by={reading.color_by!r}, expected {RGB}")
        writer = ObjectWriter(sink, path, reading)
        vertices = ObjVertices(source, reading)
        if vertices.count and not vertices.has_faces:
            reading.refuse_all_but(path, *POINTS)
            if isinstance(reading.radius, str) and reading.radius != AUTO:
                raise SettingError(
                    f"{path}: found radius={reading.radius!r}, expected a number or {AUTO}"
                )
            write_points(ObjPoints(vertices), writer)
        else:
            mesh = ObjMesh(vertices, source, sink, reading)
            with Source(path) as again:
                mesh.normals = ObjNormals(again, vertices.normals, fewest_of(reading))
                write_mesh(mesh, writer)
        writer.report()


def contents_of_obj(path: str) -> list[Row]:
    """Count the statements that begin an OBJ file; else as `statements_of`."""
    return statements_of(path, USES)
