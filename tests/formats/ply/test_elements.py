"""What is read of a PLY file: elements of any properties in any order, faces and points."""

from __future__ import annotations

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import FACES, VERTICES, convert, expected, failure, shapes_of
from ply_files import (
    CODES,
    CORNERS,
    LAYOUTS,
    OTHERS,
    WHOLE,
    WIDE,
    XYZ,
    chunk_bytes,
    mesh,
    ply,
    points,
)
from properties import examples

from bfrt.errors import SettingError
from bfrt.formats.ply._rows import Rows
from bfrt.formats.ply.element import TYPES, Element, Property
from bfrt.records import Kind

# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("other", [False, True])
@pytest.mark.parametrize("kind", CODES)
def test_all_types_under_both_names(file, layout, kind, other):
    name = OTHERS[kind] if other else kind
    signed = kind in ("char", "short", "int", "int64")
    vertices = [[100, 0, 7], [3, -100 if signed else 100, 2], [0, 1, 90]]
    if kind in ("float", "double"):
        vertices = [[0.1, -2e-30, 1.5], [3, float(np.float32(0.3)), 2], [1e20, 1, 90]]
        if kind == "float":
            vertices = np.float32(vertices).tolist()
    file.write_bytes(mesh(layout, [[0, 1, 2]], vertices, [(axis, name) for axis in "xyz"]))
    store = convert(file)
    assert shapes_of(store) == expected(vertices, [[0, 1, 2]])
    assert [stream.wide for stream in store.streams] == [kind in WIDE]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [4, 8])
def test_numbers_are_stored_untouched(file, layout, size):
    rng = np.random.default_rng(3)
    vertices = np.ldexp(rng.normal(size=(60, 3)), rng.integers(-160, 90, (60, 3)))
    vertices = vertices.astype(f"f{size}")
    xyz = [(axis, {4: "float", 8: "double"}[size]) for axis in "xyz"]
    rows = [[0, 1, 2], [3, 4, 5], *np.arange(6, 60).reshape(-1, 6).tolist()]
    file.write_bytes(mesh(layout, rows, vertices, xyz))
    triangles, polygons = convert(file, polygons=True, order="given").streams
    assert triangles.path("geometry").read_bytes() == vertices[:6].tobytes()
    assert polygons.path("geometry").read_bytes() == vertices[6:].tobytes()


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("name", ["vertex_index", "vertex_indices"])
@pytest.mark.parametrize("kind", CODES)
def test_indices_of_any_type(file, layout, name, kind):
    counted = "uchar" if name == "vertex_index" or kind not in WHOLE else kind
    file.write_bytes(mesh(layout, corners=[(name, counted, kind)]))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("bad", [0.5, float("nan"), float("inf"), 1e30])
def test_indices_that_are_not_whole(file, layout, bad):
    corners = [("vertex_indices", "uchar", "double")]
    file.write_bytes(mesh(layout, [[0, 1, 2], [0, bad, 1]], corners=corners))
    assert f"{bad:g}"[:3] in failure(file)
    assert failure(file).endswith("in row 1 of face, expected a vertex's whole number")


SCALARS = st.sampled_from(list(CODES))
EXTRA = st.one_of(st.tuples(SCALARS), st.tuples(st.sampled_from(WHOLE), SCALARS))


@st.composite
def files(draw):
    """Any mesh in any layout with anything beside it: its bytes, vertices, faces, and whether it
    is wide."""
    layout = draw(st.sampled_from(list(LAYOUTS)))
    rng = np.random.default_rng(draw(st.integers(0, 1 << 30)))

    def value(types):
        number = float if types[-1] in ("float", "double") else int
        numbers = [number(x) for x in rng.integers(0, 99, rng.integers(0, 9))]
        return numbers if len(types) > 1 else number(rng.integers(0, 99))

    def extras():
        """Properties with names of their own."""
        return [(f"extra{next(names)}", *types) for types in draw(st.lists(EXTRA, max_size=2))]

    def element(name, wanted, rows):
        """An element with what is wanted among what is not, in any order."""
        properties = draw(st.permutations([*wanted, *extras()]))
        given = [word for word, *_ in wanted]
        return name, properties, [
            [row[given.index(word)] if word in given else value(types)
             for word, *types in properties]
            for row in rows
        ]  # fmt: skip

    names = itertools.count()
    kinds = draw(st.lists(SCALARS, min_size=3, max_size=3))
    n = draw(st.integers(1, 12))
    vertices = [[value((kind,)) for kind in kinds] for _ in range(n)]
    sizes = draw(st.lists(st.sampled_from([3, 3, 3, 4, 5, 30]), max_size=8))
    faces = [rng.integers(0, n, size).tolist() for size in sizes]
    corners = draw(st.tuples(st.sampled_from(["vertex_index", "vertex_indices"]),
                             st.sampled_from(WHOLE), st.sampled_from(WHOLE)))  # fmt: skip
    xyz = [("x", kinds[0]), ("y", kinds[1]), ("z", kinds[2])]
    elements = [element("vertex", xyz, vertices), element("face", [corners], [[f] for f in faces])]
    for _ in range(draw(st.integers(0, 2))):
        other = element(f"other{next(names)}", [], [[]] * draw(st.integers(0, 4)))
        elements.insert(draw(st.integers(0, len(elements))), other)
    wide = any(kind in WIDE for kind in kinds)
    return ply(layout, *elements), vertices, faces, wide


@examples(80)
@given(made=files(), size=st.sampled_from([40, 47, 64, 1 << 20]))
def test_round_trip(tmp_path_factory, made, size):
    data, vertices, faces, wide = made
    file = tmp_path_factory.mktemp("ply") / "a.ply"
    file.write_bytes(data)
    with pytest.MonkeyPatch.context() as patch:
        chunk_bytes(patch, size)
        store = convert(file, **({"polygons": True} if faces else {"radius": 1}))
    assert all(stream.wide == wide for stream in store.streams)
    if faces:
        assert shapes_of(store) == expected(vertices, faces)
    else:
        assert shapes_of(store) == [((*map(float, row), 1.0),) for row in vertices]


@pytest.mark.parametrize("size", range(1, 40))
def test_bare_faces_that_end_anywhere_in_a_chunk(size):
    faces = [[0, 1, 2], [3, -4, 5, 6], list(range(200)), [7, 8, 9], [], [1, 1, 1]]
    data = b"".join(struct.pack(f"<B{len(face)}i", len(face), *face) for face in faces)
    corners = Property("vertex_index", TYPES["int"], TYPES["uchar"])
    element = Element("face", len(faces), (corners,))
    rows = Rows(element, element.wanted((), corners), "little", 1)
    found, left = [], b""
    for first in range(0, len(data), size):
        chunk = left + data[first : first + size]
        corners, counts, _, used = rows.parse(np.frombuffer(chunk, np.uint8))
        found += [part.tolist() for part in np.split(corners, np.cumsum(counts))[:-1]]
        left = chunk[used:]
    assert rows.done
    assert found == faces
    assert left == b""


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("first", ["face", "vertex"])
def test_elements_in_any_order(file, layout, first):
    elements = [
        ("nothing", [], []),
        ("vertex", XYZ, VERTICES.tolist()),
        ("none", [], [[]] * 5),
        ("edge", [("a", "int"), ("b", "uchar", "double")], [[1, [2.5, 3.5]], [2, []]]),
        ("face", CORNERS, [[face] for face in FACES]),
    ]
    file.write_bytes(ply(layout, *(elements if first == "vertex" else elements[::-1])))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


def test_comments_line_ends_and_blanks(file):
    text = mesh().replace(b"\nelement", b"\ncomment element vertex 9\nobj_info x\n\nelement")
    file.write_bytes(text.replace(b"\n", b"\r\n"))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)
    head, mark, body = text.partition(b"end_header\n")
    file.write_bytes(head + mark + b"\n\t" + b" ".join(body.split()) + b"\n\n \r\n")
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)
    data = mesh("binary_little_endian")
    head, mark, body = data.partition(b"end_header\n")
    file.write_bytes((head + mark).replace(b"\n", b"\r\n") + body)
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("end", "other"), [(b"\r", b"\n"), (b"\r\n", b"\n"), (b"\n", b"\r")])
def test_headers_of_any_line_ends(file, layout, end, other, tiny):
    """Bytes behind the header may begin with what ends lines elsewhere."""
    vertices = VERTICES.copy()
    vertices[0, 0] = np.frombuffer(other + b"\0\0\x40", "<f4")[0]
    head, mark, body = mesh(layout, vertices=vertices).partition(b"end_header\n")
    head = head.replace(b"\nelement", b"\ncomment a\n\nelement")
    if layout == "ascii":
        body = body.replace(b"\n", end)
    if layout == "binary_little_endian":
        assert body.startswith(other)
    file.write_bytes((head + mark).replace(b"\n", end) + body)
    assert shapes_of(convert(file, polygons=True)) == expected(vertices, FACES)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_polygons_as_triangles(file, layout):
    file.write_bytes(mesh(layout))
    store = convert(file, triangulate=True)
    fans = [[f[0], f[i], f[i + 1]] for f in FACES for i in range(1, len(f) - 1)]
    assert [stream.kind for stream in store.streams] == [Kind.TRIANGLE]
    assert shapes_of(store) == expected(VERTICES, fans)


def triangles_of(strip):
    """The triangles of a strip, every other one turned."""
    made, run = [], []
    for index in strip:
        run = [] if index == -1 else [*run, index]
        if len(run) >= 3:
            a, b, c = run[-3:]
            made.append([a, b, c] if len(run) % 2 else [b, a, c])
    return made


@pytest.mark.parametrize("layout", LAYOUTS)
def test_strips_of_triangles(file, layout, tiny):
    strips = [
        [0, 1, 2, 3, 5, 4, 0],
        [0, 1, 2, -1, 3, 4, 5, 0, -1, -1, 1, -1, 2, 3, -1],
        [],
        [i % 6 for i in range(333)],
        [-1],
    ]
    triangles = [triangle for strip in strips for triangle in triangles_of(strip)]
    lists = [("vertex_indices", "int", "int")]
    rows = [[strip] for strip in strips]
    file.write_bytes(ply(layout, ("vertex", XYZ, VERTICES.tolist()), ("tristrips", lists, rows)))
    assert shapes_of(convert(file)) == expected(VERTICES, triangles)


def test_a_strip_goes_round_as_it_is_seen(file):
    """A flat strip, seen from above: all its triangles turn the same way."""
    vertices = np.array([[i // 2, i % 2, 0] for i in range(20)], np.float32)
    rows = [[list(range(20))]]
    file.write_bytes(ply("ascii", ("vertex", XYZ, vertices.tolist()), ("tristrips", CORNERS, rows)))
    corners = np.array(shapes_of(convert(file)))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(corners) == 18
    assert len({tuple(normal) for normal in normals.tolist()}) == 1


def test_faces_and_strips_in_one_file(file):
    rows = [("vertex", XYZ, VERTICES.tolist()), ("tristrips", CORNERS, [[[0, 1, 2, 3]]]),
            ("face", CORNERS, [[face] for face in FACES])]  # fmt: skip
    file.write_bytes(ply("ascii", *rows))
    assert shapes_of(convert(file)) == expected(VERTICES, [*triangles_of([0, 1, 2, 3]), *FACES])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("listed", [False, True])
def test_long_lists_over_small_chunks(file, layout, listed, tiny):
    rng = np.random.default_rng(4)
    vertices = rng.normal(size=(70, 3)).astype(np.float32)
    faces = [rng.integers(0, 70, size).tolist() for size in (3, 200, 4, 3, 77)]
    more = [("weights", "uchar", "double")] if listed else []
    rows = [
        [*row, *([[0.5] * (i % 30)] if listed else [])] for i, row in enumerate(vertices.tolist())
    ]
    corners = [("flags", "ushort", "short"), ("vertex_index", "int", "uint"), ("n", "char")]
    rows = [
        ("vertex", [*XYZ, *more], rows),
        ("face", corners, [[[-1] * 40, face, 5] for face in faces]),
    ]
    file.write_bytes(ply(layout, *rows))
    assert shapes_of(convert(file, polygons=True)) == expected(vertices, faces)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_no_faces_and_no_vertices(file, layout):
    file.write_bytes(mesh(layout, [], []))
    assert convert(file).objects == 0


# --- points --------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
def test_radii_of_points(file, layout):
    file.write_bytes(points(layout, [("h", "double")], [[0.25], [0.5], [0.75]]))
    for radius, radii in ((2, [2, 2, 2]), (0.1, [np.float32(0.1)] * 3), ("h", [0.25, 0.5, 0.75]),
                          (np.float32(0.5), [0.5] * 3)):  # fmt: skip
        store = convert(file, radius=radius)
        assert shapes_of(store) == [((i, 0, 0, r),) for i, r in enumerate(radii)]
        assert not store.streams[0].wide
    assert "a radius, expected radius=" in failure(file, SettingError)
    assert "found no mass of each vertex, expected one of h x y z" in failure(
        file, SettingError, radius="mass"
    )


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_radius_of_the_files_own(file, layout):
    file.write_bytes(points(layout, [("radius", "float"), ("h", "uchar")], [[1, 2], [3, 4]]))
    assert shapes_of(convert(file)) == [((0, 0, 0, 1),), ((1, 0, 0, 3),)]
    assert shapes_of(convert(file, radius="h")) == [((0, 0, 0, 2),), ((1, 0, 0, 4),)]
    assert shapes_of(convert(file, radius=9)) == [((0, 0, 0, 9),), ((1, 0, 0, 9),)]


def test_points_in_elements_with_lists(file, tiny):
    rows = [[[0] * i, 0.5 + i] for i in range(9)]
    file.write_bytes(
        points("binary_big_endian", [("l", "int", "short"), ("radius", "float")], rows)
    )
    assert shapes_of(convert(file)) == [((i, 0, 0, 0.5 + i),) for i in range(9)]
