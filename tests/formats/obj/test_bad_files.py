"""OBJ files that are broken, in every way."""

from __future__ import annotations

import errno
import os
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import FACES, VERTICES, convert, expected, failure, outcome, shapes_of, small_room
from obj_files import BAD, DRESSED, LIBRARY, cut, dressed, obj
from properties import examples

from bfrt.errors import SettingError, StreamError
from bfrt.formats.source import Source


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
    most = ", up to 3.4e+38" if bad == "1e39" else ""
    assert said.endswith(f"expected finite coordinates of three corners or more{most}")
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


@examples(100)
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
