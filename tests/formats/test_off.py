"""OFF and COFF in, triangles, polygons or points out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
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
    spheres,
)

from bfrt.errors import SettingError
from bfrt.formats import source as source_module
from bfrt.formats.colors import linear

RNG = np.random.default_rng(6)


def off(vertices=VERTICES, faces=FACES, word="OFF", more=None, colors=None, counts=None):
    """The text of a file: numbers behind each vertex, and behind each face."""
    v, f = counts or (len(vertices), len(faces))
    lines = [word, f"{v} {f} 0"]
    for k, row in enumerate(np.asarray(vertices).tolist()):
        lines.append(" ".join(map(repr, [*row, *(() if more is None else more[k])])))
    for k, face in enumerate(faces):
        lines.append(" ".join(map(str, [len(face), *face, *(() if colors is None else colors[k])])))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_mesh(tmp_path, end):
    path = tmp_path / "a.off"
    text = off().replace("\n6 4 0\n", " # a mesh\n\n# counts\n6 4 0 # of it\n\n", 1)
    path.write_text(text, newline=end)
    assert shapes_of(convert(path, order="given")) == expected(VERTICES, FACES)
    path.write_text(off().replace("OFF\n6", "OFF 6"), encoding="utf-16")
    assert shapes_of(convert(path, order="given")) == expected(VERTICES, FACES)


@given(
    st.integers(3, 40).flatmap(
        lambda v: st.tuples(
            st.just(v), st.lists(st.lists(st.integers(0, v - 1), min_size=3, max_size=3))
        )
    ),
    st.sampled_from([80, 1 << 20]),
    st.sampled_from([1 << 27, 100]),
    st.integers(0, 30),
)
def test_round_trip(tmp_path_factory, made, chunk, room, seed):
    count, faces = made
    path = tmp_path_factory.getbasetemp() / "round.off"
    vertices = np.random.default_rng(seed).random((count, 3)) * 10.0**seed
    path.write_text(off(vertices, faces))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_module, "CHUNK_BYTES", chunk)
        patch.setattr("bfrt.conversion.writing.rooms_for", lambda needs, _: [room] * len(needs))
        found = shapes_of(convert(path, order="given", radius=None if faces else 1))
    assert found == (expected(vertices, faces) if faces else spheres(vertices, 1))


@pytest.mark.parametrize("full", [1, 255])
@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("word", ["COFF", "CNOFF"])
def test_colors_of_vertices(tmp_path, word, alpha, full):
    path = tmp_path / "a.off"
    more = [([1] * 3 if "N" in word else []) + [full, 0, full] + [full] * alpha] * 6
    path.write_text(off(word=word, more=more, colors=[[0, 0, 0]] * 4))
    assert {each.color for each in objects_of(convert(path, color_by="rgb"))} == {(1, 0, 1)}
    path.write_text(off(word=word, faces=[], more=more))
    points = objects_of(convert(path, color_by="rgb", radius=1))
    assert {each.color for each in points} == {(1, 0, 1)} and len(points) == 6


NORMAL, COLOR, TEXTURE = (0.0, 0.0, 1.0), (255, 0, 255, 255), (0.25, 0.75)


@pytest.mark.parametrize(
    ("word", "behind"),
    [
        ("STOFF", TEXTURE),
        ("STNOFF", (*NORMAL, *TEXTURE)),
        ("STCOFF", (*COLOR, *TEXTURE)),
        ("STCNOFF", (*NORMAL, *COLOR, *TEXTURE)),
        ("NCOFF", (*COLOR, *NORMAL)),
        ("NCSTOFF", (*COLOR, *NORMAL, *TEXTURE)),
        ("CSTOFF", (*COLOR, *TEXTURE)),
        ("NSTOFF", (*NORMAL, *TEXTURE)),
    ],
)
def test_what_a_vertex_has_behind_its_place(tmp_path, word, behind):
    """As Geomview says it, and as MeshLab writes it, with colors before normals."""
    path = tmp_path / "a.off"
    path.write_text(off(word=word, more=[behind] * 6))
    assert shapes_of(convert(path, order="given")) == expected(VERTICES, FACES)
    if "C" in word:
        assert {each.color for each in objects_of(convert(path, color_by="rgb"))} == {(1, 0, 1)}


@pytest.mark.parametrize("scale", [1, 255])
def test_colors_of_faces(tmp_path, scale):
    path = tmp_path / "a.off"
    colors = (np.eye(4)[:, :3] * scale).astype(int).tolist()
    path.write_text(off(colors=colors))
    found = {each.shape: each.color for each in objects_of(convert(path, color_by="rgb"))}
    for face, color in zip(FACES, colors, strict=True):
        shape = tuple(tuple(row) for row in VERTICES[face].astype(float).tolist())
        assert found[shape] == tuple(linear(np.array(color) / scale))
    path.write_text(off(colors=[[7]] * 4))  # of a table of its own
    assert len(shapes_of(convert(path))) == 4
    said = "found a face without a color, expected one for each to color by"
    assert failure(path, SettingError, color_by="rgb") == said
    assert failure(path, SettingError, color_by="mass") == "found color_by='mass', expected rgb"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found no counts, expected OFF and the numbers of vertices"),
        ("solid\n", "line 1: found 'solid', expected OFF or COFF"),
        ("4OFF\n", "line 1: found '4OFF', expected OFF of three coordinates, without 4 or n"),
        ("OFF BINARY\n", "line 1: found 'OFF BINARY', expected OFF of text"),
        ("OFF\nBINARY\n", "line 2: found 'BINARY', expected OFF of text"),
        ("COOFF\n", "line 1: found 'COOFF', expected OFF or COFF"),
        ("OFF\n3 x 0\n", "line 2: found '3 x 0', expected the numbers of vertices, faces and"),
        ("OFF\n-3 1 0\n", "line 2: found '-3 1 0', expected the numbers of vertices, faces and"),
        (off(counts=(10**9, 4)), "found 1"),
        (off(counts=(7, 4)), "line 9: found 4 numbers of a vertex, expected 3 as before"),
        (off(counts=(6, 9)), "found the file's end behind 4 faces, expected 9: the file is"),
        (off(faces=[[0, 1, 6]]), "face 0: found vertex 6, expected 0 to 5"),
        (off(faces=[[0, 1, -1]]), "face 0: found vertex -1, expected 0 to 5"),
        (off(faces=[[0, 1, 2.5]]), "line 9: found 2.5, expected a vertex's number"),
        (off(faces=[[0, 1]]), "face 0: found"),
        (off(faces=[]).replace("6 0 0", "6 1 0") + "4 0 1 2\n", "line 9: found 4 and 3 numbers,"),
        (off(faces=[]).replace("6 0 0", "6 1 0") + "1e99 0\n", "line 9: found 1e+99 and 1 number"),
        (off(faces=[]).replace("6 0 0", "6 1 0") + "nan 0\n", "line 9: found nan and 1 numbers"),
        (off().replace("9.0", "nine"), "line 7: found 'nine', expected a number"),
        (off(np.ones((3, 2)), []), "line 3: found 2 numbers of a vertex, expected three or more"),
        (off(VERTICES * np.nan), "face 0: found nan nan nan"),
    ],
)
def test_bad_files(tmp_path, text, said):
    path = tmp_path / "a.off"
    path.write_text(text)
    assert failure(path, radius=1 if " 0 0\n" in text else None).startswith(said)


def test_what_is_behind_the_last_face(tmp_path, caplog):
    path = tmp_path / "a.off"
    path.write_text(off(counts=(6, 3)))
    assert len(shapes_of(convert(path))) == 3
    assert "bytes behind the last face were passed over: its count may be wrong" in caplog.text


def test_every_cut_is_refused(tmp_path):
    path = tmp_path / "a.off"
    whole = off()
    for size in range(len(whole) - 2):
        path.write_text(whole[:size])
        assert "found" in outcome(path, radius=1)
