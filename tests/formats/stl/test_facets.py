"""What is read of an STL file, of bytes and of text, of any size."""

from __future__ import annotations

import itertools
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, shapes_of
from properties import examples
from stl_files import TRIANGLES, binary, expected, text

from bfrt.errors import ShortReadError
from bfrt.formats import source as source_module
from bfrt.formats import stl as stl_module
from bfrt.formats.source import Source
from bfrt.formats.stl import facets_of

# --- what is read --------------------------------------------------------------------------------


@pytest.mark.parametrize("header", [b"", b"solid", b"solid of bytes\n", b" SOLID\0", b"\xff" * 80])
def test_bytes(file, header):
    file.write_bytes(binary(header=header))
    store = convert(file, order="given")
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


@examples(50)
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
    convert(file, progress=done.append, order="given")
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
