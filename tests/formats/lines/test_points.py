"""Points of text, held against a twin in plain Python."""

from __future__ import annotations

import gzip
import math
import subprocess
import sys
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, shapes_of

import bfrt
from bfrt.errors import SceneError, SettingError
from bfrt.formats import source as source_module
from bfrt.formats.lines.head import read_head
from bfrt.formats.lines.table import LineTable
from bfrt.formats.source import Source

ROWS = [(1.5, -2.0, 3.25, 7.0), (4.0, 5.5, -6.0, 0.5), (0.0, 1e-3, 1e10, 2.0)]


def spheres(path, **asked):
    """The spheres that a file becomes, (n, 4)."""
    shapes = shapes_of(convert(path, order="given", **asked))
    return np.array([shape[0] for shape in shapes]).reshape(-1, 4)


def read(path, names, column_names=None):
    with Source(path) as source:
        table = LineTable(source, read_head(source, column_names))
        found = list(table.columns(names))
    return np.concatenate(found) if found else np.empty((0, len(names)))


def same(found, rows):
    """Bit for bit, with NaN the same as any other NaN."""
    assert np.array_equal(found, np.array(rows, np.float64).reshape(-1, found.shape[1]), True)


def text_of(rows, separator, end):
    return "".join(separator.join(map(repr, row)) + end for row in rows)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("separator", [" ", "\t", ",", ";", "|", ", ", "  ", " ; "])
def test_separators_and_ends(tmp_path, separator, end):
    path = tmp_path / "a.xyz"
    path.write_bytes(text_of(ROWS, separator, end).encode())
    same(read(path, ("x", "y", "z", "intensity")), ROWS)
    path.write_bytes(text_of(ROWS, separator, end).rstrip().encode())
    same(read(path, ("z", "x", "4", "x")), [(z, x, i, x) for x, _, z, i in ROWS])


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("x,y,z,Mass\n", ("x", "y", "z", "mass")),
        ('"Mass","Z","Y","X"\r\n', ("mass", "z", "y", "x")),
        ("# a scan\n#\n\n", ("x", "y", "z", "intensity")),
        ("# x y z mass\n", ("x", "y", "z", "mass")),
        ("//X,Y,Z,Scalar\n", ("x", "y", "z", "scalar")),
        ("\ufeffx,y,z,Größe\n", ("x", "y", "z", "größe")),
        ("3\n", ("x", "y", "z", "intensity")),
        ("# of 3\n3\nx y z w\n", ("x", "y", "z", "w")),
        ("X Y Z W\n", ("x", "y", "z", "w")),
    ],
)
def test_names_of_columns(tmp_path, head, names):
    path = tmp_path / "a.csv"
    for encoding in ("utf-8", "utf-16"):
        if encoding == "utf-16" and head.startswith("\ufeff"):
            continue
        path.write_bytes((head + text_of(ROWS, ",", "\n")).encode(encoding))
        with Source(path) as source:
            assert read_head(source, None).names == names
        same(read(path, names), ROWS)


def test_names_that_are_given(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(text_of(ROWS, " ", "\n"))
    for given_names in ("radius,x,-,y", "radius x - y"):
        assert read(path, ("x", "radius"), given_names).tolist() == [[b, a] for a, b, *_ in ROWS]
    found = spheres(path, column_names="x y z radius")
    assert found.tolist() == [list(row) for row in ROWS]
    with pytest.raises(SettingError, match=r"found 4 columns and 2 names in column_names"):
        spheres(path, column_names="x y")
    with pytest.raises(SceneError, match="found columns x y mass -, expected x, y and z"):
        spheres(path, column_names="x y mass -", radius=1)


def test_comments_blank_lines_and_quotes(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(
        'x,y,z,name,"w, x"\n\n1,2,3,"a, b",4 # behind\n   # a line\n\t\n'
        '"5" , " 6",7,#no comment,8\n'
        "9,10,11,,\n"
    )
    same(read(path, ("x", "y", "z", "w, x")), [(1, 2, 3, 4), (5, 6, 7, 8), (9, 10, 11, math.nan)])


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3 # first\n4 5 6\t# second; a, b\n",
        "1 2 3 # first, with a separator\n4 5 6\n",
        "1\t2\t3 # a comment of blanks\n4\t5\t6\n",
        "1,2,3 # first\n4,5,6\n",
        "1;2;3 # x, y\n4;5;6\n",
        "2 # points\n1 2 3\n4 5 6\n",
        "x y z # meters\n1 2 3\n4 5 6\n",
        "z,y,x # of a station\n3,2,1\n6,5,4\n",
        "Well #,x,y,z\nWell #5,1,2,3\nWell #6,4,5,6\n",
        'x,y,z,name\n1,2,3,"a ""big"", old well"\n4,5,6,"""b"", c"\n',
    ],
)
def test_comments_behind_the_first_lines(tmp_path, text):
    path = tmp_path / "a.txt"
    path.write_text(text)
    same(read(path, ("x", "y", "z")), [(1, 2, 3), (4, 5, 6)])


def test_empty_fields_are_no_numbers(tmp_path):
    for separator in ",;|":
        path = tmp_path / "a.csv"
        path.write_text(text_of([("x", "y", "z", "w")], separator, "\n").replace("'", "")
                        + separator.join(["1", "", "3", ""]) + "\n")  # fmt: skip
        same(read(path, ("x", "y", "z", "w")), [(1, math.nan, 3, math.nan)])
    path = tmp_path / "a.txt"
    path.write_text("x\ty\tz\tw\n1\t2\t3\t4\n\t2\t\t\n")
    same(read(path, ("x", "y", "z", "w")), [(1, 2, 3, 4), (math.nan, 2, math.nan, math.nan)])


NUMBERS = st.one_of(
    st.floats(allow_nan=True).map(repr),
    st.integers(-(10**25), 10**25).map(str),
    st.decimals(allow_nan=False, allow_infinity=False, places=12).map(str).map(lambda t: t[:60]),
    st.sampled_from(["1.", ".5", "-.5E+3", "+7", "1e400", "-1e400", "5e-324", "1.#INF", "nan(x)"]),
)


def twin(field):
    """A number of text, as Python has it."""
    field = field.lower()
    special = {"1.#inf": math.inf, "nan(x)": math.nan}
    return special[field] if field in special else float(field)


@given(
    st.lists(st.tuples(*[NUMBERS] * 4), min_size=1, max_size=40),
    st.sampled_from([" ", "\t", ",", ";", "|", " , ", "   "]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from([64, 200, 1 << 20]),
)
def test_numbers_are_pythons(tmp_path_factory, rows, separator, end, chunk):
    path = tmp_path_factory.getbasetemp() / "numbers.xyz"
    lines = [separator.join(row) + end for row in rows]
    path.write_text("".join(lines), newline="")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_module, "CHUNK_BYTES", max(chunk, *map(len, lines)) + 1)
        same(read(path, ("x", "y", "z", "4")), [[twin(f) for f in row] for row in rows])


def test_colors(tmp_path):
    path = tmp_path / "a.pts"
    rows = [(0, 0, 0, -5, 255, 0, 0), (9, 0, 0, 7, 0, 51, 255)]
    path.write_text("2\n" + text_of(rows, " ", "\n"))
    store = convert(path, radius=1, color_by="rgb")
    first, second = (each.color for each in objects_of(store))
    assert first == (1, 0, 0)
    assert second[0] == 0 and 0.02 < second[1] < 0.05 and second[2] == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found no line of numbers, expected points, one a line"),
        ("# only\n", "found no line of numbers, expected points, one a line"),
        ("1 2\n", "found 2 columns, expected x, y and z, and what belongs to them"),
        ("1 2 3\n4 5\n", "line 2: found 2 columns, expected 3 as before"),
        ("1 2 3\n4 5 6 7\n", "line 2: found 4 columns, expected 3 as before"),
        ("1,2,3\n\n4,5,six\n", "line 3: found 'six', expected the number of z"),
        ("1,2,3\n4,5 5,6\n", "line 2: found '5', expected the number of y"),
        ('1,2,3\n4,"5,6\n', "line 2: found"),
        ("1,5;2;3\n", "line 1: found '1,5', expected the number of x"),
        ("3\n1 2 3\n4 5 6\n", "found 2 rows, expected 3: the file is truncated or its count is"),
        ("1\n1 2 3\n4 5 6\n", "line 3: found '4 5 6' behind 1 rows, expected no more: the count"),
        ("1\n1 2 3\n\n# no\r\n \r4 5\n", "line 6: found '4 5' behind 1 rows, expected no more"),
        ("999999999999999999\n1 2 3\n", "found 1 rows, expected 999999999999999999: the file"),
        ("9999999999999999999\n1 2 3\n", "found 1 columns, expected x, y and z, and what belongs"),
        ("x y z\n1 2 3 4\n", "line 1: found 'x y z' before a row of 4 columns, expected a name"),
        ("a b c\n1 2 3\n", "found columns a b c, expected x, y and z"),
        ("1 2 \0\n", r"line 1: found '1 2 \x00', expected text"),
        ("1 2 3\n1 2 \0\n", r"line 2: found '\x00', expected the number of z"),
        ("2\nof water\nO 1 2 3\n", "line 2: found 'of water' before a row of 4 columns, expected"),
        ("2\nwater\nO 1 2 3\n", "found 1 columns, expected x, y and z, and what belongs to them"),
        ("1 2 3\n1 nan 3\n", "point 1: found 1 nan 3 1, expected finite numbers"),
        ("1 2 3\n1 2 -1e39\n", "point 1: found 1 2 -1e+39 1, expected finite numbers, up to 3"),
        ("1 2 3\n" + "7" * 65 + " 2 3\n", "line 2: found '7777"),
    ],
)
def test_bad_files(tmp_path, text, said):
    path = tmp_path / "a.xyz"
    path.write_text(text)
    assert failure(path, radius=1).startswith(said)
    assert [each.name for each in tmp_path.iterdir()] == ["a.xyz"]


@pytest.mark.parametrize("behind", ["", "\n\n", "# the end", "\n  # a\r\n#b\r\t#", "#\n" * 999])
@pytest.mark.parametrize("size", [64, 1 << 20])
def test_comments_behind_the_rows_that_are_counted(tmp_path, behind, size, monkeypatch):
    monkeypatch.setattr(source_module, "CHUNK_BYTES", size)
    path = tmp_path / "a.pts"
    path.write_bytes(f"1\n1 2 3\n{behind}".encode())
    assert shapes_of(convert(path, radius=1)) == [((1, 2, 3, 1),)]
    path.write_bytes(path.read_bytes() + b"\n7")
    line = 4 + behind.replace("\r\n", "\n").replace("\r", "\n").count("\n")
    assert failure(path, radius=1).startswith(f"line {line}: found '7' behind 1 rows, expected no")


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "a.xyz"
    for data in (
        bytes(range(256)),
        zlib.compress(b"1 2 3\n" * 99),
        b"\xff\xfe1\x002",
        b"\x80" * 99,
    ):
        path.write_bytes(data)
        assert "found" in failure(path, radius=1)


def test_every_cut_is_refused_or_has_fewer_points(tmp_path):
    path = tmp_path / "a.pts"
    whole = ("3\n" + text_of(ROWS, " ", "\n")).encode()
    for size in range(len(whole) - 2):
        path.write_bytes(whole[:size])
        try:
            with bfrt.convert(path, tmp_path / "a.bfrt", radius=1, durable=False) as scene:
                # A digit of the last number is no row less.
                assert scene.objects == len(ROWS) and size > len(whole) - 5
        except SceneError as error:
            assert str(error).startswith(f"{path}: ")


def test_no_points(tmp_path):
    path = tmp_path / "a.csv"
    for text in ("x,y,z\n", "0\n"):
        path.write_text(text)
        assert len(spheres(path, radius=1)) == 0


# --- gzip ----------------------------------------------------------------------------------------


def test_packed_text_is_the_same(tmp_path):
    text = text_of(ROWS * 5000, " ", "\n").encode()
    plain, packed = tmp_path / "a.xyz", tmp_path / "b.XYZ.gz"
    plain.write_bytes(text)
    half = len(text) // 2
    packed.write_bytes(gzip.compress(text[:half]) + gzip.compress(text[half:]) + bytes(7))
    assert np.array_equal(spheres(plain, radius=1), spheres(packed, radius=1))
    packed.write_bytes(gzip.compress(b""))
    assert "found no line of numbers" in failure(packed, radius=1)


def test_broken_packing(tmp_path):
    path = tmp_path / "a.xyz.gz"
    whole = gzip.compress(text_of(ROWS * 9, " ", "\n").encode())
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        said = failure(path, radius=1)
        assert said.startswith("byte ") and "gzip has packed" in said
    for at in range(12, len(whole), 3):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
        assert failure(path, radius=1).startswith("byte ")
    path.write_bytes(whole + b"more")
    assert "expected what gzip has packed" in failure(path, radius=1)
    with pytest.raises(SettingError, match=r"found \.npy that gzip has packed, expected it"):
        bfrt.convert(tmp_path / "a.npy.gz", tmp_path / "a.bfrt")


# --- on the command line -------------------------------------------------------------------------


def test_a_radius_by_spacing_is_told(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text("0 0 0\n0 0.25 0\n0 0.5 0\n")
    command = [sys.executable, "-m", "bfrt", "convert", path, "-o", tmp_path / "a.bfrt"]
    for more, told in ((["--radius", "auto"], "radius 0.25, the median distance of 3"), ([], None)):
        done = subprocess.run(
            [*command, *more], capture_output=True, text=True, check=False, cwd=tmp_path
        )
        if told is None:
            assert done.returncode == 2
            told = "as auto, which takes their spacing: 0.25"
        assert told in done.stderr
    done = subprocess.run(
        [*command, "--radius", "auto", "--quiet"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert (done.returncode, done.stderr) == (0, "")
