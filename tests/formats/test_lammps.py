"""Dumps of LAMMPS: frames, boxes, scaled coordinates, radii by type."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, outcome, shades, shapes_of

from bfrt.errors import SettingError
from bfrt.formats import source as source_module

BOX = "ITEM: BOX BOUNDS pp pp pp\n0 10\n-5 15\n1 3\n"
TILTED = "ITEM: BOX BOUNDS xy xz yz pp pp pp\n-1 13 3\n0 10 -1\n0 8 2\n"
GENERAL = "ITEM: BOX BOUNDS abc origin\n4 1 0 1\n0 5 1 2\n1 0 6 3\n"


def frame(rows, names="id type x y z", box=BOX, step=0, count=None):
    lines = "".join(" ".join(map(repr, row)) + "\n" for row in rows)
    return (
        f"ITEM: UNITS\nmetal\nITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n"
        f"{len(rows) if count is None else count}\n{box}ITEM: ATOMS {names}\n{lines}"
    ).replace("ITEM: UNITS\nmetal\n", "", 1)


def rows_of(count, seed=0):
    random = np.random.default_rng(seed)
    return [(k + 1, k % 3 + 1, *row) for k, row in enumerate(random.random((count, 3)).tolist())]


def centers(path, **asked):
    shapes = shapes_of(convert(path, order="given", **{"radius": 1, **asked}))
    return np.array([shape[0][:3] for shape in shapes]).reshape(-1, 3)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("suffix", ["lammpstrj", "dump"])
def test_frames(tmp_path, suffix, end):
    path = tmp_path / f"a.{suffix}"
    frames = [rows_of(n, n) for n in (3, 7, 0, 5)]
    text = "".join(frame(rows, step=k * 100) for k, rows in enumerate(frames))
    path.write_bytes(text.replace("\n", end).encode())
    for wanted in (None, 0, 1, 2, 3, -1, -2, -4):
        rows = frames[-1 if wanted is None else wanted]
        assert centers(path, frame=wanted).tolist() == [list(row[2:]) for row in rows]
    for wanted in (4, -5, 10**12):
        said = failure(path, SettingError, radius=1, frame=wanted)
        assert said.startswith(f"found frame={wanted}, expected one of 4, 0 to 3 or -4 to -1")
    with pytest.raises(SettingError, match=r"^frame: found 1.5, expected a whole number"):
        convert(path, radius=1, frame=1.5)


@given(
    st.lists(st.integers(0, 20), min_size=1, max_size=6),
    st.integers(-6, 5),
    st.sampled_from([130, 300, 1 << 20]),
    st.sampled_from(["\n", "\r\n", "\r"]),
)
@settings(max_examples=30)
def test_frames_in_any_chunks(tmp_path_factory, counts, wanted, chunk, end):
    path = tmp_path_factory.getbasetemp() / "frames.dump"
    frames = [rows_of(n, k) for k, n in enumerate(counts)]
    path.write_text("".join(map(frame, frames)), newline=end)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source_module, "CHUNK_BYTES", chunk)
        if -len(counts) <= wanted < len(counts):
            found = centers(path, frame=wanted).tolist()
            assert found == [list(row[2:]) for row in frames[wanted]]
        else:
            failure(path, SettingError, radius=1, frame=wanted)


@pytest.mark.parametrize("names", ["xs ys zs", "xsu ysu zsu"])
@pytest.mark.parametrize(
    ("box", "origin", "edges"),
    [
        (BOX, (0, -5, 1), ((10, 0, 0), (0, 20, 0), (0, 0, 2))),
        # xy 3, xz -1, yz 2: the bounds are those of the box around.
        (TILTED, (0, 0, 0), ((10, 0, 0), (3, 8, 0), (-1, 2, 8))),
        (GENERAL, (1, 2, 3), ((4, 1, 0), (0, 5, 1), (1, 0, 6))),
    ],
)
def test_scaled_coordinates(tmp_path, names, box, origin, edges):
    path = tmp_path / "a.dump"
    places = [*np.eye(3).tolist(), [0, 0, 0], [0.5] * 3]
    rows = [(k, 1, *place) for k, place in enumerate(places)]
    path.write_text(frame(rows, f"id type {names}", box))
    twin = [np.array(origin) + np.array(row[2:]) @ np.array(edges) for row in rows]
    assert np.allclose(centers(path), twin, rtol=0, atol=1e-12)


def test_coordinates_as_they_are(tmp_path):
    """Wrapped ones stay in the box, unwrapped ones where they went; plain before scaled."""
    path = tmp_path / "a.dump"
    rows = [(1, 0.5, 0.25, 0.125, 3, 4, 5, 1, -1, 0)]
    path.write_text(frame(rows, "id xs ys zs x y z ix iy iz"))
    assert centers(path).tolist() == [[3, 4, 5]]
    path.write_text(frame([(1, 23, -4, 5)], "id xu yu zu"))
    assert centers(path).tolist() == [[23, -4, 5]]


def test_radii_and_colors(tmp_path):
    path = tmp_path / "a.dump"
    rows = [(*row, row[0] / 4, 1 - row[0] / 8) for row in rows_of(6)]
    path.write_text(frame(rows, "id type x y z radius c_PE[1]"))
    shapes = shapes_of(convert(path, radius="1=0.5,2=1,3=2", order="given"))
    assert [shape[0][3] for shape in shapes] == [0.5, 1, 2] * 2
    assert [shape[0][3] for shape in shapes_of(convert(path))] == [row[5] for row in rows]
    found = shades(convert(path, color_by="c_PE[1]", colormap="gray"))
    assert found == sorted(found, reverse=True) and found[0] == 1
    assert {each.color[0] for each in objects_of(convert(path, color_by="type"))} != {0.8}
    said = failure(path, SettingError, radius="1=0.5,2=1")
    assert said.startswith("found a point of type 3, expected its radius too in radius=")
    with pytest.raises(SettingError, match=r"found -1\.0, expected a finite number above 0"):
        convert(path, radius="1=0.5,2=-1")


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("ITEM: TIMESTEP", "ITEM: STEP", "found no line ITEM: TIMESTEP, expected a dump of LAMMPS"),
        ("ATOMS\n2", "ATOMS\n3", "found 2 rows, expected 3: the file is truncated or its count"),
        ("ATOMS\n2", "ATOMS\n1", "line 11: found '2 2 "),
        ("ATOMS\n2", "ATOMS\n-2", "line 4: found '-2', expected the number of atoms"),
        ("ATOMS\n2", "ATOMS\n9999999999999999", "found 2 rows, expected 9999999999999999"),
        ("0 10\n", "0 ten\n", "line 6: found '0 ten', expected two bounds of the box"),
        ("0 10\n", "0 nan\n", "line 6: found '0 nan', expected two bounds of the box"),
        ("0 10\n", "0 1_0\n", "line 6: found '0 1_0', expected two bounds of the box"),
        ("0 10\n", "10 0\n", "line 6: found '10 0', expected two bounds of the box, the lesser"),
        ("0 10\n", "", "line 8: found 'ITEM: ATOMS id type x y z', expected two bounds"),
        (" x y z", " x y w", "found columns id type x y w, expected x, y and z"),
        (" x y z", " x y z y", "found 2 columns named y, expected one of that name"),
        (" x y z", "", "line 9: found 'ITEM: ATOMS id type', expected ITEM: NUMBER OF ATOMS and"),
        ("ITEM: NUMBER OF ATOMS\n2\n", "", "line 7: found 'ITEM: ATOMS id type x y z', expected"),
        ("ITEM: ATOMS", "ATOMS", "line 9: found 'ATOMS id type x y z', expected ITEM: and what"),
        ("\n2 2", "\n2 2 2", "line 11: found 6 columns, expected 5 as before"),
    ],
)
def test_bad_dumps(tmp_path, before, after, said):
    path = tmp_path / "a.dump"
    text = frame(rows_of(2))
    assert before in text
    path.write_text(text.replace(before, after, 1))
    assert failure(path, radius=1).startswith(said)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_are_counted_whatever_ends_them(tmp_path, end):
    path = tmp_path / "a.dump"
    text = frame(rows_of(3)) + frame(rows_of(2)).replace("ITEM: ATOMS", "ATOMS")
    path.write_text(text, newline=end)
    assert failure(path, radius=1).startswith("line 21: found 'ATOMS id type x y z', expected")


def test_every_cut_is_refused(tmp_path):
    path = tmp_path / "a.dump"
    whole = frame(rows_of(4)).encode()
    for size in range(whole.rstrip().rfind(b" ")):
        path.write_bytes(whole[:size])
        assert "found" in outcome(path, radius=1, skip_invalid=True)
