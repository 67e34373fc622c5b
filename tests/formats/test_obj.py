"""The OBJ reader: all forms of a line, materials, and every kind of broken file."""

from __future__ import annotations

import errno
import itertools
import os
import shutil
import time
import tracemalloc

import numpy as np
import pytest
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
from bfrt.formats import source as source_module
from bfrt.formats.source import Source
from bfrt.store.model import Material

BAD = ["nan", "inf", "-inf", "1e39", "1e999"]
PLAIN = pytest.approx((*Material().color, *Material()[1:]))


def corner(index, form, n):
    """A corner in one of the forms there are."""
    return form.format(index + 1, index - n)


def obj(faces=FACES, vertices=VERTICES, forms=("{0}",), tail=""):
    """A file of vertices, then faces, whose corners take the forms in turn."""
    turn = itertools.cycle(forms)
    n = len(vertices)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.float64(vertices).tolist()]
    lines += ["f " + " ".join(corner(i, next(turn), n) for i in face) for face in faces]
    return "\n".join([*lines, tail]) + "\n"


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.obj"


def cut(patch, size):
    patch.setattr(source_module, "CHUNK_BYTES", size)


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form",
    ["{0}", "+{0}", "{1}", "{0}/7", "{1}/-7", "{0}//9", "{1}//-9", "{0}/7/9", "{1}/7/9", "{0}/"],
)
def test_corners_of_all_forms(file, form):
    file.write_text(obj(forms=[form]))
    store = convert(file)
    assert shapes_of(store) == expected(VERTICES, FACES)
    assert all(stream.wide for stream in store.streams)  # text has no types
    file.write_text(obj(forms=[form, "{0}", "{1}//2"]))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


def test_vertices_of_3_4_6_and_7_numbers(file):
    lines = ["v 1 2 3", "v 4 5 6 0.5", "v 7 8 10 0.1 0.2 0.3", "v 0 0 1 1 0.1 0.2 0.3", "f 1 2 3 4"]
    file.write_text("\n".join(lines))
    vertices = [[1, 2, 3], [4, 5, 6], [7, 8, 10], [0, 0, 1]]
    assert shapes_of(convert(file, polygons=True)) == expected(vertices, [[0, 1, 2, 3]])
    said = failure(file, SettingError, color_by="rgb")
    assert said == "found 2 colors for 4 vertices, expected one for each to color by"


def test_numbers_are_stored_untouched(file):
    vertices = np.ldexp(np.random.default_rng(2).normal(size=(30, 3)), 3)
    file.write_text(obj(np.arange(30).reshape(-1, 3).tolist(), vertices))
    (stream,) = convert(file).streams
    assert stream.path("geometry").read_bytes() == vertices.tobytes()


def test_faces_before_their_vertices(file):
    lines = obj().splitlines()
    file.write_text("\n".join([*lines[6:], *lines[:6]]))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


def test_negative_numbers_count_back_from_where_they_are(file):
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nf -4 -3 -1\nf 1 -1 2\n")
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]
    assert shapes_of(convert(file)) == expected(vertices, [[0, 1, 2], [0, 1, 3], [0, 3, 1]])


def test_polygons_as_triangles(file):
    file.write_text(obj())
    fans = [[f[0], f[i], f[i + 1]] for f in FACES for i in range(1, len(f) - 1)]
    assert shapes_of(convert(file, triangulate=True)) == expected(VERTICES, fans)


DRESSED = (
    "# a comment \\\n"
    "\n"
    "o thing\n  g a b c\n"
    "v 0 0 0 # the first\n"
    "\tv\t1 \\\n 0\\\n .25\n"
    "vt 0 0\nvn 0 0 1\nvp 1\n"
    "v 1 1 0.75\nv 0 1 0.5 #\n#v 1 1 1\n"
    "v 9 9 9\nv 0.5 2 1.125\n"
    "s off\n"
    "f 1 2/1 6//1\n"
    "f \\\n 4/3 \\\n   3/3 2/2 \\\n 1/1 # four\n"
    "l 1 2 3\np 1\n"
    "fo 6 4 1\n"
    "f 1 2 3 6 4"
)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("size", [48, 49, 51, 53, 59, 64, 77, 1 << 20])
def test_comments_blanks_and_lines_that_go_on(file, end, size, monkeypatch, caplog):
    cut(monkeypatch, size)
    file.write_bytes(DRESSED.replace("\n", end).encode())
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)
    assert caplog.messages == []


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("of", ["", "o"])
def test_words_that_a_backslash_follows(file, end, of, caplog):
    (file.parent / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    text = (
        "mtllib\\\n a.mtl\nv\\\n0 0 0\nv\\\n 1 0 0\nvn\\\n0 0 1\ng\\\n x\n"
        "\\\nv 0 1 0\nv 5 5 5\\\n\n"
        f"usemtl\\\na\nf{of}\\\n1 2 3\n\\\n f 1 2 \\\n\\\n4\n\\\n# f 1 2\n"
    )
    file.write_bytes(text.replace("\n", end).encode())
    store = convert(file)
    vertices = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]]
    assert shapes_of(store) == expected(vertices, [[0, 1, 2], [0, 1, 3]])
    assert [each.color for each in objects_of(store)] == [(1, 0, 0)] * 2
    assert caplog.messages == []


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_are_counted_whatever_ends_them(file, end, monkeypatch):
    file.write_bytes((DRESSED + "\n\nf 1 2 x\n").replace("\n", end).encode())
    number = DRESSED.count("\n") + 3
    for size in (48, 53, 61, 1 << 20):
        cut(monkeypatch, size)
        assert failure(file).startswith(f"line {number}: found 'x', expected a vertex's number")


@pytest.mark.parametrize("size", [64, 1 << 20])
@pytest.mark.parametrize("tail", ["", "vn 0 0 1\ng a\np 1 2 3\n"])
def test_vertices_alone_are_points(file, size, tail, monkeypatch):
    cut(monkeypatch, size)
    lines = [f"v {x!r} {y!r} {z!r} {i % 2} 0 1" for i, (x, y, z) in enumerate(VERTICES.tolist())]
    file.write_text("\n".join(lines) + "\n" + tail)
    points = [((*map(float, row), 0.5),) for row in VERTICES]
    for room in (0, 1 << 60):
        small_room(monkeypatch, room)
        store = convert(file, radius=0.5)
        assert shapes_of(store) == points
        assert store.streams[0].wide
        found = objects_of(convert(file, radius=0.5, color_by="rgb"))
        assert [each.color for each in found] == [(0, 0, 1), (1, 0, 1)] * 3
    shutil.rmtree(file.with_suffix(".bfrt"))
    said = failure(file, SettingError)
    assert said.startswith("found points without a radius, expected radius=")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": "h"}, "found radius='h', expected a number"),
        ({"radius": 1, "triangulate": True}, "found triangulate=True, expected none for .obj"),
        ({"radius": 1, "color_by": "rgb"}, "found 0 colors for 6 vertices, expected one for each"),
    ],
)
def test_settings_that_do_not_fit_points(file, asked, words):
    file.write_text(obj(faces=[]))
    assert words in failure(file, SettingError, **asked)


def test_points_that_are_not_finite(file):
    file.write_text("v 0 0 0\nv 1 -1.#IND 0\nv 2 0 0\n")
    assert failure(file, radius=1) == "point 1: found 1 nan 0 1, expected finite numbers"
    assert shapes_of(convert(file, radius=1, skip_invalid=True)) == [
        ((0, 0, 0, 1),), ((2, 0, 0, 1),)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("g a\nvn 0 0 1\n", "found no v and no f, expected vertices and faces"),
        ("mtllib a.mtl\n", "found no v and no f, expected vertices and faces"),
        ("v 0 0 0\nv 1 0 0\nl 1 2\n", "found lines (l) without a face (f), expected faces, or"),
        ("l 1 2\n", "found no v and no f"),
        ("# a\n1 2 3\n4 5 6\n", "line 2: found '1', expected v, f or another statement of OBJ, as"),
        ("v 1 2 3\na\nb\n", "line 2: found 'a', expected v, f or another statement of OBJ, as in 1 "
                             "of 3 lines only"),
        ("v 1 2 3\nf 1 1 1\na b\0\n", "line 3: found 'a' and a NUL byte in the line, expected"),
        ("a\0b\n", r"line 1: found 'a\x00b' and a NUL byte in the line, expected text"),
    ],
)  # fmt: skip
def test_what_is_no_obj(file, text, said):
    file.write_text(text)
    assert failure(file, radius=1).startswith(said)


def test_nuls_in_names_and_comments_are_passed_over(file):
    file.write_text(obj(tail="# \0\no \0 a\nvn \0\n"))
    assert shapes_of(convert(file)) == expected(VERTICES, FACES)


def test_unknown_statements_are_counted(file, caplog, monkeypatch):
    file.write_bytes(obj(tail="cstype bezier\n\xe9\ncurv 1 2\nvx 1\nV 1 2 3\n").encode("latin-1"))
    for joined in ("in memory", "on disk"):
        if joined == "on disk":  # which reads faces twice
            small_room(monkeypatch, 100)
        assert shapes_of(convert(file)) == expected(VERTICES, FACES)
        assert caplog.messages == [f"{file}: 5 lines of unknown statements were passed over"]
        caplog.clear()


@settings(max_examples=80)
@given(
    seed=st.integers(0, 1 << 30),
    size=st.sampled_from([150, 163, 512, 1 << 20]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_round_trip(tmp_path_factory, seed, size, end):
    """Vertices and faces in any order; a face may name what comes later."""
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 12)
    vertices = rng.normal(size=(n, 3))
    faces = [rng.integers(0, n, k).tolist() for k in rng.integers(3, 9, rng.integers(0, 9))]
    lines, before, left = [], 0, list(faces)
    while before < n or left:
        if before < n and (not left or rng.random() < 0.6):
            more = [[], [1.0], [0.5, 0.5, 0.5], [1.0, 0.5, 0.5, 0.5]][rng.integers(4)]
            numbers = [*vertices[before].tolist(), *more]
            lines.append("v " + " ".join(map(repr, numbers)))
            before += 1
        else:
            words = []
            for i in left.pop(0):
                back = i < before and rng.random() < 0.5
                word = str(i - before if back else i + 1)
                words.append(word + ["", "/1", "//1", "/1/1", "/-1/-1"][rng.integers(5)])
            lines.append("f " + ("\\" + end + " " if rng.random() < 0.3 else " ").join(words))
        lines += [["# \\", "vn 0 0 1", "", "g x"][rng.integers(4)]] * int(rng.random() < 0.2)
    file = tmp_path_factory.mktemp("obj") / "a.obj"
    file.write_bytes(end.join(lines).encode())
    with pytest.MonkeyPatch.context() as patch:
        cut(patch, size)
        if faces:
            assert shapes_of(convert(file, polygons=True)) == expected(vertices, faces)
        else:
            points = [((*row, 2.0),) for row in vertices.tolist()]
            assert shapes_of(convert(file, radius=2)) == points


def test_vertices_that_are_not_kept(file, monkeypatch):
    """Few fit in memory twice: the others are read again."""
    file.write_text(obj())
    whole = convert(file).checksum
    small_room(monkeypatch, VERTICES.nbytes * 2)
    assert convert(file).checksum == whole


# --- materials -----------------------------------------------------------------------------------

LIBRARY = """# a library
newmtl red one
Kd 1 0 0
Ka 1 1 1
map_Kd red.png
newmtl glass
  Kd 0.5
  d 0.25 # seen through
  Ni 1.5
  illum 2
  Ks 0.9 0.9 0.9
newmtl\tmirror
Kd 0.1 0.2 0.3
Ks 0.2 0.4 0.3
Ns 50
illum 3
newmtl turned
Tr 0.75
newmtl halo
d -halo 0.5
newmtl spectral
Kd spectral a.rfl
newmtl bare
"""
MATERIALS = {
    "red one": ((1, 0, 0), 1, 0, 1, 0, 1),
    "glass": ((0.5, 0.5, 0.5), 1, 0, 1, 0.75, 1.5),
    "mirror": ((0.1, 0.2, 0.3), 1, 0.4, 50, 0, 1),
    "turned": ((0.8, 0.8, 0.8), 1, 0, 1, 0.75, 1),
    "halo": ((0.8, 0.8, 0.8), 1, 0, 1, 0.5, 1),
    "spectral": ((0.8, 0.8, 0.8), 1, 0, 1, 0, 1),
    "bare": ((0.8, 0.8, 0.8), 1, 0, 1, 0, 1),
}


def dressed(library, names):
    """A file of one triangle a material."""
    lines = ["v 0 0 0", "v 1 0 0", "v 0 1 0", f"mtllib {library}"]
    for name in names:
        lines += [f"usemtl {name}", "f 1 2 3"]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("library", ["a.mtl", "a b  c.mtl", "ä.mtl"])
def test_materials(file, library, end, caplog):
    (file.parent / library).write_bytes(LIBRARY.replace("\n", end).encode())
    file.write_bytes(dressed(library, [*MATERIALS, "glass"]).replace("\n", end).encode())
    found = objects_of(convert(file))
    for each, name in zip(found, [*MATERIALS, "glass"], strict=True):
        color, *rest = MATERIALS[name]
        assert each.material == pytest.approx((*color, *rest))
    assert caplog.messages == []


def test_several_libraries(file, caplog):
    (file.parent / "a.mtl").write_text("newmtl a\nKd 0 0 0\nnewmtl b\nKd 1 1 1\n")
    (file.parent / "b.mtl").write_text("newmtl b\nKd 0.5 0.5 0.5\n")
    (file.parent / "c.mtl").write_text("newmtl c\nKd 1 0 0\n")
    text = dressed("a.mtl b.mtl", "abc") + "mtllib c.mtl\nusemtl c\nf 1 2 3\n"
    file.write_text("f 1 2 3\n" + text)
    found = objects_of(convert(file))
    assert [each.material for each in found][::4] == [PLAIN, ((1, 0, 0, 1, 0, 1, 0, 1))]
    assert [each.color for each in found[1:3]] == [(0, 0, 0), (0.5, 0.5, 0.5)]
    assert found[3].material == PLAIN
    assert caplog.messages == [
        f"{file}: material 'c' is in no library that was found, and is plain"
    ]


@pytest.mark.parametrize("library", ["none.mtl", "no such\\thing/é.mtl", ".", "", "\0"])
def test_a_library_that_is_missing(file, library, caplog):
    file.write_bytes(dressed(library, ["x", "y", "x"]).encode())
    assert [each.material for each in objects_of(convert(file))] == [PLAIN] * 3
    unknown = [f"{file}: material {name!r} is in no library that was found, and is plain"
               for name in "xy"]  # fmt: skip
    assert caplog.messages[-2:] == unknown
    assert len(caplog.messages) == 3 - (not library)
    if library:
        assert caplog.messages[0].startswith(f"{file}: found no library '")


@pytest.mark.parametrize("text", ["Kd 1 0 0", "\x7fELF\0", "<html>"])
def test_a_library_that_is_none(file, text, caplog):
    library = file.parent / "a.mtl"
    library.write_text(text)
    file.write_text(dressed("a.mtl", "a"))
    assert objects_of(convert(file))
    assert (
        caplog.messages[0] == f"{library}: found no newmtl, expected materials that begin with it"
    )


def test_one_of_several_libraries_is_missing(file, caplog):
    (file.parent / "a.mtl").write_text("newmtl a\nKd 0 0 0\n")
    file.write_text(dressed("no.mtl a.mtl", "a"))
    assert [each.color for each in objects_of(convert(file))] == [(0, 0, 0)]
    assert caplog.messages == [f"{file}: found no library 'no.mtl'"]


@pytest.mark.parametrize(
    "change",
    ["Kd 1 0", "Kd a b c", "Kd", "d", "Ni -1", "Ns inf", "Tr nan", "illum x", "Ks 1 1 1e39",
     "d -halo", "Kd 1.#QNAN 0 0", "Kd -1.#IND", "Kd 1_0 0 0"],
)  # fmt: skip
def test_statements_that_are_wrong(file, change, caplog):
    """A mesh is read all the same: what counts is named, and its default taken."""
    library = file.parent / "a.mtl"
    library.write_text(f"newmtl a\n{change} # more\nillum 3\n" * 2)
    file.write_text(dressed("a.mtl", "a"))
    key = change.split()[0]
    if key == "illum":  # what comes later counts
        library.write_text(f"newmtl a\n{change}\n")
    (found,) = objects_of(convert(file))
    assert found.material == PLAIN
    for message in caplog.messages:
        assert message.startswith(f"{library}: line ")
        assert f"found '{change}', expected {key} with " in message
        assert message.endswith(" finite numbers, 0 or more; its default is taken")
    assert len(caplog.messages) == (1 if key == "illum" else 2)


@pytest.mark.parametrize(
    "lines",
    ["illum 2\nNs -1.960784\nKs nan 0 0", "Ns -1\nKs x\nillum 0\nd 1\nTr -1", "Ka -1 x\nPr x",
     "Ks 1 1 1.#INF"],
)  # fmt: skip
def test_statements_that_do_not_count_may_be_anything(file, lines, caplog):
    (file.parent / "a.mtl").write_text(f"newmtl a\nKd 1 0 0\n{lines}\n")
    file.write_text(dressed("a.mtl", "a"))
    (found,) = objects_of(convert(file))
    assert found.material == (1, 0, 0, 1, 0, 1, 0, 1)
    assert caplog.messages == []


@pytest.mark.parametrize("name", ["", " "])
def test_a_material_without_a_name(file, name, caplog):
    (file.parent / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    file.write_text(dressed("a.mtl", "a") + f"usemtl{name}\nf 1 2 3\n")
    first, second = objects_of(convert(file))
    assert first.color == (1, 0, 0)
    assert second.material == PLAIN
    assert caplog.messages == []


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "given",
    [r"sp\ ace.mtl", r"b.mtl sp\ ace.mtl", r"sp\ ace.mtl  b.mtl", "b.mtl \\\n sp\\ ace.mtl",
     "\\\nsp ace.mtl"],
)  # fmt: skip
def test_libraries_whose_names_have_blanks(file, given, end, caplog):
    (file.parent / "sp ace.mtl").write_text("newmtl a\nKd 1 0 0\n")
    (file.parent / "b.mtl").write_text("newmtl b\nKd 0 1 0\n")
    file.write_bytes(dressed(given, "ab" if "b.mtl" in given else "a").replace("\n", end).encode())
    found = objects_of(convert(file))
    assert [each.color for each in found] == [(1, 0, 0), (0, 1, 0)][: len(found)]
    assert caplog.messages == []


def test_materials_over_cuts_and_on_disk(file, monkeypatch):
    (file.parent / "a.mtl").write_text(LIBRARY)
    names = [name for _ in range(20) for name in MATERIALS]
    file.write_text(dressed("a.mtl", names))
    whole = convert(file)
    found = [each.material for each in objects_of(whole)]
    assert found[:7] == [pytest.approx((*c, *rest)) for c, *rest in MATERIALS.values()]
    assert found == found[:7] * 20
    cut(monkeypatch, 40)
    assert convert(file).checksum == whole.checksum
    small_room(monkeypatch, 50)
    assert convert(file).checksum == whole.checksum


def test_colors_of_vertices(file):
    lines = [
        "v 0 0 0 1 0 0",
        "v 1 0 0 1 0 0 1",
        "v 0 1 0 1 0 0",
        "v 1 1 1 0 0 1",
        "f 1 2 3",
        "f 1 2 4",
    ]
    file.write_text("\n".join(lines))
    first, second = objects_of(convert(file, color_by="rgb"))
    assert first.color == (1, 0, 0)
    red = round(31 * 2 / 3) / 31
    blue = round(31 / 3) / 31
    assert second.color == pytest.approx(
        [((c + 0.055) / 1.055) ** 2.4 if c else 0 for c in (red, 0, blue)]
    )


# --- bad files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("v 1 2", "line 11: found the line's end, expected three numbers of a vertex"),
        ("v", "line 11: "),
        ("v 1 2 x", "line 11: found 'x', expected a number"),
        ("v 1 2 3/4", "line 11: found '3/4', expected a number"),
        ("v 1 2 3#", "line 11: found '3#', expected a number"),
        ("v 1 2 1.#", "line 11: found '1.#', expected a number"),
        ("v 1 2 infinite", "line 11: found 'infinite', expected a number"),
        ("f 1 2 3#", "line 11: found '3#', expected a vertex's number"),
        ("f 1 2", "line 11: "),
        ("f", "line 11: "),
        ("f 1 2 0", "line 11: found vertex '0', expected one from 1, or from -1 back"),
        ("f 1 2 -7", "line 11: found vertex '-7', expected one from 1, or from -1 back"),
        ("f 1 2 7", "face 4: found vertex 6, expected 0 to 5"),
        ("f 1 2 1125899906842623", "face 4: found vertex 1125899906842622, expected 0 to 5"),
        ("f 1 2 1125899906842624", "line 11: found vertex '1125899906842624', expected one of"),
        ("f 1 2 99999999999999999999/1", "line 11: found vertex '99999999999999999999/1', ex"),
        ("f 1 2 -99999999999999999999", "line 11: found vertex '-99999999999999999999', expec"),
        ("f 1 2 3.5", "line 11: found '3.5', expected a vertex's number, as 7, -1, 7/1, 7//2 or"),
        ("f 1 2 /3", "line 11: found '/3', expected a vertex's number, as 7, -1, 7/1, 7//2 or"),
        ("f 1 2 -", "line 11: found '-', expected a vertex's number, as 7, -1, 7/1, 7//2 or"),
        ("f 1 2 \xff", r"line 11: found '\\xc3\\xbf', expected a vertex's number"),
        ("f 1 2 " + "1" * 70, "line 11: found '" + "1" * 40 + "'..., expected a vertex's number"),
    ],
)  # fmt: skip
def test_bad_lines(file, line, said):
    file.write_text(obj(tail=line))
    assert failure(file).startswith(said)
    assert "expected" in failure(file)


def test_a_line_without_an_end(file, monkeypatch):
    cut(monkeypatch, 64)
    for line in ("f" + " 1 2 3" * 20, "f" + " 1 2 3 \\\n" * 20, "# " + "x" * 99):
        file.write_text(obj(tail=line))
        assert "found a line or a token of more than 64 bytes, expected shorter ones" in failure(
            file
        )


def test_a_face_of_many_corners(file):
    rng = np.random.default_rng(1)
    face = rng.integers(0, 6, 100_000).tolist()
    file.write_text(obj([face]))
    assert shapes_of(convert(file, polygons=True)) == expected(VERTICES, [face])


@pytest.mark.parametrize("text", ["", "\n", "# nothing\n"])
def test_an_empty_file_is_told(file, text, caplog):
    file.write_text(text)
    assert convert(file).objects == 0
    assert caplog.messages == [f"{file}: no object was found"]


def test_no_vertices(file):
    file.write_text("f 1 2 3\n")
    assert failure(file) == "face 0: found vertex 0, expected none"


def test_a_file_cut_at_any_byte(file):
    (file.parent / "a.mtl").write_text(LIBRARY)
    data = (dressed("a.mtl", ["glass", "mirror"]) + obj(FACES, forms=["{1}/1", "{0}"])).encode()
    for size in range(0, len(data), 2):
        file.write_bytes(data[:size])
        outcome(file)


@pytest.mark.parametrize("bad", BAD)
def test_faces_that_are_not_finite(file, bad, caplog):
    file.write_text(obj([[0, 1, 2], *FACES, [2, 1, 0]]).replace("0.5 2.0 1.125", f"0.5 {bad} 1"))
    said = failure(file)
    assert said.startswith("face 1: found 0 0 0 1 0 0.25 0.5 ")
    assert said.endswith("expected finite coordinates of three corners or more")
    store = convert(file, skip_invalid=True)
    assert shapes_of(store) == expected(VERTICES, [[0, 1, 2], FACES[1], [2, 1, 0]])
    assert caplog.messages == [f"{file}: 3 invalid objects were dropped"]


@pytest.mark.parametrize("bad", ["-1.#IND", "1.#QNAN", "1.#INF00", "-nan(ind)"])
def test_what_printf_writes_of_numbers_that_are_not_finite(file, bad):
    file.write_text(obj([[0, 1, 2], [0, 1, 5]]).replace("0.5 2.0 1.125", f"0.5 2.0 {bad}"))
    assert failure(file).startswith("face 1: found 0 0 0 1 0 0.25 0.5 2 ")
    assert shapes_of(convert(file, skip_invalid=True)) == expected(VERTICES, [[0, 1, 2]])


@pytest.mark.parametrize("few", ["f 1 2", "f 1", "f", "f 1/1 2/2 # 3", "f \\\n 2//1"])
@pytest.mark.parametrize("size", [64, 1 << 20])
def test_faces_of_too_few_corners(file, few, size, monkeypatch, caplog):
    cut(monkeypatch, size)
    file.write_text(f"{few}\n" * 9 + obj([[0, 1, 2], *FACES], tail=few))
    assert failure(file).endswith("found the line's end, expected three corners or more")
    for on_disk in (False, True):
        if on_disk:
            small_room(monkeypatch, 100)
        store = convert(file, skip_invalid=True, polygons=True)
        assert shapes_of(store) == expected(VERTICES, [[0, 1, 2], *FACES])
        assert "10 invalid objects" in caplog.messages[-1]


@settings(max_examples=100)
@given(
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1,
                   max_size=4),
    size=st.sampled_from([48, 1 << 20]),
    of_library=st.booleans(),
    asked=st.sampled_from([{}, {"skip_invalid": True}, {"color_by": "rgb"}]),
)  # fmt: skip
def test_flipped_bytes(tmp_path_factory, flips, size, of_library, asked):
    file = tmp_path_factory.mktemp("obj") / "a.obj"
    library = bytearray(LIBRARY.encode())
    data = bytearray((DRESSED + "\n" + dressed("a.mtl", ["glass", "red one"])).encode())
    flipped = library if of_library else data
    for place, change in flips:
        flipped[int(place * len(flipped))] ^= change
    file.write_bytes(data)
    (file.parent / "a.mtl").write_bytes(library)
    with pytest.MonkeyPatch.context() as patch:
        cut(patch, size)
        outcome(file, **asked)


def test_huge_numbers_of_vertices_take_no_memory(file):
    file.write_text(obj([[0, 1, 1 << 49]]))
    began = time.perf_counter()
    tracemalloc.start()
    try:
        failure(file)
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - began < 2


@pytest.mark.parametrize("name", ["a.obj", "a.mtl"])
def test_a_read_that_is_refused(file, name, monkeypatch):
    (file.parent / "a.mtl").write_text(LIBRARY)
    file.write_text(dressed("a.mtl", ["glass"]))
    read_into = Source.read_into

    def refuse(source, buffer):
        if str(source.name).endswith(name):
            source._file.close()
            source._file = Refusing()
        return read_into(source, buffer)

    monkeypatch.setattr(Source, "read_into", refuse)
    with pytest.raises(StreamError) as caught:
        convert(file)
    assert caught.value.errno == errno.EIO
    assert str(caught.value).startswith(f"{file.parent / name}: reading at byte 0")
    assert sorted(path.name for path in file.parent.iterdir()) == ["a.mtl", "a.obj"]


class Refusing:
    """A file that the system does not read."""

    def readinto(self, buffer):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def seek(self, offset):
        return offset

    def close(self):
        """Nothing is open."""


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": 1}, "found radius=1, expected none for .obj files of this content"),
        ({"positions": "v"}, "found positions='v', expected none"),
        ({"color_by": "z"}, "found color_by='z', expected rgb"),
        ({"color_by": "rgb"}, "found 0 colors for 6 vertices, expected one for each"),
        ({"colormap": "gray"}, "found without color_by"),
    ],
)
def test_settings_that_do_not_fit(file, asked, words):
    file.write_text(obj())
    assert words in failure(file, SettingError, **asked)


def test_a_map_for_the_files_own_colors(file):
    file.write_text("v 0 0 0 1 1 1\n" * 3 + "f 1 2 3\n")
    assert "found rgb with a map" in failure(file, SettingError, color_by="rgb", colormap="gray")
