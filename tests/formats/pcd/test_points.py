"""PCD in, spheres out: text, bytes and packed columns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, outcome, shapes_of, spheres
from pcd_files import LAYOUTS, XYZ, lzf, pcd, unlzf

from bfrt.conversion.contents import describe_file
from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import linear
from bfrt.formats.pcd import fields as fields_module
from bfrt.formats.pcd._lzf import FEED_BYTES, Unpacker

RNG = np.random.default_rng(5)


def records(count, more=(), seed=1):
    made = np.zeros(count, [*XYZ, *more])
    random = np.random.default_rng(seed)
    for name in made.dtype.names:
        made[name] = random.integers(-900, 900, made[name].shape) / 8
    return made


def places(made):
    return np.stack([made["x"], made["y"], made["z"]], axis=-1)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["<f4", "<f8", "<i2", "<u1", "<i8"])
def test_points_of_every_layout(tmp_path, monkeypatch, layout, kind):
    monkeypatch.setattr(fields_module, "POINTS_AT_ONCE", 7)
    path = tmp_path / "a.pcd"
    made = np.zeros(60, [("normal", "<f4", 3), ("z", kind), ("y", kind), ("m", "<f4"), ("x", kind)])
    for axis in "xyz":
        made[axis] = RNG.integers(0, 100, 60)
    made["m"] = np.arange(60) + 1
    path.write_bytes(pcd(made, layout))
    store = convert(path, radius="m")
    assert shapes_of(store) == spheres(places(made), made["m"])
    assert store.streams[0].wide == (kind in ("<f8", "<i8"))


@given(st.integers(0, 200), st.sampled_from(LAYOUTS), st.integers(1, 70), st.integers(0, 99))
def test_round_trip(tmp_path_factory, count, layout, block, seed):
    path = tmp_path_factory.getbasetemp() / "round.pcd"
    made = records(count, [("m", "<f8")], seed)
    path.write_bytes(pcd(made, layout))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fields_module, "POINTS_AT_ONCE", block)
        assert shapes_of(convert(path, radius=1)) == spheres(places(made), 1)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("kind", ["<f4", "<u4"])
@pytest.mark.parametrize("name", ["rgb", "rgba"])
def test_colors_are_in_the_bits_of_a_number(tmp_path, layout, kind, name):
    path = tmp_path / "a.pcd"
    made = records(3, [(name, kind)])
    bits = np.array([0x00FF0000, 0x0000FF00, 0x000000FF], np.uint32)
    made[name] = bits.view(kind)
    path.write_bytes(pcd(made, layout))
    found = [each.color for each in objects_of(convert(path, radius=1, color_by="rgb"))]
    assert found == [(1, 0, 0), (0, 1, 0), (0, 0, 1)]


def test_numbers_to_color_by(tmp_path):
    path = tmp_path / "a.pcd"
    made = records(4, [("intensity", "<f4")])
    made["intensity"] = [0, 1, 0, 1]
    path.write_bytes(pcd(made, "binary"))
    store = convert(path, radius=1, color_by="intensity", colormap="gray")
    assert [each.color for each in objects_of(store)] == [(0, 0, 0), tuple(linear(np.ones(3)))] * 2
    assert failure(path, SettingError, radius=1, color_by="mass").startswith(
        "found no column 'mass', expected one of x y z intensity"
    )
    assert "expected radius=" in failure(path, SettingError)


# --- LZF -----------------------------------------------------------------------------------------


def unpacked(packed, feeds, takes):
    """What comes when it is fed and taken by pieces of some sizes."""
    unpacker, out, at, n = Unpacker(), bytearray(), 0, 0
    while True:
        buffer = np.empty(takes[n % len(takes)], np.uint8)
        got = unpacker.take(buffer)
        out += buffer[:got].tobytes()
        if not got:
            size = feeds[n % len(feeds)]
            if at >= len(packed):
                return bytes(out), unpacker.failed
            unpacker.feed(packed[at : at + size])
            at += size
        n += 1


SIZES = st.lists(st.integers(1, 300), min_size=1, max_size=5)


@given(st.lists(st.tuples(st.binary(max_size=9), st.integers(1, 400)), max_size=30), SIZES, SIZES)
def test_what_was_packed(pieces, feeds, takes):
    data = b"".join(piece * times for piece, times in pieces)
    packed = lzf(data)
    assert unlzf(packed) == data
    assert unpacked(packed, feeds, takes) == (data, False)


def test_references_as_far_as_they_go():
    far = RNG.integers(0, 256, 8192, dtype=np.uint8).tobytes()
    data = b"".join([far, far, b"\0" * 100_000, far, far[:7] * 30_000])
    packed = lzf(data)
    assert len(packed) < len(data) // 8
    assert unpacked(packed, [FEED_BYTES], [1 << 16]) == (data, False)


@given(st.binary(max_size=300), SIZES, SIZES)
def test_any_bytes_are_unpacked_or_refused(packed, feeds, takes):
    found, failed = unpacked(packed, feeds, takes)
    try:
        assert found == unlzf(packed) and not failed
    except IndexError:
        assert failed or unlzf_starts(packed, found)


def unlzf_starts(packed, found):
    """Whether the bytes are those of the instructions that are whole."""
    for size in range(len(packed), -1, -1):
        try:
            if unlzf(packed[:size]) == found:
                return True
        except IndexError:
            continue
    return False


# --- bad files -----------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_cut_is_refused(tmp_path, layout):
    path = tmp_path / "a.pcd"
    whole = pcd(records(9, [("m", "<f8")]), layout)
    last = whole.rstrip().rfind(b" ") if layout == "ascii" else len(whole)  # digits may be cut
    for size in range(last):
        path.write_bytes(whole[:size])
        said = outcome(path, radius="m", skip_invalid=True)
        # Bytes of a column behind those that are wanted are not needed.
        assert "found" in said or (said == "9 objects" and layout == "binary_compressed")


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (b"POINTS 9", b"POINTS 8", "found WIDTH 9, HEIGHT 1, POINTS 8, expected POINTS, which are"),
        (b"POINTS 9", b"POINTS -9", "line 10: found 'POINTS -9', expected POINTS and a whole"),
        (b"POINTS 9\n", b"", None),
        (b"WIDTH 9", b"WIDTH 99999999999999999999", "line 7: found 'WIDTH 9999"),
        (b"FIELDS x y z", b"FIELDS x y", "found 2 fields, 3 sizes, 3 types and 3 counts, expected"),
        (b"FIELDS x y z", b"FIELDS x y w", "found columns x y w, expected x, y and z"),
        (
            b"COUNT 1 1 1",
            b"COUNT 1 1 0",
            r"found 'z' of type 'F', size '4' and count '0', expected",
        ),
        (b"COUNT 1 1 1", b"COUNT 1 1 5000", "found 'z' of type 'F', size '4' and count '5000'"),
        (b"SIZE 4 4 4", b"SIZE 4 4 3", "found 'z' of type 'F', size '3' and count '1', expected I"),
        (b"TYPE F F F", b"TYPE F F Q", "found 'z' of type 'Q', size '4' and count '1', expected I"),
        (b"DATA binary", b"DATA zip", "line 11: found 'DATA zip', expected DATA and one of ascii"),
        (b"VERSION 0.7", b"HELLO", "line 2: found 'HELLO', expected a line of a PCD header"),
        (b"HEIGHT 1", b"WIDTH 9", "line 8: found 'WIDTH 9', expected WIDTH once"),
        (b"FIELDS x y z\n", b"", "found a PCD header without FIELDS, expected it"),
    ],
)
def test_bad_headers(tmp_path, before, after, said):
    path = tmp_path / "a.pcd"
    whole = pcd(records(9), "binary")
    assert before in whole
    path.write_bytes(whole.replace(before, after, 1))
    if said is None:
        assert len(shapes_of(convert(path, radius=1))) == 9
    else:
        assert failure(path, radius=1).startswith(said)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_wrong_counts_and_what_is_not_finite(tmp_path, layout):
    path = tmp_path / "a.pcd"
    made = records(9)
    whole = pcd(made, layout)
    for count in (10, 10**9, 10**15):
        path.write_bytes(whole.replace(b" 9\n", b" %d\n" % count))
        assert "count" in failure(path, radius=1)
    made["y"][3] = np.nan
    path.write_bytes(pcd(made, layout))
    assert failure(path, radius=1).startswith("point 3: found")
    assert len(shapes_of(convert(path, radius=1, skip_invalid=True))) == 8


@pytest.mark.filterwarnings("error")
def test_text_that_its_type_does_not_hold(tmp_path):
    path = tmp_path / "a.pcd"
    made = records(2)
    made["x"][1] = 7654321
    path.write_bytes(pcd(made, "ascii").replace(b"7654321.0", b"1e300"))
    assert failure(path, radius=1).startswith("point 1: found inf")


def test_packed_columns_that_are_wrong(tmp_path):
    path = tmp_path / "a.pcd"
    whole = pcd(records(9), "binary_compressed", lambda _: b"\x20\xff")
    path.write_bytes(whole)
    assert "found a reference before the first byte, expected more of what LZF" in failure(
        path, SceneError, radius=1
    )
    path.write_bytes(b"no PCD\n")
    assert failure(path, radius=1).startswith("line 1: found 'no PCD', expected a line of a PCD")
    path.write_bytes("# .PCD\nDATA ascii\n".encode("utf-16"))
    assert failure(path, radius=1).startswith("found a PCD header without FIELDS, expected it")


def test_text_in_other_encodings(tmp_path):
    path = tmp_path / "a.pcd"
    made = records(9)
    text = pcd(made, "ascii").decode()
    for encoding in ("utf-8-sig", "utf-16"):
        path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
        assert shapes_of(convert(path, radius=1)) == [
            ((*map(float, row), 1.0),) for row in places(made).astype(float)
        ]
    path.write_bytes(pcd(made, "binary").decode("latin1").encode("utf-16"))
    assert "expected DATA ascii, as the file is UTF-16" in failure(path, radius=1)


# --- as found ------------------------------------------------------------------------------------

XYZ_OF_TWO = "1 2 3\n4 5 6\n"


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "head",
    [
        "COLUMNS x y z\nPOINTS 2\nDATA ascii\n",
        "# [MetaInfo] Viewpoint 0,0,0\nFIELDS x y z\nWIDTH 2\nDATA ascii\n",
        "# DATA of a scan\nFIELDS x y z\nSIZE 4 4 4\nPOINTS 2\nDATA ascii\n",
        "# made of\n# DATA binary\nFIELDS x y z\nTYPE F F F\nPOINTS 2\n  DATA ascii\n",
    ],
)
def test_headers_of_older_and_other_programs(tmp_path, head, end):
    """Fields are float32 where the file does not say, and comments have any words."""
    path = tmp_path / "a.pcd"
    path.write_text((head + XYZ_OF_TWO).replace("\n", end), newline="")
    assert shapes_of(convert(path, radius=1)) == spheres([(1, 2, 3), (4, 5, 6)], 1)


def test_bytes_of_an_older_header(tmp_path):
    path = tmp_path / "a.pcd"
    rows = np.array([[1, 2, 3], [10, 13, 6]], "<f4")
    path.write_bytes(b"FIELDS x y z\nPOINTS 2\nDATA binary\n" + rows.tobytes())
    assert shapes_of(convert(path, radius=1)) == spheres(rows, 1)


def test_fields_of_one_name_are_refused_where_they_are_wanted(tmp_path):
    path = tmp_path / "a.pcd"
    head = "FIELDS {}\nPOINTS 1\nDATA ascii\n1 2 3 4 5\n"
    path.write_text(head.format("x y z m m"))
    assert shapes_of(convert(path, radius=1)) == spheres([(1, 2, 3)], 1)
    assert failure(path, radius="m").startswith("found 2 columns named m, expected one of that")
    path.write_text(head.format("x y z m x"))
    assert failure(path, radius=1).startswith("found 2 columns named x, expected one of that name")


def test_padding_is_no_column(tmp_path):
    path = tmp_path / "a.pcd"
    path.write_text("FIELDS x y z _ m _\nPOINTS 1\nDATA ascii\n1 2 3 7 0.5 9\n")
    assert shapes_of(convert(path, radius="m")) == spheres([(1, 2, 3)], 0.5)
    assert failure(path, SettingError, radius="_").startswith(
        "found no column '_', expected one of x y z m"
    )
    uses = {each["name"]: each["use"] for each in describe_file(str(path))["contents"]}
    assert uses["_"] == "" and "--radius m" in uses["m"]


def test_a_count_that_is_too_large_is_told_as_such(tmp_path):
    path = tmp_path / "a.pcd"
    path.write_text(f"FIELDS x y z\nPOINTS {10**18}\nDATA ascii\n1 2 3\n")
    assert failure(path, radius=1).endswith("POINTS and a whole number of 18 digits or fewer")
