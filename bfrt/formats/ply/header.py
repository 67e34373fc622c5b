"""The header of a PLY file: its layout and its elements."""

from __future__ import annotations

from collections.abc import Container
from typing import NamedTuple

from bfrt.errors import SceneError
from bfrt.formats.ply._rows import MOST_PROPERTIES
from bfrt.formats.ply.element import TYPES, WHOLE, Element, Property
from bfrt.formats.source import Source, quoted
from bfrt.records import INDEX_BITS

LAYOUTS = {"ascii": "text", "binary_little_endian": "little", "binary_big_endian": "big"}

#: Bytes of a header, at the most.
HEADER_BYTES = 1 << 20


class Place(NamedTuple):
    """Marks the place where an element begins."""

    offset: int
    line: int


class Header(NamedTuple):
    """Says what a file contains.

    Attributes
    ----------
    layout : {"text", "little", "big"}
        How values are written.
    elements : list of Element
    start : Place
        Where the first element begins.
    """

    layout: str
    elements: list[Element]
    start: Place


class Begun(NamedTuple):
    """Collects an element's properties by their names while the header is read."""

    rows: int
    properties: dict[str, Property]


def read_header(source: Source) -> Header:
    """Read the header, and check each of its lines."""
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
        where = f"{source.name}: line {number}: found {quoted(line.rstrip())}, expected"
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
    start = Place(at if layout == "text" else len(source.mark) + at, number + 1)
    return Header(layout, done, start)


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
