"""What the header of a PLY file promises: elements and their properties."""

from __future__ import annotations

from bfrt.formats.columns import POSITION
from bfrt.formats.contents import COLOR, FACES, NORMALS, OWN_COLORS, POINTS, RADIUS, VERTICES, Row
from bfrt.formats.ply.element import CODES, CORNERS, Element, Property
from bfrt.formats.ply.file import Ply
from bfrt.formats.ply.reader import COLOR_NAMES, NORMAL
from bfrt.formats.ply.splats import CONSTANTS, OPACITY, are_splats


def contents_of_ply(path: str) -> list[Row]:
    """List the properties of all elements, by the header.

    Raises
    ------
    SceneError
        If it is no PLY, or is too short for its header's counts.
    StreamError
        If the system refuses to read it.
    """
    with Ply(path) as ply:
        has_faces = any(e.name in ("face", "tristrips") and e.rows for e in ply.elements)
        return [
            Row(f"{e.name} {p.name}", (e.rows,), type_of(p), use_of(e, p, has_faces=has_faces))
            for e in ply.elements
            for p in e.properties
        ]


def type_of(column: Property) -> str:
    """Return the type of a property in words."""
    listed = "" if column.counted < 0 else "list of "
    return f"{listed}{CODES[column.kind]}"


def use_of(element: Element, column: Property, *, has_faces: bool) -> str:
    """Return what a property becomes, and the options that take it."""
    name = column.name
    if column.counted >= 0:
        of_faces = element.name in ("face", "tristrips") and name in CORNERS
        return FACES if of_faces else ""
    if element.name not in ("vertex", "face"):
        return ""
    if any(name in names and all(map(element.find, names)) for names in COLOR_NAMES):
        return OWN_COLORS
    options = [COLOR.format(name)]
    if element.name == "vertex" and not has_faces and are_splats(element):
        if name in CONSTANTS:
            return OWN_COLORS
        if name == OPACITY:
            options.insert(0, "--opacity T")
    if element.name == "vertex":
        if name in POSITION:
            return f"{VERTICES if has_faces else POINTS}, {options[0]}"
        if name in NORMAL and has_faces and all(map(element.find, NORMAL)):
            return f"{NORMALS}, {options[0]}"
        if not has_faces:
            options.append(RADIUS.format(name))
    return ", ".join(options)
