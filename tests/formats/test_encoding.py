"""Text readers under every encoding and line end, and given what is no text of their format."""

from __future__ import annotations

import codecs
import io
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, open_files
from properties import examples

from bfrt.errors import BfrtError, SceneError
from bfrt.formats import nff as nff_module
from bfrt.formats import source as source_module
from bfrt.formats.encoding import MARKS, Decoder
from bfrt.formats.nff import read_nff
from bfrt.formats.source import Source

OBJ = """mtllib a.mtl
# a comment, wörds and 頂点
o thing é
v 0 0 0
v 1 0 0.25
v 1 1 \\
 0.5
v -2.5e-1 1 0.1875
usemtl röd
f 1 2 3
usemtl blue
f 4/1 3/2 2/3 1/4
f -1 -2 -3
"""
MTL = "# 頂点\nnewmtl röd\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n"
STL = """solid 頂点 of é
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 1.25 -7e-2
 endloop
endfacet
endsolid 頂点
"""
PLY = """ply
format ascii 1.0
comment 頂点頂点頂点頂点頂点頂点頂点頂点頂点頂点頂点頂点頂点頂点 é
element face 2
property list uchar int vertex_indices
element other 1
property float a
element vertex 4
property float x
property float y
property float z
end_header
3 0 1 2
4 3 2 1 0
0.5
0 0 0
1 0 0.25
1 1 0.5
0 1 0.25
"""
NFF = """# 頂点
v from 4 5 6
at 0 0 0
up 0 0 1
angle 30
resolution 64 48
f 1 0 0 1 0 1 0 1 # é
s 1 2 3 4
p 3
0 0 0
1 0 0
0 1 0
"""
TEXTS = {"a.obj": OBJ, "a.stl": STL, "a.ply": PLY, "a.nff": NFF}
OBJECTS = {"a.obj": 3, "a.stl": 1, "a.ply": 2, "a.nff": 2}
ENDS = ("\n", "\r\n", "\r")


def encoded(text, mark, end="\n"):
    """A text in the encoding of a mark."""
    return mark + text.replace("\n", end).encode(MARKS.get(mark, "utf-8"))


def written(folder, name, mark, end="\n"):
    """A text as a file, with its library beside it in the same encoding."""
    file = folder / name
    file.write_bytes(encoded(TEXTS[name], mark, end))
    (folder / "a.mtl").write_bytes(encoded(MTL, mark, end))
    return file


def cut(patch, size):
    patch.setattr(source_module, "CHUNK_BYTES", size)
    patch.setattr(nff_module, "CHUNK_BYTES", size)


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("mark", [b"", *MARKS])
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("size", [64, 67, 1 << 20])
def test_text_is_the_same_in_any_encoding(tmp_path, name, mark, end, size, monkeypatch, caplog):
    whole = objects_of(convert(written(tmp_path, name, b"")))
    assert len(whole) == OBJECTS[name]
    cut(monkeypatch, size)
    assert objects_of(convert(written(tmp_path, name, mark, end))) == whole
    assert caplog.messages == []


def test_materials_are_found_by_names_in_any_encoding(tmp_path):
    file = written(tmp_path, "a.obj", codecs.BOM_UTF16_BE)
    (tmp_path / "a.mtl").write_bytes(encoded(MTL, codecs.BOM_UTF8))
    colors = [each.color for each in objects_of(convert(file))]
    assert colors == [(1, 0, 0), (0, 0, 1), (0, 0, 1)]


@st.composite
def texts(draw):
    """A small text of one of the formats, of any numbers and names."""
    rng = random.Random(draw(st.integers(0, 1 << 30)))
    name = draw(st.sampled_from(list(TEXTS)))
    words = draw(st.text(st.characters(blacklist_categories=["Cs", "Cc", "Z"]), max_size=9))
    words = words.rstrip("\\")  # before which a line would go on
    n = draw(st.integers(3, 9))
    rows = [" ".join(repr(rng.uniform(-9, 9)) for _ in range(3)) for _ in range(n)]
    faces = [[rng.randrange(n) for _ in range(rng.randint(3, 5))] for _ in range(3)]
    if name == "a.obj":
        lines = [f"# {words}", f"g {words}", *(f"v {row}" for row in rows)]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    elif name == "a.ply":
        head = ["ply", "format ascii 1.0", f"comment {words}", f"element vertex {n}"]
        head += [f"property double {axis}" for axis in "xyz"]
        head += ["element face 3", "property list int int vertex_index", "end_header"]
        lines = [*head, *rows, *(" ".join(map(str, [len(face), *face])) for face in faces)]
    elif name == "a.stl":
        lines = [f"solid {words}"]
        for face in faces:
            lines += ["facet normal 0 0 1", "outer loop"]
            lines += [*(f"vertex {rows[i]}" for i in face[:3]), "endloop", "endfacet"]
    else:
        lines = [f"# {words}", *(f"s {row} 1" for row in rows)]
    return name, "\n".join(lines)


@examples(60)
@given(
    made=texts(),
    mark=st.sampled_from([b"", *MARKS]),
    end=st.sampled_from(ENDS),
    size=st.sampled_from([256, 257, 1 << 20]),
)
def test_any_text_in_any_encoding(tmp_path_factory, made, mark, end, size):
    name, text = made
    file = tmp_path_factory.mktemp("text") / name
    file.write_bytes(encoded(text, b""))
    whole = objects_of(convert(file))
    assert len(whole) >= 3
    file.write_bytes(encoded(text, mark, end))
    with pytest.MonkeyPatch.context() as patch:
        cut(patch, size)
        assert objects_of(convert(file)) == whole


def test_nff_of_a_stream_that_trickles():
    class Trickle(io.BytesIO):
        def read(self, size=-1):
            return super().read(min(size, 1))

    class Spheres:
        """A sink that takes nothing but spheres."""

        def __init__(self):
            self.found = []

        def material(self, material):
            return 0

        def background(self, color):
            """None is asked for."""

        def append(self, kind, records, materials):
            self.found += records.tolist()

    for mark in (b"", *MARKS):
        sink = Spheres()
        read_nff(Trickle(encoded("s 1 2 3 4 # 頂\ns 5 6 7 8", mark)), sink)
        assert sink.found == [[1, 2, 3, 4], [5, 6, 7, 8]]


# --- the decoder ---------------------------------------------------------------------------------


@given(
    text=st.text(),
    mark=st.sampled_from([b"", *MARKS]),
    cuts=st.lists(st.integers(0, 40)),
)
def test_pieces_of_any_size(text, mark, cuts):
    if mark == codecs.BOM_UTF16_LE:
        text = text.lstrip("\0")  # or it would be the mark of UTF-32
    if not mark and text.startswith("\ufeff"):
        text = text.lstrip("\ufeff")
    data, pieces = encoded(text, mark), []
    for size in cuts:
        pieces.append(data[:size])
        data = data[size:]
    decoder = Decoder("a")
    found = [decoder.decode(piece, final=False) for piece in [*pieces, data]]
    found.append(decoder.decode(b"", final=True))
    assert b"".join(found) == text.encode()


@given(data=st.binary(max_size=6))
def test_text_without_a_mark_is_itself(data):
    decoder = Decoder("a")
    try:
        found = decoder.decode(data, final=True)
    except SceneError as error:
        assert data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        assert str(error).startswith("a: byte ")
        return
    assert found == data or data.startswith(tuple(MARKS))


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("size", [64, 1 << 20])
def test_what_is_not_utf_16(tmp_path, name, size, monkeypatch):
    """Half a unit at the end, and half a pair of surrogates anywhere."""
    cut(monkeypatch, size)
    file = tmp_path / name
    whole = written(tmp_path, name, codecs.BOM_UTF16_LE).read_bytes()
    file.write_bytes(whole + b"\x0a")
    said = failure(file)
    assert said == (
        f"byte {len(whole)}: found b'\\n', expected UTF-16, as the byte order mark at its begin "
        "says"
    )
    place = len(whole) // 2 & ~1
    file.write_bytes(whole[:place] + b"\x00\xd8" + whole[place:])
    assert failure(file).startswith(f"byte {place}: found b'\\x00\\xd8', expected UTF-16")


@pytest.mark.parametrize("name", TEXTS)
def test_utf_32_is_not_read(tmp_path, name):
    """Not even as a binary STL whose count is a character, with many bytes behind its facets."""
    file = tmp_path / name
    padded = TEXTS[name].replace("solid", f"solid{' ' * 14}0{' ' * 4000}")
    file.write_bytes(codecs.BOM_UTF32_LE + padded.encode("utf-32-le"))
    assert failure(file) == (
        "byte 0: found the byte order mark of UTF-32, expected that of UTF-8 or UTF-16, or none"
    )


def test_places_are_of_the_text(tmp_path):
    """Of a PLY in UTF-16 elements are found again, whose places are bytes of UTF-8."""
    file = written(tmp_path, "a.ply", codecs.BOM_UTF16_LE)
    with Source(file) as source:
        text = source.head(1 << 20)
        assert text == PLY.encode()
        assert source.head(7) == text[:7]
        assert source.most_text >= len(text)
        for at in (0, 1, 100, len(text) - 1, len(text)):
            parts = [bytes(chunk[1:-1]) for chunk in source.text(at)]
            assert b"".join(parts) == text[at:]


def test_bytes_behind_a_header_with_a_mark(tmp_path):
    head = PLY.partition("3 0 1 2")[0].replace("ascii", "binary_little_endian")
    rows = b"\3" + np.array([0, 1, 2], "<i4").tobytes() + b"\4"
    rows += np.array([3, 2, 1, 0], "<i4").tobytes() + np.arange(13, dtype="<f4").tobytes()
    file = tmp_path / "a.ply"
    file.write_bytes(codecs.BOM_UTF8 + head.encode() + rows)
    first, _ = objects_of(convert(file))
    assert first.shape == ((1, 2, 3), (4, 5, 6), (7, 8, 9))
    file.write_bytes(codecs.BOM_UTF16_LE + head.encode("utf-16-le") + rows)
    assert failure(file) == (
        "line 2: found 'format binary_little_endian 1.0', expected format ascii, as the file is "
        "UTF-16"
    )


# --- what is no text of the format ---------------------------------------------------------------

PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\1\0\0\0\1\0\x08\2\0\0\0\xd3\x10?1"
OTHERS = {
    "png": PNG,
    "zeros": bytes(3000),
    "noise": random.Random(7).randbytes(3000),
    "utf-16 without a mark": OBJ.encode("utf-16-le"),
    "utf-32": codecs.BOM_UTF32_LE + OBJ.encode("utf-32-le"),
    "ply": PLY.encode(),
    "stl": b"made by a test".ljust(80, b"\0") + b"\1\0\0\0" + bytes(50),
    "prose": b"The quick brown fox\njumps over\nthe lazy dog.\n",
    "numbers": b"0 0 0\n1 0 0\n0 1 0\n",
}


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".nff"])
@pytest.mark.parametrize("other", OTHERS)
def test_files_of_another_kind(tmp_path, suffix, other):
    if f".{other}" == suffix:
        return
    file = tmp_path / f"a{suffix}"
    file.write_bytes(OTHERS[other])
    said = failure(file)
    assert "found " in said
    assert "expected " in said


@examples(200)
@given(
    data=st.binary(max_size=300),
    begin=st.sampled_from([b"", b"v ", b"f ", b"# ", b"solid ", b"ply\n", *MARKS]),
    suffix=st.sampled_from([".obj", ".ply", ".stl", ".nff"]),
)
def test_bytes_never_become_an_empty_store_without_a_word(tmp_path_factory, data, begin, suffix):
    file = tmp_path_factory.mktemp("bytes") / f"a{suffix}"
    file.write_bytes(begin + data)
    before, said = open_files(), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "bfrt.conversion.convert.log.warning", lambda *words: said.append(words[0] % words[1:])
        )
        try:
            assert convert(file).objects or said == [f"{file}: no object was found"]
        except BfrtError as error:
            assert str(error).isprintable()
            assert str(file) in str(error)
    assert open_files() == before
