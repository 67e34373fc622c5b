"""OBJ: vertices, faces of any number of corners, and the colors of their materials.

Vertices are read first, in one pass over the text, then faces in another; numbers are float64, for
the text has no types. Texture coordinates, normals, lines and curves are passed over.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats._obj import MOST_CORNERS, Fault, Lines, Statement
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.mtl import read_mtl
from bfrt.formats.outlet import Outlet, SceneSink
from bfrt.formats.reading import RGB, Reading
from bfrt.formats.source import Report, Source, shown
from bfrt.scene.model import Material

log = logging.getLogger(__name__)

WORDS = {
    Fault.NO_NUMBER: "found {}, expected a number",
    Fault.FEW_NUMBERS: "found the line's end, expected three numbers of a vertex",
    Fault.NO_INDEX: "found {}, expected a vertex's number, as 7, -1, 7/1, 7//2 or 7/1/2",
    Fault.NO_VERTEX: "found vertex {}, expected one from 1, or from -1 back to the first",
    Fault.FEW_CORNERS: "found the line's end, expected three corners or more",
    Fault.MANY_CORNERS: f"found more than {MOST_CORNERS} corners, expected fewer",
}


class ObjMesh:
    """An OBJ file as a mesh: `bfrt.formats.mesh.Mesh`."""

    row = coordinates = np.dtype("f8")

    def __init__(self, source: Source, sink: SceneSink, reading: Reading) -> None:
        self.name = source.name
        self.painted = reading.color_by == RGB
        self.columns = 6 if self.painted else 3
        self._source = source
        self._sink = sink
        self._keeping = reading.room // 2
        self._vertices: list[NDArray[Any]] | None = []
        self._materials: dict[bytes, int] = {}
        self._unknown: set[bytes] = set()
        self._missing: set[str] = set()
        self._warned = False
        self.vertices = sum(len(block) for block in self._counted())

    def _counted(self) -> Iterator[NDArray[Any]]:
        """A first pass over the vertices, which are kept if they are few."""
        lines, held = Lines(of_faces=False), 0
        for block in self._parsed_vertices(lines):
            yield block
            held += block.nbytes
            if held > self._keeping:
                self._vertices = None
            elif self._vertices is not None:
                self._vertices.append(block)
        if self.painted and lines.colored < lines.vertices:
            raise SettingError(
                f"{self.name}: found {lines.colored} colors for {lines.vertices} vertices, "
                "expected one for each to color by"
            )

    def _parsed_vertices(self, lines: Lines) -> Iterator[NDArray[Any]]:
        for chunk in self._chunks():
            vertices = lines.parse(chunk)[0]
            self._check(lines)
            yield vertices[:, : self.columns].copy()

    def _chunks(self) -> Iterator[NDArray[np.uint8]]:
        self._source.seek(0)
        return self._source.text(lines=True)

    def _check(self, lines: Lines) -> None:
        if lines.fault:
            told = WORDS[Fault(lines.fault)].format(shown(lines.token))
            raise SceneError(f"{self.name}: line {lines.line}: {told}")

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        if self._vertices is not None:
            return iter(self._vertices)
        return self._parsed_vertices(Lines(of_faces=False))

    def face_blocks(self) -> Iterator[Faces]:
        lines = Lines(of_faces=True)
        plain = material = self._sink.material(Material())
        for chunk in self._chunks():
            _, corners, counts, statements = lines.parse(chunk)
            self._check(lines)
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
        if lines.unknown and not self._warned:  # faces may be read twice
            self._warned = True
            log.warning(
                "%s: %d lines of unknown statements were passed over", self.name, lines.unknown
            )

    def _material(self, name: bytes, plain: int) -> int:
        if name not in self._materials and name not in self._unknown:
            self._unknown.add(name)
            log.warning(
                "%s: material %s is in no library that was found, and is plain",
                self.name,
                shown(name),
            )
        return self._materials.get(name, plain)

    def _open_library(self, text: bytes) -> None:
        """Read one library, whose name may have blanks, or several that blanks part."""
        folder = Path(self.name).parent
        whole = text.decode("utf-8", "surrogateescape")
        names = [whole] if is_file(folder / whole) else whole.split()
        missing = [name for name in names if not is_file(folder / name)]
        for name in [whole] if len(missing) == len(names) > 0 else missing:
            if name not in self._missing:
                self._missing.add(name)
                told = shown(name.encode("utf-8", "surrogateescape"))
                log.warning("%s: found no library %s", self.name, told)
        for name in names:
            if name not in missing:
                for key, material in read_mtl(folder / name).items():
                    self._materials[key] = self._sink.material(material)

    def numbers(self) -> Iterator[NDArray[Any]]:
        return iter(())  # colors are all there is, and need no range


def is_file(path: Path) -> bool:
    """Whether there is a file; a name that cannot be one has none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def read_obj(path: str, sink: SceneSink, reading: Reading, report: Report | None = None) -> None:
    """Read an OBJ file.

    Raises
    ------
    SceneError
        If a line is not what it should be, or a face names a vertex that is not there.
    SettingError
        If a setting has no meaning here.
    StreamError
        If the system refuses to read it.
    """
    with Source(path, report) as source:
        if reading.color_by not in (None, RGB) and reading.uses.files == 1:
            raise SettingError(f"{path}: found color_by={reading.color_by!r}, expected {RGB}")
        outlet = Outlet(sink, path, reading)
        write_mesh(ObjMesh(source, sink, reading), outlet)
        outlet.report()
