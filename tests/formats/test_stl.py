"""The STL reader: bytes and text, and every kind of broken file."""

from __future__ import annotations

import itertools
import os
import struct

import numpy as np
import pytest
from failing import alone, refuse_reads
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, open_files, outcome, shapes_of

from bfrt.errors import SettingError, ShortReadError
from bfrt.formats import source as source_module
from bfrt.formats import stl as stl_module
from bfrt.formats.source import Source
from bfrt.formats.stl import facets_of

RNG = np.random.default_rng(5)
TRIANGLES = RNG.normal(size=(5, 3, 3)).astype(np.float32)


def binary(triangles=TRIANGLES, header=b"made by a test", count=None):
    """An STL file of bytes."""
    parts = [header.ljust(80, b"\0"), struct.pack("<I", len(triangles) if count is None else count)]
    for triangle in np.asarray(triangles, np.float32):
        parts.append(struct.pack("<12fH", 9, 8, 7, *triangle.reshape(-1).tolist(), 0xFFFF))
    return b"".join(parts)


def text(triangles=TRIANGLES, name="", *, end="\n"):
    """An STL file of text."""
    lines = [f"solid{name}"]
    for triangle in np.asarray(triangles).tolist():
        lines += ["facet normal 0 0.5 -1e-3", "outer loop"]
        lines += [f"  vertex {x!r} {y!r} {z!r}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return end.join([*lines, f"endsolid{name}", ""]).encode()


def expected(triangles):
    return [tuple(map(tuple, triangle)) for triangle in np.float64(triangles).tolist()]


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.stl"


# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [b"", b"solid", b"solid of bytes\n", b" SOLID\0", b"\xff" * 80])
def test_bytes(file, header):
    file.write_bytes(binary(header=header))
    store = convert(file)
    (stream,) = store.streams
    assert stream.path("geometry").read_bytes() == TRIANGLES.tobytes()
    assert not stream.wide


def test_bytes_in_blocks(file, monkeypatch):
    monkeypatch.setattr(stl_module, "FACETS_AT_ONCE", 2)
    file.write_bytes(binary())
    assert shapes_of(convert(file)) == expected(TRIANGLES)


def test_no_facets(file):
    for data in (binary([]), text([]), b"solid", b"solid x y\nendsolid x y"):
        file.write_bytes(data)
        assert convert(file).objects == 0


NAMES = [
    "",
    " a",
    " a cube",
    "\tfacet normal",
    " #1 \xe9\xfc",
    " endsolid",
    " solid solid",
    " '\"\\ ",
]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [48, 1 << 20])
def test_text_with_any_name(file, name, size, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    for end in ("\n", "\r\n", "\r"):
        file.write_bytes(text(name=name, end=end))
        store = convert(file)
        assert shapes_of(store) == expected(TRIANGLES)
        assert all(stream.wide for stream in store.streams)  # text has no types


@pytest.mark.parametrize("size", range(25, 60))
def test_names_over_the_cuts_of_chunks(file, size, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    file.write_bytes(text(name=" of some words: facet endsolid solid # not a comment") * 3)
    assert shapes_of(convert(file)) == expected(TRIANGLES) * 3


def test_words_in_any_case(file):
    for change in (bytes.upper, bytes.title):
        file.write_bytes(change(text(name=" x")))
        assert shapes_of(convert(file)) == expected(TRIANGLES)


@pytest.mark.parametrize("size", [31, 32, 33, 41, 1 << 20])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_words_that_are_parted_and_lines_of_color(file, size, end, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    data = text(name=" x of endfacet", end=end)
    color = f"color 0.5 0.5 0.5{end}".encode()
    for old, new in (
        (b"endloop", b"end loop"),
        (b"endfacet", b"End\tfacet"),
        (b"endsolid", b"end solid"),
        (b"facet normal", color + b"facet normal"),
        (b"outer", color + color + b"outer"),
        (b"endloop", color + b"endloop"),
        (b"endloop", color.upper() + b"END" + end.encode() + b"LOOP"),
    ):
        file.write_bytes(data.replace(old, new) * 2)
        assert shapes_of(convert(file)) == expected(TRIANGLES) * 2


@pytest.mark.parametrize("size", [100, 1 << 20])
def test_text_that_nuls_pad(file, size, monkeypatch, caplog):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    for end in ("\n", "\r\n", "\r"):
        data = text(name=" x", end=end)
        head, mark, body = data.partition(end.encode())
        for padded in (
            data + bytes(90),
            head.ljust(80, b"\0") + mark + body,
            head + bytes(3) + mark + bytes(5) + body + bytes(7),
        ):
            file.write_bytes(padded)
            assert shapes_of(convert(file)) == expected(TRIANGLES)
    assert caplog.messages == []


MSVC = ["1.#INF", "-1.#INF00", "-1.#IND", "1.#QNAN0", "1.#SNAN", "-1.#IND00e+000", "1.#inf000e+000"]


@pytest.mark.parametrize("bad", [*MSVC, "nan(ind)", "-nan(0x8)", "+inf"])
def test_what_printf_writes_of_numbers_that_are_not_finite(file, bad):
    file.write_bytes(text().replace(b"0 0.5 -1e-3", b" ".join([bad.encode()] * 3)))
    assert shapes_of(convert(file)) == expected(TRIANGLES)  # normals are passed over
    triangles = TRIANGLES.astype(np.float64)
    triangles[1, 2, 2] = 777.0
    file.write_bytes(text(triangles).replace(b"777.0", bad.encode()))
    said = failure(file)
    assert said.startswith("triangle 1: found ")
    assert ("inf" if "inf" in bad.lower() else "nan") in said
    assert shapes_of(convert(file, skip_invalid=True)) == expected(TRIANGLES[[0, 2, 3, 4]])


def test_several_solids(file):
    file.write_bytes(text(TRIANGLES[:2], " one") + b"\n\n" + text(TRIANGLES[2:], " two"))
    assert shapes_of(convert(file)) == expected(TRIANGLES)


def test_blanks_and_the_last_line(file):
    data = text(name=" a b")
    head, _, body = data.partition(b"\n")
    words = b"   ".join(body.rpartition(b"endsolid")[0].split())
    for whole in (
        data.rstrip(),
        b" \n\t" + data,
        head + b"\n" + words,
        head + b"\n\n" + words.replace(b"   ", b"\n") + b" endsolid",
    ):
        file.write_bytes(whole)
        assert shapes_of(convert(file)) == expected(TRIANGLES)


@settings(max_examples=50)
@given(
    seed=st.integers(0, 1 << 30),
    n=st.integers(0, 20),
    form=st.sampled_from(["bytes", "text"]),
    size=st.sampled_from([30, 64, 1 << 20]),
)
def test_round_trip(tmp_path_factory, seed, n, form, size):
    rng = np.random.default_rng(seed)
    triangles = np.ldexp(rng.normal(size=(n, 3, 3)), rng.integers(-99, 99, (n, 3, 3)))
    if form == "bytes":
        triangles = triangles.astype(np.float32)
    file = tmp_path_factory.mktemp("stl") / "a.stl"
    file.write_bytes(binary(triangles) if form == "bytes" else text(triangles, " x"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_module, "CHUNK_BYTES", size)
        patch.setattr(stl_module, "FACETS_AT_ONCE", max(size >> 4, 1))
        assert shapes_of(convert(file)) == expected(triangles)


def test_progress_counts_bytes(file):
    file.write_bytes(binary())
    done = []
    convert(file, progress=done.append)
    assert done[-1] == file.stat().st_size


# --- more than 4 GiB -----------------------------------------------------------------------------


@pytest.mark.parametrize("count", [(1 << 32) // 50, (1 << 32) // 50 + 1, (1 << 32) - 1])
def test_more_than_4_gib(file, count):
    """A sparse file of zeros: its first block, for all of it would take minutes."""
    size = 84 + 50 * count
    try:
        with file.open("wb") as made:
            made.write(binary([], count=count))
            made.truncate(size)
    except OSError:
        pytest.skip("no such large files here")
    with Source(file) as source:
        (block,) = itertools.islice(facets_of(source), 1)
        assert block.shape == (stl_module.FACETS_AT_ONCE, 9)
        last = size - 50
        source.seek(last)
        (facet,) = source.blocks(stl_module.FACET, 1, 1)
        assert source.at == size
        assert not facet["vertices"].any()
        with pytest.raises(
            ShortReadError, match=f"asked for 50 bytes at byte {last + 1}, found 49"
        ):
            source.seek(last + 1)
            source.exactly(50)
    os.truncate(file, size - 1)
    assert failure(file) == (
        f"byte 80: found {size - 1} bytes and a count of {count} facets, expected {size} bytes: "
        "the file is truncated or its count is wrong"
    )


# --- bad files -----------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [b"", b"solid", b"solid " + b"x" * 74, b"solid x\n"])
def test_bytes_cut_anywhere(file, header):
    data = binary(TRIANGLES[:2], header)
    for size in (*range(85), *range(85, len(data), 7), len(data) - 1):
        file.write_bytes(data[:size])
        if data[:size].startswith(b"solid") and b"\0" not in data[:size]:
            outcome(file)  # so far it is text
        else:
            said = failure(file)
            assert said.startswith(f"byte 80: found {size} bytes")
            assert "expected" in said


@pytest.mark.parametrize("header", [b"", b"solid", b"solid x\n"])
@pytest.mark.parametrize("count", [6, 1 << 30, (1 << 32) - 1])
def test_counts_that_lie(file, header, count):
    file.write_bytes(binary(header=header, count=count))
    assert failure(file) == (
        f"byte 80: found 334 bytes and a count of {count} facets, expected {84 + 50 * count} "
        "bytes: the file is truncated or its count is wrong"
    )


@pytest.mark.parametrize("header", [b"", b"solid", b"solid x\n"])
@pytest.mark.parametrize(("count", "tail"), [(5, b"\n"), (5, b"x" * 99), (4, b""), (0, b"")])
def test_bytes_behind_the_end(file, header, count, tail, caplog):
    """Facets are as many as the count says, unless that is none."""
    file.write_bytes(binary(header=header, count=count) + tail)
    if not count:
        assert failure(file) == (
            "byte 80: found a count of 0 facets and 250 bytes behind it, expected a count of 5: "
            "it was not written, or this is no STL file"
        )
        return
    assert shapes_of(convert(file)) == expected(TRIANGLES[:count])
    left = len(tail) + 50 * (5 - count)
    assert caplog.messages == [
        f"{file}: {left} bytes behind the last facet were passed over: its count may be wrong"
    ]


def test_a_stray_byte_and_no_facets(file, caplog):
    file.write_bytes(binary([]) + b"\n")
    assert convert(file).objects == 0
    assert "1 bytes behind the last facet" in caplog.messages[0]


@pytest.mark.parametrize("size", [0, 1, 33, 34, 35, 83])
def test_less_than_a_header(file, size):
    file.write_bytes(b"x" * size)
    assert failure(file) == f"byte 80: found {size} bytes, expected an STL file of 84 or more"


BEGUN = [b"endfacet", b"end"]  # of endsolid


def test_text_cut_anywhere(file):
    data = text([[[1, 2, 3]] * 3] * 2, " x")
    for size in range(len(data)):
        file.write_bytes(data[:size])
        left = data[:size].split()
        said = outcome(file)
        if b"endsolid" in left:
            assert said == "2 objects"
        elif size < 5:
            assert "expected an STL file of 84 or more" in said
        elif left[-1] in (b"endfacet", b"solid") or len(left) == 2 or left[-2:] == BEGUN:
            assert said == f"{left.count(b'endfacet')} objects"
        else:
            assert "expected" in said
            assert "found" in said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"facet normal", b"facet norma", "line 2: found 'norma', expected normal"),
        (b"endloop", b"loop", "line 7: found 'loop', expected endloop"),
        (b"endfacet", b"end loop", "line 8: found 'loop', expected facet"),
        (b"endloop", b"end endloop", "line 7: found 'endloop', expected loop"),
        (b"outer", b"end outer", "line 3: found 'end', expected outer"),
        (b"outer", b"# outer", "line 3: found '#', expected outer"),
        (b"vertex 1", b"vertex 1.#", "line 4: found '1.#', expected a number"),
        (b"vertex 1", b"vertex info", "line 4: found 'info', expected a number"),
        (b"vertex 1", b"vertex nano", "line 4: found 'nano', expected a number"),
        (b"outer", b"0.5 outer", "line 3: found '0.5', expected outer"),
        (b"vertex 1", b"vertex one", "line 4: found 'one', expected a number"),
        (b"vertex 1", b"vertex 1_0", "line 4: found '1_0', expected a number"),
        (b"solid\nf", b"solid\nff", "line 2: found 'ffacet', expected solid, facet or endsolid"),
        (b"\nendsolid", b"\nvertex", "line 9: found 'vertex', expected solid, facet or endsolid"),
        (b"\nendsolid", b"\nfacet", "line 10: found the file's end, expected normal"),
        (b"vertex 1", b"\xff\xfe", r"line 4: found '\\xff\\xfe', expected vertex"),
        (b"normal 0", b"normal", "line 3: found 'outer', expected a number"),
    ],
)
def test_words_out_of_place(file, old, new, words):
    file.write_bytes(text([[[1, 2, 3]] * 3]).replace(old, new, 1))
    assert failure(file) == words


def test_text_that_begins_otherwise(file):
    file.write_bytes(text()[5:])
    assert "facets, expected" in failure(file)


def test_a_line_without_an_end(file, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", 64)
    file.write_bytes(text().replace(b"vertex", b"vertex" + b"x" * 99))
    assert "found a line or a token of more than 64 bytes, expected shorter ones" in failure(file)


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "NaN", "-Infinity", "1e39", "1e999"])
@pytest.mark.parametrize("form", ["bytes", "text"])
def test_triangles_that_are_not_finite(file, bad, form, caplog):
    triangles = TRIANGLES.astype(np.float64)
    triangles[3, 1, 2] = triangles[1, 2, 0] = 777.0
    if form == "bytes":
        with np.errstate(over="ignore"):
            triangles[triangles == 777.0] = np.float32(float(bad))
        file.write_bytes(binary(triangles))
    else:
        file.write_bytes(text(triangles).replace(b"777.0", bad.encode()))
    said = failure(file)
    assert said.startswith("triangle 1: found ")
    assert said.endswith("expected finite numbers")
    assert shapes_of(convert(file, skip_invalid=True)) == expected(TRIANGLES[[0, 2, 4]])
    assert caplog.messages == [f"{file}: 2 invalid objects were dropped"]


def test_normals_and_attributes_are_passed_over(file):
    data = text().replace(b"0 0.5 -1e-3", b"nan -inf +INF")
    file.write_bytes(data)
    assert shapes_of(convert(file)) == expected(TRIANGLES)
    data = bytearray(binary())
    for i in range(5):
        data[84 + 50 * i : 96 + 50 * i] = b"\xff" * 12
    file.write_bytes(data)
    assert shapes_of(convert(file)) == expected(TRIANGLES)


@settings(max_examples=100)
@given(
    form=st.sampled_from(["bytes", "solid bytes", "text"]),
    flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1,
                   max_size=4),
    skip=st.booleans(),
)  # fmt: skip
def test_flipped_bytes(tmp_path_factory, form, flips, skip):
    made = {"bytes": binary(), "solid bytes": binary(header=b"solid"), "text": text(name=" x")}
    data = bytearray(made[form])
    for place, change in flips:
        data[int(place * len(data))] ^= change
    file = tmp_path_factory.mktemp("stl") / "a.stl"
    file.write_bytes(data)
    outcome(file, skip_invalid=skip)


@settings(max_examples=50)
@given(
    words=st.lists(
        st.sampled_from([b"solid", b"facet", b"normal", b"outer", b"loop", b"vertex", b"endloop",
                         b"endfacet", b"endsolid", b"0", b"nan", b"\n", b"#", b"\xff"])
    )
)  # fmt: skip
def test_random_words(tmp_path_factory, words):
    file = tmp_path_factory.mktemp("stl") / "a.stl"
    file.write_bytes(b"solid\n" + b" ".join(words))
    outcome(file)


@pytest.mark.parametrize("data", [binary(), text()])
def test_a_read_that_is_refused(file, data, monkeypatch):
    file.write_bytes(data)
    before = open_files()

    def check():
        alone(file)
        assert open_files() == before

    reads = refuse_reads(monkeypatch, file, lambda: convert(file), check)
    assert reads >= 2


@pytest.mark.parametrize(
    "asked",
    [{"radius": 1}, {"triangulate": True}, {"color_by": "x"}, {"color_by": "rgb"},
     {"positions": "x"}, {"colormap": "gray"}, {"color_range": (0, 1)}],
)  # fmt: skip
def test_settings_that_do_not_fit(file, asked):
    file.write_bytes(binary())
    ((name, _),) = asked.items()
    assert f"found {name}=" in failure(file, SettingError, **asked)
