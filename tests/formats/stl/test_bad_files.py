"""STL files that are broken, in every way."""

from __future__ import annotations

import numpy as np
import pytest
from failing import alone, refuse_reads
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, open_files, outcome, shapes_of
from properties import examples
from stl_files import TRIANGLES, binary, expected, text

from bfrt.errors import SettingError
from bfrt.formats import source as source_module


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
    most = ", up to 3.4e+38" if (form, bad) == ("text", "1e39") else ""
    assert said.endswith(f"expected finite numbers{most}")
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


@examples(100)
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


@examples(50)
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
