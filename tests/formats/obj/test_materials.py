"""Materials of an OBJ file, and the libraries that have them."""

from __future__ import annotations

import pytest
from meshes import convert, objects_of, small_room
from obj_files import LIBRARY, PLAIN, cut, dressed

MATERIALS = {
    "red one": ((1, 0, 0), 1, 0, 1, 0, 1),
    "glass": ((0.5, 0.5, 0.5), 1, 0, 1, 0.75, 1.5),
    "mirror": ((0.1, 0.2, 0.3), 1, 0.4, 50, 0, 1),
    "turned": ((0.8, 0.8, 0.8), 1, 0, 1, 0.75, 1),
    "halo": ((0.8, 0.8, 0.8), 1, 0, 1, 0.5, 1),
    "spectral": ((0.8, 0.8, 0.8), 1, 0, 1, 0, 1),
    "bare": ((0.8, 0.8, 0.8), 1, 0, 1, 0, 1),
}


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
