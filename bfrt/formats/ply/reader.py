"""The objects of a PLY file: its faces and strips, or where it has none its vertices as points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.casting import cast
from bfrt.formats.columns import POSITION
from bfrt.formats.mesh import Faces, write_mesh
from bfrt.formats.object_writer import ObjectWriter, SceneSink
from bfrt.formats.ply.element import Element
from bfrt.formats.ply.file import Ply
from bfrt.formats.ply.splats import Splats, are_splats, colored, refuse_packed
from bfrt.formats.points import PointBlock, write_points
from bfrt.formats.reading import COLORS, POINTS, RGB, Reading
from bfrt.formats.room import check_colors
from bfrt.formats.source import Report, printable

#: What full color is.
FULL_COLOR = {1: 255.0, 3: 65535.0}

NORMAL = ("nx", "ny", "nz")

#: Names that a file's own colors go by; of several the first counts.
COLOR_NAMES = (COLORS, ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


class PlyMesh:
    """Reads a PLY file's faces: a `bfrt.formats.mesh.Mesh`."""

    what = "vertex"
    normals = None

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
            if element.has_strips or not all(element.find(n) for n in self._of_face):
                raise missing(ply, reading.columns, "vertex or face")
        self.has_normals = all(vertex.find(name) for name in NORMAL)
        own = NORMAL if self.has_normals and reading.smooth else ()
        self._names = (*POSITION, *own, *self._of_vertex)
        self._first = 3 + len(own)
        self.columns = len(self._names)
        self.coordinates = vertex.dtype_of(POSITION)
        self.row = vertex.dtype_of(self._names)

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        scale = scale_of(self._vertex, self._of_vertex)
        for block in self.ply.columns(self._vertex, self._names):
            block[:, self._first :] /= scale
            yield block

    def face_blocks(self) -> Iterator[Faces]:
        for element in self._faces:
            scale = scale_of(element, self._of_face)
            for corners, counts, values in self.ply.faces(element, self._of_face):
                yield Faces(corners, counts, own(values / scale) if self._of_face else None)

    def numbers(self) -> Iterator[NDArray[Any]]:
        if self._of_vertex:
            return (block[:, self._first] for block in self.vertex_blocks())
        return (faces.values for faces in self.face_blocks() if faces.values is not None)


class PlyPoints:
    """Reads a PLY file's vertices: a `bfrt.formats.points.Points`."""

    def __init__(self, ply: Ply, vertex: Element, reading: Reading) -> None:
        self.ply = ply
        self.name = ply.name
        self._vertex = vertex
        self._asked = painting(vertex, reading)
        self.painted = bool(self._asked)
        radius = reading.radius_column
        if reading.radius is None and vertex.find("radius"):
            radius = "radius"
        self._radius = () if radius is None else (radius,)
        for names in (self._radius, self._asked):
            if not all(vertex.find(name) for name in names):
                raise missing(ply, names, "vertex")

    def blocks(self) -> Iterator[PointBlock]:
        scale = scale_of(self._vertex, self._asked)
        dtype = self._vertex.dtype_of(POSITION)
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
    listed = " ".join(map(printable, there))
    return SettingError(
        f"{ply.name}: found no {' '.join(names)} of each {where}, expected one of {listed}"
    )


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
        if vertex is not None:
            refuse_packed(path, vertex)
        if vertex is None or not all(vertex.find(name) for name in POSITION):
            raise SceneError(f"{path}: found no vertex with x, y and z, expected it")
        faces = [e for e in ply.elements if e.name in ("face", "tristrips") and e.rows]
        for element in faces:
            if element.corners() is None:
                raise SceneError(
                    f"{path}: found {element.shown} without a list vertex_indices, expected it"
                )
        writer = ObjectWriter(sink, path, reading)
        if faces:
            write_mesh(PlyMesh(ply, vertex, faces, reading), writer)
        elif are_splats(vertex):
            reading.refuse_all_but(path, "opacity", *POINTS)
            if reading.color_by is None:
                check_colors(path, ply.source.size, reading.room)
            writer = ObjectWriter(sink, path, colored(reading))
            write_points(Splats(ply, vertex, reading), writer)
        else:
            reading.refuse_all_but(path, *POINTS)
            write_points(PlyPoints(ply, vertex, reading), writer)
        ply.check_end()
        writer.report()
