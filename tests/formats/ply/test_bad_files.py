"""Rows of a PLY file that are refused, cut short, or not finite."""

from __future__ import annotations

import errno
import struct
import tracemalloc

import numpy as np
import pytest
from failing import alone, refuse_reads, refuse_writes
from hypothesis import given
from hypothesis import strategies as st
from meshes import FACES, VERTICES, convert, expected, failure, outcome, shapes_of, small_room
from ply_files import CODES, CORNERS, LAYOUTS, XYZ, chunk_bytes, mesh, ply, points, rich
from properties import examples

from bfrt.errors import StreamError
from bfrt.formats.ply import file as file_module


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_file_cut_at_any_byte(file, layout):
    data = rich(layout)
    whole = len(data.rstrip()) if layout == "ascii" else len(data)
    header = 0 if layout == "ascii" else data.index(b"end_header")  # they have the same
    for size in (*range(header, len(data), 1 + (layout != "ascii")), len(data) - 1):
        file.write_bytes(data[:size])
        if size < whole:
            assert "expected" in failure(file)
        else:
            assert outcome(file) == "2 objects"


@pytest.mark.parametrize("layout", LAYOUTS)
def test_points_cut_at_any_byte(file, layout):
    data = points(layout)
    for size in range(data.index(b"end_header"), len(data.rstrip() if layout == "ascii" else data)):
        file.write_bytes(data[:size])
        assert "expected" in failure(file, radius=1)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("where", ["vertex_indices", "passed"])
@pytest.mark.parametrize(("counted", "count"), [("uint", 2**32 - 1), ("int", 2**31 - 1)])
def test_huge_lists_are_refused_at_once(file, layout, where, counted, count):
    lists = [(where, counted, "int"), *CORNERS][: 2 if where == "passed" else 1]
    data = ply(layout, ("vertex", XYZ, VERTICES.tolist()), ("face", lists, []))
    data = data.replace(b"element face 0", b"element face 1")
    number = b"%d 0 1 2" % count
    if layout != "ascii":
        number = struct.pack(f"{LAYOUTS[layout]}I3i", count, 0, 1, 2)
    file.write_bytes(data + number)
    tracemalloc.start()
    try:
        said = failure(file)
        assert tracemalloc.get_traced_memory()[1] < 128 << 20
    finally:
        tracemalloc.stop()
    if where == "passed":
        assert "found the file's end in row 0 of face, expected 1 rows" in said
    else:
        assert f"{count}" in said
        assert "corners in row 0 of face, expected 1048576 or fewer" in said


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["char", "short", "int"])
def test_negative_counts_of_lists(file, layout, kind):
    data = ply(
        layout, ("vertex", XYZ, VERTICES.tolist()), ("face", [("vertex_index", kind, "int")], [])
    )
    data = data.replace(b"element face 0", b"element face 1")
    number = b"-3" if layout == "ascii" else struct.pack(LAYOUTS[layout] + CODES[kind], -3)
    file.write_bytes(data + number + b" 0 1 2")
    said = failure(file)
    assert "-3" in said
    assert "in row 0 of face, expected a list's count, 0 or more" in said


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("index", [-1, 6, 2**31 - 1, -(2**31)])
def test_indices_out_of_range(file, layout, index):
    file.write_bytes(mesh(layout, [*FACES, [0, 1, index, 2]]))
    assert failure(file) == f"face 4: found vertex {index}, expected 0 to 5"
    file.write_bytes(mesh(layout, [[0, 1, index]], []))
    assert failure(file) == f"face 0: found vertex {0}, expected none"


@pytest.mark.parametrize("sign", [1, -1])
def test_an_index_in_text_is_told_as_it_is_there(file, sign):
    index = sign * ((1 << 53) - 1)
    file.write_bytes(mesh("ascii", [*FACES, [0, 1, index, 2]]))
    assert failure(file) == f"face 4: found vertex {index}, expected 0 to 5"
    for index in (sign * ((1 << 53) + 1), sign * 123456789012345678, sign * 99999999999999999999):
        file.write_bytes(mesh("ascii", [*FACES, [0, 1, index, 2]]))
        said = f"found '{index}' in row 4 of face, expected a vertex's whole number"
        assert failure(file).endswith(said)


def test_large_unsigned_indices(file):
    for index in (2**31, 2**32 - 1):
        file.write_bytes(
            mesh("binary_big_endian", [[0, 1, index]], corners=[("vertex_index", "uchar", "uint")])
        )
        assert failure(file) == f"face 0: found vertex {index}, expected 0 to 5"


BAD = [float("nan"), float("inf"), float("-inf")]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("kind", ["float", "double"])
def test_faces_that_are_not_finite(file, layout, bad, kind, caplog):
    vertices = VERTICES.tolist()
    vertices[5][1] = bad
    xyz = [(axis, kind) for axis in "xyz"]
    file.write_bytes(mesh(layout, [[0, 1, 2], *FACES, [2, 1, 0]], vertices, xyz))
    said = failure(file)
    assert said.startswith("face 1: found 0 0 0 1 0 0.25 0.5 ")
    assert said.endswith("expected finite coordinates of three corners or more")
    store = convert(file, skip_invalid=True)
    assert shapes_of(store) == expected(vertices, [[0, 1, 2], FACES[1], [2, 1, 0]])
    assert caplog.messages == [f"{file}: 3 invalid objects were dropped"]
    vertices[5][1], vertices[4][0] = 2.0, bad  # nothing needs it
    file.write_bytes(mesh(layout, FACES, vertices, xyz))
    assert convert(file).objects == 4


@pytest.mark.parametrize("bad", ["-1.#IND", "1.#QNAN0", "1.#INF", "-1.#INF00", "nan(ind)"])
def test_what_printf_writes_of_numbers_that_are_not_finite(file, bad):
    data = mesh(faces=[[0, 1, 3], [0, 1, 2], [3, 2, 1, 0]]).replace(b"0.75", bad.encode())
    file.write_bytes(data)
    assert failure(file).startswith("face 1: found 0 0 0 1 0 0.25 1 1 ")
    assert shapes_of(convert(file, skip_invalid=True)) == expected(VERTICES, [[0, 1, 3]])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("column", [0, 2, 3])
def test_points_that_are_not_finite(file, layout, bad, column, caplog, tiny):
    rows = [[float(i), 1.0, 2.0, 1.0] for i in range(20)]
    rows[7][column] = rows[12][column] = bad
    file.write_bytes(ply(layout, ("vertex", [*XYZ, ("radius", "float")], rows)))
    assert failure(file).startswith("point 7: found ")
    assert shapes_of(convert(file, skip_invalid=True)) == [
        (tuple(row),) for i, row in enumerate(rows) if i not in (7, 12)
    ]
    assert caplog.messages == [f"{file}: 2 invalid objects were dropped"]


@pytest.mark.filterwarnings("error")
def test_text_beyond_its_type_is_infinite(file):
    for number in (b"1e39", b"-1e39", b"1e999"):
        file.write_bytes(mesh().replace(b"0.25", number))
        assert "inf" in failure(file)
        for radius in ("h", 1e39):
            file.write_bytes(points("ascii", [("h", "double")], [[0.5]]).replace(b"0.5", number))
            assert failure(file, radius=radius).startswith("point 0: found 0 0 0 ")


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [0, 1, 2])
def test_faces_of_too_few_corners(file, layout, size, caplog):
    file.write_bytes(mesh(layout, [[0, 1, 2], [0, 1][:size], *FACES]))
    said = failure(file)
    assert said.startswith(
        f"face 1: found {['nothing', '0 0 0', '0 0 0 1 0 0.25'][size]}, expected"
    )
    assert shapes_of(convert(file, skip_invalid=True)) == expected(VERTICES, [[0, 1, 2], *FACES])
    assert "1 invalid objects" in caplog.text


def test_rows_of_many_properties_are_few_at_once(file, monkeypatch):
    monkeypatch.setattr(file_module, "BLOCK_BYTES", 1000)
    more = [(f"p{i}", "double") for i in range(30)]
    file.write_bytes(points("binary_big_endian", more, [[i] * 30 for i in range(20)]))
    with file_module.Ply(file) as opened:
        vertex = opened.element("vertex")
        blocks = list(opened.columns(vertex, ("x", "p29")))
    assert [len(block) for block in blocks] == [3] * 6 + [2]
    assert np.vstack(blocks).tolist() == [[i, i] for i in range(20)]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"0.75", b"3/4", "line 12: found '3/4' in row 2 of vertex, expected a number"),
        (b"0.75", b"0.75#", "line 12: found '0.75#' in row 2 of vertex, expected a number"),
        (b"0.75", b"# 0.75", "line 12: found '#' in row 2 of vertex, expected a number"),
        (b"0.75", b"1.#", "line 12: found '1.#' in row 2 of vertex, expected a number"),
        (b"0.75", b"infix", "line 12: found 'infix' in row 2 of vertex, expected a number"),
        (b"0.75", b"\xff\0", r"found '\\xff\x00' in row 2 of vertex, expected a number"),
        (
            b"\n3 5 3 0",
            b"\n3 5 3.5 0",
            "found '3.5' in row 2 of face, expected a vertex's whole number",
        ),
        (b"\n3 5 3 0", b"\n3 5 nan 0", "found 'nan' in row 2 of face, expected a vertex's whole"),
        (b"\n3 5 3 0", b"\n1.5 5 3 0", "found '1.5' in row 2 of face, expected a list's count"),
        (b"\n3 5 3 0", b"\n1048577 5 3 0", "'1048577' corners in row 2 of face, expected 1048576"),
        (b"\n3 5 3 0", b"\n3 5 3 " + b"0" * 70, "in row 2 of face, expected a number"),
    ],
)
def test_words_that_are_no_numbers(file, old, new, words):
    data = mesh()
    assert data.count(old) == 1
    file.write_bytes(data.replace(old, new))
    assert words in failure(file)


def test_a_token_longer_than_a_chunk(file, tiny):
    file.write_bytes(mesh().replace(b"0.75", b"0." + b"1" * 99))
    assert "expected shorter ones" in failure(file)


@examples(80)
@given(
    layout=st.sampled_from(list(LAYOUTS)),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1,
                   max_size=4),
    size=st.sampled_from([33, 1 << 20]),
    asked=st.sampled_from([{}, {"skip_invalid": True}, {"triangulate": True},
                              {"color_by": "z"}, {"color_by": "q"}]),
)  # fmt: skip
def test_flipped_bytes(tmp_path_factory, layout, flips, size, asked):
    data = bytearray(rich(layout))
    for place, change in flips:
        data[int(place * len(data))] ^= change
    file = tmp_path_factory.mktemp("ply") / "a.ply"
    file.write_bytes(data)
    with pytest.MonkeyPatch.context() as patch:
        chunk_bytes(patch, size)
        outcome(file, **asked)


@examples(50)
@given(body=st.binary(max_size=200), layout=st.sampled_from(list(LAYOUTS)))
def test_random_bodies(tmp_path_factory, body, layout):
    head, mark, _ = rich(layout).partition(b"end_header\n")
    file = tmp_path_factory.mktemp("ply") / "a.ply"
    file.write_bytes(head + mark + body)
    outcome(file)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_read_that_is_refused(file, layout, tiny, monkeypatch):
    file.write_bytes(rich(layout))
    reads = refuse_reads(monkeypatch, file, lambda: convert(file), lambda: alone(file))
    assert reads > 5


def test_no_such_file(file):
    with pytest.raises(StreamError) as caught:
        convert(file)
    assert caught.value.errno == errno.ENOENT
    assert str(file) in str(caught.value)
    assert list(file.parent.iterdir()) == []


@pytest.mark.parametrize("joined", ["in memory", "on disk"])
def test_a_full_disk_at_any_write(file, joined, monkeypatch):
    file.write_bytes(mesh("binary_little_endian"))
    if joined == "on disk":
        small_room(monkeypatch, 50)
    refused = refuse_writes(
        monkeypatch,
        lambda: convert(file),
        lambda: alone(file),
    )
    assert refused > (8 if joined == "on disk" else 3)
