"""Indexed meshes: faces that name vertices, joined in bounded memory by passes that go forward.

Vertices that fit in memory are held there, and a face's are looked up. Where they do not fit they
are cut into windows that do, and the join takes three passes::

    faces     -> for each window a queue of the places in it that a block of faces needs
    vertices  -> for each window, held in memory: its queue of places becomes one of vertices
    faces     -> each block takes the next vertices from the windows' queues

A block's vertices are fetched once each, in their order, however many corners share one. What
comes next in a queue is known from the faces alone, so that only 4 bytes and a vertex are written
for each, and read once, forwards.
"""

from __future__ import annotations

import logging
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import BudgetError, SceneError
from bfrt.formats.casting import cast
from bfrt.formats.object_writer import ObjectWriter
from bfrt.formats.reading import PAINTED, Reading
from bfrt.formats.room import check_corners
from bfrt.memory import format_memory
from bfrt.streams.spool import Spool

log = logging.getLogger(__name__)

#: Columns of a vertex that are its normal, where normals are asked for.
NORMAL = slice(3, 6)

#: Vertices of a queue that are looked up at once.
LOOKUPS_AT_ONCE = 1 << 17

#: Corners of faces that are made objects at once.
CORNERS = 1 << 17

#: A block's vertices are looked up in a table where it has at most so many entries a corner.
SPREAD = 4

#: Windows of vertices, at the most: each has two files.
WINDOWS = 256

PLACE = np.dtype([("place", "<u4")])


class Faces(NamedTuple):
    """Holds some faces of a mesh.

    Attributes
    ----------
    indices : (m,) int64
        The vertices of all, one face after the other.
    counts : (n,) uint32
        Number of corners of each face.
    values : (n,) or (n, 3) ndarray, optional
        The number or the color that paints each face.
    materials : (n,) uint32, optional
    """

    indices: NDArray[np.int64]
    counts: NDArray[np.uint32]
    values: NDArray[Any] | None = None
    materials: NDArray[np.uint32] | None = None


class Mesh(Protocol):
    """Provides the vertices and faces of a mesh, which can be read again and again.

    Attributes
    ----------
    name : str
        Name of the file, for errors.
    what : str
        What faces name: vertices or normals, one of them, for errors.
    vertices : int
        Number of vertices.
    row : numpy.dtype
        The type of the numbers of a vertex.
    coordinates : numpy.dtype
        The type of its position in the file.
    columns : int
        Numbers of a vertex: three, and what it is painted by.
    painted : bool
        Whether vertices or faces have numbers or colors to be painted by.
    has_normals : bool
        Whether corners may have normals. Where they are asked for, those of vertices are three
        numbers behind their positions.
    normals : Mesh or None
        The same faces, whose corners are normals, in place of that; of all zeros if it has none.
    """

    name: str
    what: str
    vertices: int
    row: np.dtype[Any]
    coordinates: np.dtype[Any]
    columns: int
    painted: bool
    has_normals: bool

    @property
    def normals(self) -> Mesh | None: ...

    def vertex_blocks(self) -> Iterator[NDArray[Any]]:
        """Yield all vertices, (n, columns) at a time."""
        ...

    def face_blocks(self) -> Iterator[Faces]:
        """Yield all faces, block by block."""
        ...

    def numbers(self) -> Iterator[NDArray[Any]]:
        """Yield the numbers from which a color map takes its range."""
        ...


def write_mesh(mesh: Mesh, writer: ObjectWriter) -> None:
    """Write all faces, painted by their own numbers or by the mean of their vertices'."""
    reading = writer.reading
    unpainted = reading.color_by is not None and not mesh.painted
    painted = ("skip_invalid",) if unpainted else PAINTED
    smooth = ("smooth",) if mesh.has_normals else ()
    reading.refuse_all_but(mesh.name, *painted, *smooth, "triangulate", "polygons")
    if mesh.has_normals and not reading.smooth:
        told = "%s: normals are there and not used: smooth=True (--smooth) shades by them"
        log.info(told, mesh.name)
    if mesh.painted:
        writer.paint_by(mesh.numbers)
    for corners, normals, faces in with_normals(mesh, reading):
        values = faces.values
        if values is None and mesh.painted:
            values = means(corners[:, 3:], faces.counts)
        positions = cast(corners[:, :3], mesh.coordinates)
        writer.faces(positions, faces.counts, values, faces.materials, normals)


def with_normals(
    mesh: Mesh, reading: Reading
) -> Iterator[tuple[NDArray[Any], NDArray[Any] | None, Faces]]:
    """Yield faces with their corners, normals apart, or None where they are not asked for."""
    room, scratch = reading.room, reading.scratch
    if not (reading.smooth and mesh.has_normals):
        for corners, faces in joined(mesh, room, scratch):
            yield corners, None, faces
    elif mesh.normals is None:
        for corners, faces in joined(mesh, room, scratch):
            yield np.delete(corners, NORMAL, axis=1), corners[:, NORMAL], faces
    else:
        both = joined(mesh, room // 2, scratch), joined(mesh.normals, room // 2, scratch)
        with closing(both[0]), closing(both[1]):
            for (corners, faces), (normals, _) in zip(*both, strict=True):
                yield corners, normals, faces


def means(values: NDArray[Any], counts: NDArray[np.uint32]) -> NDArray[Any]:
    """Compute the mean of each face's corner values, (n,) or (n, 3)."""
    face = np.repeat(np.arange(len(counts)), counts)
    sums = [np.bincount(face, column, len(counts)) for column in values.T]
    mean: NDArray[Any] = np.stack(sums, axis=-1) / np.maximum(counts, 1)[:, None]
    return mean[:, 0] if mean.shape[1] == 1 else mean


def joined(mesh: Mesh, room: int, scratch: Path) -> Generator[tuple[NDArray[Any], Faces]]:
    """Yield the faces of a mesh with the vertices of their corners, (m, columns).

    Parameters
    ----------
    mesh : Mesh
    room : int
        Bytes that vertices may take.
    scratch : Path
        Folder for the queues where they take more: 4 bytes and a vertex for each corner.

    Raises
    ------
    BudgetError
        If so many vertices need more, which the message tells.
    SceneError
        If an index is out of range.
    DiskFullError, StreamError
        As the system refuses.
    """
    size = mesh.columns * mesh.row.itemsize
    most = room // size
    left = room - min(mesh.vertices, most) * size
    if mesh.vertices <= most:
        return joined_in_memory(mesh, left)
    if mesh.vertices > WINDOWS * most:
        short = -(-mesh.vertices // WINDOWS) * size - room
        raise BudgetError(
            f"{mesh.name}: found {mesh.vertices} vertices, expected a budget of "
            f"{format_memory(short)} more to join them with faces"
        )
    return joined_on_disk(mesh, most, left, scratch)


def joined_in_memory(mesh: Mesh, left: int) -> Generator[tuple[NDArray[Any], Faces]]:
    """Join with all vertices in memory: two passes, each over a part of the file."""
    (vertices,) = windows(mesh, max(mesh.vertices, 1))
    for faces in checked(mesh, left):
        yield vertices.take(faces.indices, axis=0), faces


def joined_on_disk(
    mesh: Mesh, most: int, left: int, scratch: Path
) -> Generator[tuple[NDArray[Any], Faces]]:
    """Join with `most` vertices in memory at a time."""
    row = np.dtype([("row", mesh.row, (mesh.columns,))])
    places: list[Spool] = []
    found: list[Spool] = []
    try:
        for _ in range(-(-mesh.vertices // most)):
            places.append(Spool(PLACE, 0, scratch))
            found.append(Spool(row, 0, scratch))
        for faces in checked(mesh, left):
            needed, _ = once_each(faces.indices)
            for window, part in by_window(needed, most):
                place = (needed[part] - window * most).astype(np.uint32)
                places[window].append(place.view(PLACE))
        for window, vertices in enumerate(windows(mesh, most)):
            while count := len(block := places[window].read(LOOKUPS_AT_ONCE)):
                corners = vertices.take(block["place"], axis=0)
                found[window].append(corners.view(row).reshape(count))
            places[window].close()
        for faces in checked(mesh, left):
            needed, where = once_each(faces.indices)
            vertices = np.empty((len(needed), mesh.columns), mesh.row)
            for window, part in by_window(needed, most):
                count = part.stop - part.start
                vertices[part] = expect(found[window].read(count), count, mesh)["row"]
            yield vertices.take(where, axis=0), faces
        for spool in found:
            expect(spool.read(1), 0, mesh)
    finally:
        for spool in (*places, *found):
            spool.close()


def expect(records: NDArray[Any], count: int, mesh: Mesh) -> NDArray[Any]:
    """Return the records if their count is that of the pass before, else raise `SceneError`."""
    if len(records) != count:
        raise SceneError(f"{mesh.name}: found other faces than before, expected a file at rest")
    return records


def checked(mesh: Mesh, left: int) -> Iterator[Faces]:
    """Yield the faces of a mesh, up to `CORNERS` corners at a time, with their indices checked.

    One that has more is refused where `left`, the bytes that vertices leave, do not hold it.
    """
    before = 0
    for faces in parts(mesh.face_blocks()):
        indices = faces.indices
        check_corners(mesh.name, len(indices), left)
        if len(indices) and not 0 <= indices.min() <= indices.max() < mesh.vertices:
            bad = int(np.argmax((indices < 0) | (indices >= mesh.vertices)))
            face = before + int(np.searchsorted(np.cumsum(faces.counts), bad, "right"))
            raise SceneError(
                f"{mesh.name}: face {face}: found {mesh.what} {indices[bad]}, "
                + (f"expected 0 to {mesh.vertices - 1}" if mesh.vertices else "expected none")
            )
        before += len(faces.counts)
        yield faces


def parts(blocks: Iterable[Faces]) -> Iterator[Faces]:
    """Cut blocks of faces up so that each has `CORNERS` corners at most, or is a single face."""
    for faces in blocks:
        ends = np.cumsum(faces.counts, dtype=np.int64)
        first = start = 0
        while first < len(ends):
            last = max(int(np.searchsorted(ends, start + CORNERS, "right")), first + 1)
            end = int(ends[last - 1])
            yield Faces(
                faces.indices[start:end],
                faces.counts[first:last],
                None if faces.values is None else faces.values[first:last],
                None if faces.materials is None else faces.materials[first:last],
            )
            first, start = last, end


def once_each(indices: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct vertices of corners, ascending, and each corner's place among them."""
    if not len(indices):
        return indices, indices
    lo, hi = int(indices.min()), int(indices.max())
    if hi - lo >= SPREAD * len(indices):
        return np.unique(indices, return_inverse=True)
    there = np.zeros(hi - lo + 1, np.bool_)
    there[indices - lo] = True
    place = np.cumsum(there) - 1
    return lo + np.flatnonzero(there), place[indices - lo]


def by_window(vertices: NDArray[np.int64], most: int) -> Iterator[tuple[int, slice]]:
    """Yield the windows that contain ascending vertices, each with the vertices' slice in it."""
    if len(vertices):
        windows = np.arange(vertices[0] // most, vertices[-1] // most + 1)
        ends = np.searchsorted(vertices, (windows + 1) * most)
        starts = [0, *ends[:-1]]
        for window, start, end in zip(windows, starts, ends, strict=True):
            if start < end:
                yield int(window), slice(int(start), int(end))


def windows(mesh: Mesh, most: int) -> Iterator[NDArray[Any]]:
    """Yield all vertices, `most` at a time, the last fewer, in one reused array.

    Raises
    ------
    SceneError
        If they are not as many as the mesh said.
    """
    held = np.empty((min(most, mesh.vertices), mesh.columns), mesh.row)
    filled = total = 0
    for block in mesh.vertex_blocks():
        total += len(block)
        if total > mesh.vertices:
            break
        while len(block):
            n = min(len(block), len(held) - filled)
            held[filled : filled + n] = block[:n]
            filled += n
            block = block[n:]
            if filled == len(held) and (len(block) or total < mesh.vertices):
                yield held
                filled = 0
    if total != mesh.vertices:
        raise SceneError(f"{mesh.name}: found {total} vertices, expected {mesh.vertices}")
    yield held[:filled]
