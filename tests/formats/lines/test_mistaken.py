"""What is called points of text and is none, or names columns otherwise: told as what it is."""

from __future__ import annotations

import codecs
import gzip

import pytest
from meshes import convert, failure, shapes_of, spheres

from bfrt.conversion.contents import describe_file
from bfrt.errors import SceneError, SettingError

ESRI = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n4 5 6\n"
AS_ESRI = (
    "line 1: found 'ncols 3', with which an Esri grid begins, expected points: plain, not packed "
    "and without a byte order mark, .asc is read as such"
)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.asc", codecs.BOM_UTF8 + ESRI.encode()),
        ("a.asc", ESRI.encode("utf-16")),
        ("a.asc.gz", gzip.compress(ESRI.encode())),
        ("a.txt", ESRI.encode()),
        ("a.xyz", ESRI.replace("\n", "\r").encode()),
    ],
)
def test_esri_grids(tmp_path, name, data):
    path = tmp_path / name
    path.write_bytes(data)
    assert failure(path, radius=1) == AS_ESRI
    with pytest.raises(SceneError, match="an Esri grid begins"):
        describe_file(str(path))


@pytest.mark.parametrize(
    ("text", "kind"),
    [("DSAA\n3 2\n0 1\n0 1\n1 6\n1 2 3\n4 5 6\n", "Surfer"), ("north: 4\nsouth: 0\n", "GRASS")],
)
def test_other_grids(tmp_path, text, kind):
    path = tmp_path / "a.asc"
    path.write_text(text)
    said = failure(path, radius=1)
    assert f"with which a {kind} grid begins, expected points: gdal_translate makes" in said


@pytest.mark.parametrize(
    ("text", "line", "found"),
    [
        ("x;y;z\n1,5;2,5;3,5\n", 2, "1,5"),
        ("x;y;z\n1;-2,5;3\n", 2, "-2,5"),
        ("1,5;2,5;3,5\n4,5;5,5;6,5\n", 1, "1,5"),
        ("1,5\t2,5\t3,5\n", 1, "1,5"),
        ("1,5 2,5 3,5\n4,5 5,5 6,5\n", 1, "1,5"),
        ("1 2,5 3\n", 1, "2,5"),
        ("x y z\n1,5 2,5e1 3,5\n", 2, "1,5"),
        ('"1,5","2,5","3,5"\n', 1, "1,5"),
        ('x,y,z\n"1","2,5","3"\n', 2, "2,5"),
        ("x;y;z\n1;2;3\n4;5;6,25\n", 3, "6,25"),
    ],
)
def test_decimal_commas(tmp_path, text, line, found):
    path = tmp_path / "a.csv"
    path.write_text(text)
    said = failure(path, radius=1)
    assert said.startswith(f"line {line}: found '{found}', expected ")
    assert said.endswith(f"as {found.replace(',', '.')}")


def test_a_decimal_comma_where_it_is_not_wanted(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x;y;z;w\n1;2;3;0,5\n")
    assert shapes_of(convert(path, radius=1)) == spheres([(1, 2, 3)], 1)
    assert failure(path, radius="w") == ("line 2: found '0,5', expected the number of w, as 0.5")


@pytest.mark.parametrize("text", ["1d0 2d0 3d0\n", "'1','2','3'\n", "a b c\n"])
def test_a_line_of_words_alone_is_no_file_of_no_points(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert failure(path, radius=1).startswith("found no line of numbers, expected points")


# --- names ---------------------------------------------------------------------------------------


def test_names_that_come_twice_are_refused_where_they_are_wanted(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,m,M\n1,2,3,0.5,0.25\n")
    assert shapes_of(convert(path, radius=1)) == spheres([(1, 2, 3)], 1)
    assert shapes_of(convert(path, radius="5")) == spheres([(1, 2, 3)], 0.25)
    for name in "mM":
        assert (
            failure(path, radius=name) == f"found 2 columns named {name}, expected one of that name"
        )
    listed = [each["name"] for each in describe_file(str(path))["contents"]]
    assert listed == ["x", "y", "z", "4", "5"]
    path.write_text("x,y,z,X\n1,2,3,4\n")
    assert failure(path, radius=1) == "found 2 columns named x, expected one of that name"
    assert failure(path, SettingError, radius=1, column_names="x,y,z,x") == (
        "found x more than once in column_names, expected names that differ"
    )
    assert shapes_of(convert(path, radius=1, column_names="-,y,z,x")) == spheres([(4, 2, 3)], 1)
    assert shapes_of(convert(path, radius=1, column_names="x,y,-,z")) == spheres([(1, 2, 4)], 1)


def test_columns_without_names_in_the_title(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",x,y,z,\n7,1,2,3,0.5\n")
    listed = [each["name"] for each in describe_file(str(path))["contents"]]
    assert listed == ["1", "x", "y", "z", "5"]
    assert shapes_of(convert(path, radius="5")) == spheres([(1, 2, 3)], 0.5)


def test_names_in_quotes_that_blanks_part(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text('"x" "y" "z"\n1 2 3\n')
    assert shapes_of(convert(path, radius=1)) == spheres([(1, 2, 3)], 1)


def test_names_with_units_and_the_way_out(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x [m],y [m],z [m]\n1,2,3\n")
    assert failure(path, radius=1) == (
        "found columns x [m] y [m] z [m], expected x, y and z, or column_names= (--column-names), "
        "which gives others"
    )
    assert shapes_of(convert(path, radius=1, column_names="x,y,z")) == spheres([(1, 2, 3)], 1)
