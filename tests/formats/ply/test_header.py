"""Headers that are refused, and counts that lie."""

from __future__ import annotations

import time
import tracemalloc

import pytest
from meshes import FACES, VERTICES, convert, expected, failure, outcome, shapes_of
from ply_files import LAYOUTS, mesh, points, rich


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("element", ["vertex", "face", "last"])
@pytest.mark.parametrize("change", [-1, 1, 1000])
def test_counts_that_lie(file, layout, element, change, caplog):
    data = rich(layout)
    (line,) = [word for word in data.split(b"\n") if word.startswith(f"element {element}".encode())]
    name, count = line.rsplit(b" ", 1)
    file.write_bytes(data.replace(line, name + b" %d" % (int(count) + change)))
    if change > 0 or element == "vertex":
        assert "expected" in failure(file)
    else:  # fewer of what comes last are there, and more bytes
        assert shapes_of(convert(file)) == expected(
            VERTICES, FACES[: 1 if element == "face" else 2]
        )
        assert "bytes behind the last element were passed over" in caplog.text


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("tail", [b"0", b"\n1 2 3\n", b"\0", b"\n"])
def test_bytes_behind_the_end(file, layout, tail, caplog):
    left = len(tail.strip(b"\0\n") if layout == "ascii" else tail)  # padding of text is nothing
    said = f"{file}: {left} bytes behind the last element were passed over: its counts may be wrong"
    file.write_bytes(mesh(layout) + tail)
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)
    assert caplog.messages == [said] * (left > 0)
    file.write_bytes(points(layout) + tail)
    assert convert(file, radius=1).objects == 3
    assert caplog.messages == [said] * 2 * (left > 0)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("element", ["vertex", "face", "last", "bare"])
@pytest.mark.parametrize("count", [2**32 + 6, 2**47])
def test_huge_counts_are_refused_at_once(file, layout, element, count):
    data = rich(layout).replace(b"element last", b"element bare 0\nelement last")
    (line,) = [word for word in data.split(b"\n") if word.startswith(f"element {element}".encode())]
    file.write_bytes(data.replace(line, f"element {element} {count}".encode()))
    began = time.perf_counter()
    tracemalloc.start()
    try:
        if element == "bare":  # rows without anything take no time, however many
            assert outcome(file) == "2 objects"
        else:
            said = failure(file)
            assert f"{count} rows of {element}" in said
        assert tracemalloc.get_traced_memory()[1] < 128 << 20
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - began < 2


HEADERS = {
    "plx": ("line 1: found 'plx', expected ply", [("ply", "plx")]),
    "no format": ("found a header without format", [("format ascii 1.0\n", "")]),
    "two formats": ("line 3: found 'format ascii 1.0', expected one format",
                    [("1.0\n", "1.0\nformat ascii 1.0\n")]),
    "version": ("line 2: found 'format ascii 1.1', expected", [("1.0", "1.1")]),
    "layout": ("expected one format, ascii or binary_little_endian", [("ascii", "text")]),
    "no count": ("line 3: found 'element vertex', expected element", [("vertex 6", "vertex")]),
    "negative": ("line 3: found 'element vertex -6'", [("vertex 6", "vertex -6")]),
    "digits": ("count of 0 to 2^48", [("vertex 6", f"vertex {'9' * 5000}")]),
    "other digits": ("line 3: found", [("vertex 6", "vertex ٦")]),
    "twice": ("expected each element once", [("element face", "element vertex")]),
    "same name": ("expected each property of an element once", [("float y", "float x")]),
    "type": ("expected types of char uchar", [("float x", "half x")]),
    "words": ("expected property, a type and a name", [("float x", "float x y")]),
    "float count": ("a list with a count of whole numbers", [("list uchar", "list float")]),
    "no index": ("found face without a list", [("vertex_indices", "indices")]),
    "no y": ("found no vertex with x, y and z", [("float y", "float w")]),
    "listed x": ("found no vertex with x, y and z", [("float x", "list int int x")]),
    "no vertex": ("found no vertex with x, y and z", [("element vertex", "element vortex")]),
    "statement": ("line 4: found 'propertie float x', expected format, element, property",
                  [("property float x", "propertie float x")]),
    "early": ("line 3: found 'property int a'", [("1.0\n", "1.0\nproperty int a\n")]),
    "many": ("at most 4096 properties",
             [("float z\n", "float z\n" + "".join(f"property int p{i}\n" for i in range(4094)))]),
    "endless": ("expected a header that end_header ends",
                [("end_header", "comment " + "x" * (1 << 20))]),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_headers_that_are_refused(file, name):
    words, changes = HEADERS[name]
    text = mesh().decode()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text)
    said = failure(file)
    assert words in said
    assert "expected" in said


def test_the_most_properties(file):
    more = [(f"p{i}", "ushort") for i in range(4093)]
    for layout in LAYOUTS:
        file.write_bytes(points(layout, more, [list(range(4093))] * 2))
        assert shapes_of(convert(file, radius="p4092")) == [((0, 0, 0, 4092),), ((1, 0, 0, 4092),)]
