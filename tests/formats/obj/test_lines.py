"""Lines of an OBJ file in all their forms."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import FACES, VERTICES, convert, expected, failure, objects_of, shapes_of, small_room
from obj_files import DRESSED, cut, obj
from properties import examples

from bfrt.errors import SettingError


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
    (stream,) = convert(file, order="given").streams
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


@examples(80)
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
