"""The PLY reader against a simple writer, in all layouts, and against every kind of broken file."""

from __future__ import annotations

import errno
import itertools
import struct
import time
import tracemalloc

import numpy as np
import pytest
from failing import alone, refuse_reads, refuse_writes
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import (
    FACES,
    VERTICES,
    convert,
    expected,
    failure,
    objects_of,
    outcome,
    shapes_of,
    small_room,
)

from bfrt.errors import SettingError, StreamError
from bfrt.formats import ply as ply_module
from bfrt.formats import source as source_module
from bfrt.records import Kind

LAYOUTS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
         "float": "f", "double": "d", "int64": "q", "uint64": "Q"}  # fmt: skip
OTHERS = {"char": "int8", "uchar": "uint8", "short": "int16", "ushort": "uint16", "int": "int32",
          "uint": "uint32", "float": "float32", "double": "float64",
          "int64": "int64", "uint64": "uint64"}  # fmt: skip
WHOLE = [name for name in CODES if name not in ("float", "double")]
WIDE = ("int", "uint", "double", "int64", "uint64")
XYZ = [("x", "float"), ("y", "float"), ("z", "float")]
CORNERS = [("vertex_indices", "uchar", "int")]


def ply(layout, *elements):
    """A file of elements: name, properties (name and type, or for lists two types), and rows."""
    head = ["ply", f"format {layout} 1.0"]
    for name, properties, rows in elements:
        head.append(f"element {name} {len(rows)}")
        for word, *types in properties:
            head.append(f"property {'list ' * (len(types) > 1)}{' '.join(types)} {word}")
    body = b""
    for _, properties, rows in elements:
        for row in rows:
            values = []  # each with its type
            for (_, *types), value in zip(properties, row, strict=True):
                if len(types) > 1:
                    values.append((types[0], len(value)))
                    values += [(types[1], item) for item in value]
                else:
                    values.append((types[0], value))
            if layout == "ascii":
                body += " ".join(repr(value) for _, value in values).encode() + b"\n"
            else:
                form = LAYOUTS[layout] + "".join(
                    CODES[next(k for k in CODES if kind in (k, OTHERS[k]))] for kind, _ in values
                )
                body += struct.pack(form, *(value for _, value in values))
    return "\n".join([*head, "end_header\n"]).encode() + body


def mesh(layout="ascii", faces=FACES, vertices=VERTICES, xyz=XYZ, corners=CORNERS):
    """A file of vertices and faces, nothing else."""
    rows = [[face] for face in faces]
    return ply(layout, ("vertex", xyz, np.asarray(vertices).tolist()), ("face", corners, rows))


def points(layout="ascii", more=(), rows=None):
    """A file of points with more properties."""
    rows = [[i, 0, 0, *row] for i, row in enumerate(rows or [[]] * 3)]
    return ply(layout, ("vertex", [*XYZ, *more], rows))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.ply"


@pytest.fixture
def tiny(monkeypatch):
    """Chunks so small that nothing fits in one."""
    chunk_bytes(monkeypatch, 32)


def chunk_bytes(patch, size):
    patch.setattr(source_module, "CHUNK_BYTES", size)
    patch.setattr(ply_module, "CHUNK_BYTES", size)
    patch.setattr(ply_module, "ROWS_AT_ONCE", max(size // 16, 1))


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
    triangles, polygons = convert(file, polygons=True).streams
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


@settings(max_examples=80)
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
    int32, uint8 = ply_module.TYPES["int"], ply_module.TYPES["uchar"]
    rows = ply_module.Rows(len(faces), [int32], [uint8], [0], 0, "little", False, 1)
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


# --- colors --------------------------------------------------------------------------------------


def light_of(color):
    """sRGB as light."""
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color]


def gray(value, lo, hi):
    """The map gray, of 256 steps."""
    step = min(max(int((value - lo) / (hi - lo) * 256), 0), 255)
    return light_of([step / 255] * 3)


def rgb(red, green, blue):
    """A color of 5, 6 and 5 bits."""
    return light_of([round(red * 31) / 31, round(green * 63) / 63, round(blue * 31) / 31])


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["float", "double", "uchar", "int"])
@pytest.mark.parametrize("listed", [False, True])
def test_colors_by_a_number_of_vertices(file, layout, kind, listed):
    number = float if kind in ("float", "double") else int
    heat = [number(x) for x in (0, 10, 20, 60, 200, 100)]
    more = [("l", "uchar", "uchar")] if listed else []
    rows = [[h, *row, *[[1]] * listed] for h, row in zip(heat, VERTICES.tolist(), strict=True)]
    parts = [("vertex", [("heat", kind), *XYZ, *more], rows)]
    file.write_bytes(ply(layout, *parts, ("face", CORNERS, [[face] for face in FACES])))
    store = convert(file, color_by="heat", colormap="gray")
    by_size = sorted(FACES, key=lambda face: len(face) > 3)
    means = [np.mean([heat[i] for i in face]) for face in by_size]
    for each, mean in zip(objects_of(store), means, strict=True):
        assert each.color == pytest.approx(gray(mean, 0, 200))
    assert [each.shape for each in objects_of(store)] == expected(VERTICES, FACES)
    assert not any(stream.wide for stream in store.streams)
    store = convert(file, color_by="heat", colormap="gray", color_range=(30, 40))
    for each, mean in zip(objects_of(store), means, strict=True):
        assert each.color == pytest.approx(gray(mean, 30, 40))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("listed", [False, True])
def test_a_coordinate_is_a_number_too(file, layout, listed):
    """By height, the commonest of all: z is wanted twice."""
    more = [("l", "uchar", "uchar")] if listed else []
    rows = [[*row, *[[]] * listed] for row in VERTICES.tolist()]
    parts = [("vertex", [*XYZ, *more], rows), ("face", CORNERS, [[face] for face in FACES])]
    file.write_bytes(ply(layout, *parts))
    store = convert(file, color_by="z", colormap="gray")
    assert shapes_of(store) == expected(VERTICES, FACES)
    for each in objects_of(store):
        height = np.mean([corner[2] for corner in each.shape])
        assert each.color == pytest.approx(gray(height, 0, 9))
    file.write_bytes(ply(layout, *parts[:1]))
    store = convert(file, color_by="z", radius="z", colormap="gray")
    for each, row in zip(objects_of(store), VERTICES.tolist(), strict=True):
        assert each.shape == ((*row, row[2]),)
        assert each.color == pytest.approx(gray(row[2], 0, 9))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_colors_by_a_number_of_faces(file, layout):
    corners = [("quality", "short"), *CORNERS, ("more", "uchar")]
    rows = [[10 * i - 5, face, 0] for i, face in enumerate(FACES)]
    file.write_bytes(ply(layout, ("vertex", XYZ, VERTICES.tolist()), ("face", corners, rows)))
    found = objects_of(convert(file, color_by="quality", colormap="gray"))
    for each, quality in zip(found, [-5, 15, 5, 25], strict=True):
        assert each.color == pytest.approx(gray(quality, -5, 25))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize(("kind", "full"), [("uchar", 255), ("ushort", 65535), ("float", 1.0)])
@pytest.mark.parametrize("owner", ["vertex", "face", "point"])
def test_colors_of_the_files_own(file, layout, kind, full, owner):
    rng = np.random.default_rng(7)
    parts = rng.random((6, 3))
    parts[0], parts[1] = (0, 0, 0), (1, 1, 1)
    own = [[type(full)(part * full) for part in row] for row in parts]
    channels = [(name, kind) for name in ("blue", "red", "green")]
    rows = [[*row, b, r, g] for row, (r, g, b) in zip(VERTICES.tolist(), own, strict=True)]
    vertex = ("vertex", [*XYZ, *channels], rows)
    asked = {"color_by": "rgb"}
    if owner == "point":
        file.write_bytes(ply(layout, vertex))
        colors, asked["radius"] = own, 1
    elif owner == "vertex":
        file.write_bytes(ply(layout, vertex, ("face", CORNERS, [[f] for f in FACES])))
        by_size = sorted(FACES, key=lambda face: len(face) > 3)
        colors = [np.mean([own[i] for i in face], axis=0) for face in by_size]
    else:
        rows = [[face, b, r, g] for face, (r, g, b) in zip(FACES, own, strict=False)]
        bare = ("vertex", XYZ, VERTICES.tolist())
        file.write_bytes(ply(layout, bare, ("face", [*CORNERS, *channels], rows)))
        colors = [own[0], own[2], own[1], own[3]]
    found = objects_of(convert(file, **asked))
    for each, color in zip(found, colors, strict=True):
        assert each.color == pytest.approx(rgb(*np.divide(color, full)), abs=1e-6)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_colors_that_are_none_are_said(file, layout, caplog):
    """Such as those of 255 levels that are floats."""
    more = [(name, "float") for name in ("red", "green", "blue")]
    colors = [[1, 0, 0.5], [255, 0, 51], [np.nan, 0, 0], [-0.5, 2, 0], *[[1, 1, 1]] * len(VERTICES)]
    rows = [[*row, *color] for row, color in zip(VERTICES.tolist(), colors, strict=False)]
    file.write_bytes(ply(layout, ("vertex", [*XYZ, *more], rows)))
    found = objects_of(convert(file, color_by="rgb", radius=1))
    assert [each.color for each in found[1:4]] == [(1, 0, 1), (0, 0, 0), (0, 1, 0)]
    said = f"{file}: 3 colors are not from 0 to 1: the nearest that are were taken"
    assert caplog.messages[-1] == said


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("names", [("diffuse_red", "diffuse_green", "diffuse_blue"), tuple("rgb")])
@pytest.mark.parametrize("owner", ["vertex", "face", "point"])
def test_colors_by_other_names(file, layout, names, owner):
    full = [255, 0, 51]
    more = [(name, "uchar") for name in names]
    if owner == "face":
        faces = ("face", [*CORNERS, *more], [[[0, 1, 2], *full]])
        file.write_bytes(ply(layout, ("vertex", XYZ, VERTICES.tolist()), faces))
    else:
        rows = [[*row, *full] for row in VERTICES.tolist()]
        faces = [("face", CORNERS, [[[0, 1, 2]]])] if owner == "vertex" else []
        file.write_bytes(ply(layout, ("vertex", [*XYZ, *more], rows), *faces))
    asked = {"radius": 1} if owner == "point" else {}
    for each in objects_of(convert(file, color_by="rgb", **asked)):
        assert each.color == pytest.approx(rgb(1, 0, 0.2))


def test_red_green_and_blue_come_before_other_names(file):
    names = ["r", "g", "b", "diffuse_red", "diffuse_green", "diffuse_blue"]
    more = [(name, "uchar") for name in names]
    row = [0, 0, 255, 0, 255, 0]
    file.write_bytes(points("ascii", more, [row]))
    assert objects_of(convert(file, radius=1, color_by="rgb"))[0].color == (0, 1, 0)
    more += [(name, "uchar") for name in ("red", "green", "blue")]
    file.write_bytes(points("ascii", more, [[*row, 255, 0, 0]]))
    assert objects_of(convert(file, radius=1, color_by="rgb"))[0].color == (1, 0, 0)
    file.write_bytes(points("ascii", more[:2], [[1, 2]]))
    assert "found no red green blue of each vertex" in failure(
        file, SettingError, radius=1, color_by="rgb"
    )


# --- bad files -----------------------------------------------------------------------------------


def rich(layout):
    """A small file of all there is."""
    corners = [("q", "uchar"), *CORNERS, ("l", "ushort", "float")]
    rows = [[7, face, [0.5, 1.5]] for face in FACES[:2]]
    return ply(
        layout,
        ("vertex", [*XYZ, ("l", "uchar", "short")], [[*row, [1, 2]] for row in VERTICES.tolist()]),
        ("face", corners, rows),
        ("last", [("a", "int")], [[1], [2]]),
    )


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


def test_rows_of_many_properties_are_few_at_once(file, monkeypatch):
    monkeypatch.setattr(ply_module, "BLOCK_BYTES", 1000)
    more = [(f"p{i}", "double") for i in range(30)]
    file.write_bytes(points("binary_big_endian", more, [[i] * 30 for i in range(20)]))
    with ply_module.Ply(file) as opened:
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


@settings(max_examples=80)
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


@settings(max_examples=50)
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


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": 1}, "found radius=1, expected none for .ply files of this content"),
        ({"radius": "x"}, "found radius='x', expected none"),
        ({"positions": "x"}, "found positions='x', expected none"),
        ({"color_by": "heat"}, "found no heat of each vertex or face, expected one of x y z"),
        ({"color_by": "rgb"}, "found no red green blue of each vertex or face"),
        ({"color_by": "vertex_indices"}, "found no vertex_indices of each vertex or face"),
        ({"colormap": "gray"}, "found without color_by, expected with it only"),
        ({"color_range": (0, 1)}, "found without color_by"),
        ({"color_by": "x", "colormap": "nope"}, "colormap: found 'nope', expected cubehelix"),
        ({"color_by": "x", "color_range": (1, 0)}, "the lesser first"),
    ],
)
def test_settings_that_do_not_fit_a_mesh(file, asked, words):
    file.write_bytes(mesh())
    assert words in failure(file, SettingError, **asked)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"triangulate": True}, "found triangulate=True, expected none"),
        ({"positions": "x"}, "found positions='x'"),
        ({"color_by": "heat"}, "found no heat of each vertex, expected one of red x y z"),
        ({"color_by": "rgb"}, "found no red green blue of each vertex"),
        ({"colormap": "gray"}, "found without color_by"),
        ({"radius": float("nan")}, "radius: found nan, expected a finite number"),
        ({"radius": float("inf")}, "radius: found inf, expected a finite number"),
        ({"color_by": "x", "colormap": "nope"}, "colormap: found 'nope'"),
    ],
)
def test_settings_that_do_not_fit_points(file, asked, words):
    file.write_bytes(points("ascii", [("red", "uchar")], [[1], [2]]))
    assert words in failure(file, SettingError, **{"radius": 1, **asked})


def test_a_map_for_the_files_own_colors(file):
    more = [(name, "uchar") for name in ("red", "green", "blue")]
    file.write_bytes(points("ascii", more, [[1, 2, 3]]))
    for asked in ({"colormap": "gray"}, {"color_range": (0, 1)}):
        said = failure(file, SettingError, radius=1, color_by="rgb", **asked)
        assert said == "color_by: found rgb with a map, expected rgb alone"


def test_progress_counts_bytes(file):
    file.write_bytes(mesh("binary_little_endian"))
    done = []
    convert(file, progress=done.append)
    assert max(done) == file.stat().st_size
