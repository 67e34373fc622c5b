"""The NFF reader against a simple tokenizer, float() and every kind of broken file."""

from __future__ import annotations

import errno
import io
import math
import os
import re
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bfrt.errors import SceneError, StreamError
from bfrt.formats._nff import Entity, Event, Fault, Parser
from bfrt.formats.nff import _read, read_nff
from bfrt.formats.text import MOST_CORNERS
from bfrt.records import SCALARS, Kind
from bfrt.store.model import Camera, Light, Material

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("BFRT_SHARED", ROOT.parent / "shared"))

VIEW = b"v\nfrom 4 5 6\nat 0 0 1\nup 0 0 1\nangle 30\nhither 0.5\nresolution 640 480\n"

# One of everything, in odd places: line breaks inside entities, several entities on a line,
# comments behind numbers, all kinds of blanks and line ends.
SCENE = (
    b"# a comment with \xe9\x00 bytes\n"
    b"b .25 0.5 1. #color\n"
    b"v from 4 5 6 at\t0 0 1\r\nresolution +640 480 angle 30 up 0 0 1\n"
    b"s 1 2 3 4\n"
    b"l 1 2 3\nl 1 2 3 0.5 0.25 0\n"
    b"f 1 0.5 0.25 0.75 0.125 10 0.5 1.5\n"
    b"c 0 0 0 1\n0 0 2 .5\n"
    b"c 0 0 0 -1 0 0 2 -.5 s -1e1 +2 3E-1 -0.5\r\n"
    b"p 3\n0 0 0\n1 0 0\n0 1 0\n"
    b"p 4 0 0 0 2 0 0 2 2 0 0 2 0\n"
    b"l 7 8 9\x0b"
    b"f 1 1 1 1 0 1 0 1\n"
    b"p 5\n0 0 1 4 0 1 4 4 1\n# in the midst\n2 1 1 0 4 1\r"
    b"pp 3\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n"
    b"pp 4\n0 0 0 1 0 0  1 0 0 2 0 0  1 1 0 3 0 0  0 1 0 4 0 0\n"
    b"s 9 9 9 9"
)


class Recorder:
    """A sink that keeps a copy of everything, and checks what each call promises."""

    def __init__(self):
        self.cameras = []
        self.lights = []
        self.backgrounds = []
        self.palette = {}
        self.blocks = {kind: [] for kind in Kind}
        self.paints = {kind: [] for kind in Kind}
        self.counts = []
        self.sizes = []

    def camera(self, camera):
        self.cameras.append(camera)

    def light(self, light):
        self.lights.append(light)

    def background(self, color):
        self.backgrounds.append(color)

    def material(self, material):
        return self.palette.setdefault(material, len(self.palette))

    def append(self, kind, records, materials):
        assert kind is not Kind.POLYGON
        assert len(materials) == len(records) > 0
        self.keep(kind, records, materials)

    def append_polygons(self, vertices, counts, materials):
        assert counts.dtype == np.int64
        assert len(counts) == len(materials) > 0
        assert counts.sum() == len(vertices)
        self.counts += counts.tolist()
        self.keep(Kind.POLYGON, vertices, materials)

    def keep(self, kind, records, materials):
        assert records.dtype == np.float64
        assert records.flags.c_contiguous
        assert records.shape[1] == SCALARS[kind]
        assert materials.dtype == np.uint32
        self.sizes.append(len(materials))
        self.blocks[kind] += records.tolist()
        self.paints[kind] += materials.tolist()

    def everything(self):
        """All but how the objects were cut into blocks; repr tells 0.0 from -0.0."""
        parts = self.cameras, self.lights, self.backgrounds, self.palette, self.counts
        return repr((parts, self.blocks, self.paints))


class Trickle(io.RawIOBase):
    """A stream whose reads are shorter than asked for."""

    def __init__(self, data, most):
        self.data = io.BytesIO(data)
        self.most = most

    def read(self, size=-1):
        return self.data.read(min(size, self.most))


def parse(data, chunk_bytes=1 << 20, block_objects=16384):
    sink = Recorder()
    _read(io.BytesIO(data), sink, None, chunk_bytes, block_objects)
    return sink


def failure(data, chunk_bytes=1 << 20):
    """The message of the error, without the name of the stream."""
    with pytest.raises(SceneError) as caught:
        parse(data, chunk_bytes)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("<stream>: ")
    return message.removeprefix("<stream>: ")


def outcome(data, chunk_bytes=1 << 20, block_objects=16384):
    """What a text becomes: a scene, or an error."""
    try:
        return parse(data, chunk_bytes, block_objects).everything()
    except SceneError as error:
        return str(error)


# --- scenes


def test_scene_has_every_entity():
    sink = parse(SCENE)
    assert sink.cameras == [
        Camera((4.0, 5.0, 6.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 30.0, resolution=(640, 480))
    ]
    assert sink.backgrounds == [(0.25, 0.5, 1.0)]
    assert sink.lights == [
        Light((1.0, 2.0, 3.0)),
        Light((1.0, 2.0, 3.0), (0.5, 0.25, 0.0)),
        Light((7.0, 8.0, 9.0)),
    ]
    assert list(sink.palette) == [
        Material(),
        Material((1.0, 0.5, 0.25), 0.75, 0.125, 10.0, 0.5, 1.5),
        Material((1.0, 1.0, 1.0), 1.0, 0.0, 1.0, 0.0, 1.0),
    ]
    assert sink.blocks[Kind.SPHERE] == [[1, 2, 3, 4], [-10, 2, 0.3, -0.5], [9, 9, 9, 9]]
    assert sink.paints[Kind.SPHERE] == [0, 1, 2]
    assert sink.blocks[Kind.CONE] == [[0, 0, 0, 1, 0, 0, 2, 0.5], [0, 0, 0, -1, 0, 0, 2, -0.5]]
    assert sink.paints[Kind.CONE] == [1, 1]
    assert sink.blocks[Kind.TRIANGLE] == [[0, 0, 0, 1, 0, 0, 0, 1, 0]]
    assert sink.paints[Kind.TRIANGLE] == [1]


def test_polygons_of_four_and_more_corners():
    sink = parse(SCENE)
    assert sink.counts == [4, 5]
    assert sink.blocks[Kind.POLYGON] == [
        *([0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]),
        *([0, 0, 1], [4, 0, 1], [4, 4, 1], [2, 1, 1], [0, 4, 1]),
    ]
    assert sink.paints[Kind.POLYGON] == [1, 2]


def test_patch_of_four_becomes_a_fan():
    sink = parse(SCENE)
    assert sink.blocks[Kind.PATCH] == [
        [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1],
        [0, 0, 0, 1, 0, 0, 1, 1, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0],
        [0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0, 0, 3, 0, 0, 4, 0, 0],
    ]
    assert sink.paints[Kind.PATCH] == [2, 2, 2]


def test_hither_is_kept():
    assert parse(VIEW).cameras[0].hither == 0.5


def test_empty_file_is_black_and_has_no_camera():
    for data in (b"", b"\n\n", b"# nothing", b" \r\n#\r\n"):
        sink = parse(data)
        assert sink.cameras == sink.lights == sink.sizes == []
        assert sink.backgrounds == [(0.0, 0.0, 0.0)]


def test_view_and_light_may_end_the_file():
    assert len(parse(b"s 1 1 1 1\n" + VIEW).cameras) == 1
    assert parse(b"l 1 2 3").lights == [Light((1.0, 2.0, 3.0))]
    assert parse(b"l 1 2 3 # 4 5 6\n").lights == [Light((1.0, 2.0, 3.0))]
    assert parse(b"l 1 2 3 .5 +1 0").lights == [Light((1.0, 2.0, 3.0), (0.5, 1.0, 0.0))]


def test_default_material_only_where_needed():
    assert list(parse(b"f 1 1 1 1 1 1 1 1 s 1 1 1 1").palette) == [Material((1.0,) * 3, 1, 1, 1, 1)]
    assert list(parse(b"p 3 0 0 0 1 0 0 0 1 0").palette) == [Material()]


def test_line_ends_do_not_matter():
    plain = SCENE.replace(b"\r", b"\n")
    for end in (b"\r\n", b"\r", b"\r\n\r\n"):
        assert outcome(plain.replace(b"\n", end)) == outcome(plain)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_lines_are_counted_whatever_ends_them(end):
    data = end.join([b"s 1 1 1 1", b"", b"# comment", b"s 1 1", b"", b"1 x", b""])
    for chunk_bytes in (1, 2, 3, 1000):
        assert failure(data, chunk_bytes).startswith("line 6: found 'x'")


@pytest.mark.parametrize("chunk_bytes", range(1, 65))
def test_chunks_may_end_anywhere(chunk_bytes):
    whole = parse(SCENE).everything()
    assert outcome(SCENE, chunk_bytes) == whole
    sink = Recorder()
    _read(Trickle(SCENE, chunk_bytes), sink, None, 1 << 20, 3)
    assert sink.everything() == whole


@pytest.mark.parametrize("block_objects", [1, 2, 3, 7])
def test_blocks_keep_the_order(block_objects):
    lines = []
    for i in range(20):
        lines.append(b"f 0 0 %d 1 0 1 0 1\ns %d 0 0 1\nc %d 0 0 1 0 0 1 1" % (i % 5, i, i))
        corners = b"".join(b" %d %d 0" % (i, j) for j in range(4 + i))
        lines.append(b"p %d%s" % (4 + i, corners))
    text = b"\n".join(lines)
    sink = parse(text, 17, block_objects)
    assert max(sink.sizes) <= block_objects
    assert sink.everything() == parse(text).everything()
    assert [record[0] for record in sink.blocks[Kind.SPHERE]] == list(range(20))
    assert sink.paints[Kind.SPHERE] == [i % 5 for i in range(20)]
    assert sink.counts == list(range(4, 24))


def test_large_polygon():
    corners = np.arange(3 * 100_000).reshape(-1, 3)
    text = b"p 100000\n" + b"\n".join(b"%d %d %d" % tuple(row) for row in corners.tolist())
    sink = parse(text)
    assert sink.counts == [100_000]
    assert np.array_equal(sink.blocks[Kind.POLYGON], corners)


def test_lying_count_takes_no_memory():
    data = b"p %d 0 0 0" % MOST_CORNERS
    failure(data)
    tracemalloc.start()
    try:
        failure(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 24 * MOST_CORNERS / 2


# --- numbers


def number(text):
    """A number as the reader has it."""
    return parse(b"s " + text.encode() + b" 0 0 0").blocks[Kind.SPHERE][0][0]


def assert_like_float(text):
    expected = float(text)
    if math.isinf(expected):
        assert "a finite number" in failure(b"s " + text.encode())
        return
    found = number(text)
    assert found == expected
    assert math.copysign(1, found) == math.copysign(1, expected)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["r", "g", ".17g", ".9e"]))
def test_doubles_survive(x, form):
    assert_like_float(repr(x) if form == "r" else format(x, form))


@settings(max_examples=500)
@given(
    st.from_regex(
        r"[+-]?([0-9]{1,24}\.?[0-9]{0,20}|\.[0-9]{1,24})([eE][+-]?[0-9]{1,3})?", fullmatch=True
    )
)
@example("9007199254740992e22")
@example("9007199254740993")
@example("9007199254740993e-22")
@example("18446744073709551617")
@example("0.00000000000000000000000000001")
@example("-0")
@example("-0.0e-999")
@example("1e-400")
@example("2.2250738585072011e-308")
@example("4.9e-324")
@example("1e22")
@example("1e23")
@example("1e-22")
@example("1e-23")
@example("5.e+00000000000000000000000000000000000000000000000000000000001")
@example("1e-99999999999999999999")
@example("1" + 18 * "0" + "1")
def test_decimals_are_rounded_like_float(text):
    assert_like_float(text)


NO_NUMBERS = """
    + - . -. e5 1e 1e+ 1.5.2 1,5 0x10 1_0 --1 1e5. 1d5 1x nan NaN -nan inf -Infinity 1e999 -1e309
"""


@pytest.mark.parametrize("text", [*NO_NUMBERS.split(), "1" * 20 + "e300"])
def test_not_a_finite_number(text):
    assert failure(b"\ns 1 %s 3 4" % text.encode()) == (
        f"line 2: found {text!r}, expected the center y of s, a finite number"
    )


def test_longest_token_is_a_number():
    text = "0." + 61 * "0" + "1"
    assert len(text) == 64
    assert number(text) == 1e-62


# --- errors

KEYWORDS = "a keyword: v, b, l, f, c, s, p or pp"
NOT_TEXT = "bytes that are not ASCII text"

BAD = [
    # (text, line, found, expected)
    (b"s 1 2 3", 1, "end of file", "the radius of s"),
    (b"s 1 2 3\n\n", 2, "end of file", "the radius of s"),
    (b"s 1 2 3 # 4", 1, "end of file", "the radius of s"),
    (b"s 1 2 3\ns 4", 2, "'s'", "the radius of s, a finite number"),
    (b"s 1 2\n3 4 5", 2, "'5'", KEYWORDS),
    (b"c 0 0 0 1\r\n1 1 1\r\nx", 3, "'x'", "the apex radius of c, a finite number"),
    (b"c 0 0 0 1\n1 1 1 -1", 2, "'-1'", "radii of c that are both negative or both not"),
    (
        b"c 0 0 0 -1e-300 1 1 1 1e-300",
        1,
        "'1e-300'",
        "radii of c that are both negative or both not",
    ),
    (b"q 1 2", 1, "'q'", KEYWORDS),
    (b"ppp 3", 1, "'ppp'", KEYWORDS),
    (b"ss", 1, "'ss'", KEYWORDS),
    (b"S 1 1 1 1", 1, "'S'", KEYWORDS),
    (b"s\x01 1", 1, r"'s\x01'", KEYWORDS),
    (b"hither 1", 1, "'hither'", KEYWORDS),
    (b"l 1 2 3 nan", 1, "'nan'", KEYWORDS),
    (b"l 1 2 3 1", 1, "end of file", "the green of l"),
    (b"l 1 2 3 1 -1 1", 1, "'-1'", "the green of l, 0 or more"),
    (b"b 0 0 -0.5", 1, "'-0.5'", "the blue of b, 0 or more"),
    (b"f -1 0 0 0 0 0 0 0", 1, "'-1'", "the red of f, 0 or more"),
    (b"f 1 0 0 0 0 0 0", 1, "end of file", "the index of refraction of f"),
    (b"p 3 1 2 3 4 x", 1, "'x'", "the y of vertex 2 of p, a finite number"),
    (b"p 5 1 2 3 1 2 3 4 x", 1, "'x'", "the y of vertex 3 of p, a finite number"),
    (b"pp 3\n1 2 3 4 5 6\n1 2 3 4 x", 3, "'x'", "the normal y of vertex 2 of pp, a finite number"),
    (VIEW + VIEW, 8, "a second 'v'", "one view in a file"),
    (b"v from 1 1 1\nfrom 1 1 1", 2, "a second 'from'", "each field of v once"),
    (b"v up 1 1 1 from 0 0 0\nfrm 3", 2, "'frm'", "at and angle and resolution of v"),
    (VIEW.replace(b"at 0 0 1\n", b""), 6, "end of file", "at of v"),
    (b"v\nv", 2, "'v'", "from and at and up and angle and resolution of v"),
    (b"v angle", 1, "end of file", "the degrees of angle"),
    (
        b"v resolution 512.5 512",
        *(1, "'512.5'", "the width of resolution, an integer from 1 to 65535"),
    ),
    (b"v resolution 9 0", 1, "'0'", "the height of resolution, an integer from 1 to 65535"),
    (b"s 1 2 3 4\n\x7fELF\x00 \x01", 2, rf"{NOT_TEXT}, b'\x7fELF\x00'", KEYWORDS),
    (
        b"s 1 2 \x80" + 30 * b"a" + b" 5",
        *(1, rf"{NOT_TEXT}, b'\x80" + 23 * "a" + "'...", "the center z of s"),
    ),
    (
        b"s 1 2 \x80" + 300 * b"a" + b" 5",
        *(1, rf"{NOT_TEXT}, b'\x80" + 23 * "a" + "'...", "the center z of s"),
    ),
    (
        b"s 1 2 " + 65 * b"1" + b" 5",
        *(1, f"a token of more than 64 bytes, '{24 * '1'}'...", "the center z of s"),
    ),
    (5000 * b"a", 1, f"a token of more than 64 bytes, '{24 * 'a'}'...", KEYWORDS),
    *(
        (
            f"{keyword} {count} 1 2 3".encode(),
            *(1, repr(count)),
            f"the number of vertices of {keyword}, an integer from 3 to {MOST_CORNERS}",
        )
        for keyword in ("p", "pp")
        for count in ("2", "0", "-3", "3.0", "3e0", "+", "x", str(MOST_CORNERS + 1), "9" * 24)
    ),
]


@pytest.mark.parametrize(("data", "line", "found", "expected"), BAD)
def test_message(data, line, found, expected):
    for chunk_bytes in (1, 2, 3, 64, 1 << 20):
        message = f"line {line}: found {found}, expected {expected}"
        assert failure(data, chunk_bytes) == message


def test_camera_error_has_a_place():
    data = b"\n" + VIEW.replace(b"angle 30", b"angle 200") + b"s 1 1 1 1"
    message = "line 2: camera: found angle 200, expected 0 < angle < 180"
    assert failure(data) == message
    assert failure(data, 1) == message


# --- sources


def test_path_and_its_name_in_messages(tmp_path):
    good, bad = tmp_path / "good.nff", tmp_path / "bad.nff"
    good.write_bytes(SCENE)
    bad.write_bytes(b"s 1 2 3\n")
    for source in (good, str(good)):
        sink = Recorder()
        read_nff(source, sink)
        assert sink.everything() == parse(SCENE).everything()
    with pytest.raises(SceneError, match=rf"^{re.escape(str(bad))}: line 1: "):
        read_nff(bad, Recorder())
    with bad.open("rb") as stream:
        with pytest.raises(SceneError, match=rf"^{re.escape(str(bad))}: line 1: "):
            read_nff(stream, Recorder())
        assert not stream.closed


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(SCENE)))
    sink = Recorder()
    read_nff("-", sink)
    assert sink.everything() == parse(SCENE).everything()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"s")))
    with pytest.raises(SceneError, match=r"^<stdin>: line 1: found end of file"):
        read_nff("-", Recorder())


def test_progress_counts_bytes():
    seen = []
    _read(io.BytesIO(SCENE), Recorder(), seen.append, 100, 16384)
    assert seen == [*range(100, len(SCENE), 100), len(SCENE)]
    seen.clear()
    read_nff(io.BytesIO(SCENE), Recorder(), progress=seen.append)
    assert seen == [len(SCENE)]


class Broken(io.RawIOBase):
    """A stream that gives one object, and then something else than data."""

    name = "disk.nff"

    def __init__(self, then):
        self.parts = [b"s 1 2 3 4\n", then]

    def read(self, size=-1):
        part = self.parts.pop(0)
        if isinstance(part, OSError):
            raise part
        return part


@pytest.mark.parametrize(
    ("then", "number"),
    [
        (OSError(errno.EIO, "bad sector"), errno.EIO),
        (OSError("no number"), errno.EIO),
        (None, errno.EAGAIN),
    ],
)
def test_refused_read(then, number):
    with pytest.raises(StreamError) as caught:
        read_nff(Broken(then), Recorder())
    assert caught.value.errno == number
    assert (caught.value.path, caught.value.offset) == ("disk.nff", 10)
    assert str(caught.value).startswith("disk.nff: reading at byte 10: ")


def test_missing_file(tmp_path):
    with pytest.raises(StreamError) as caught:
        read_nff(tmp_path / "none.nff", Recorder())
    assert caught.value.errno == errno.ENOENT
    assert str(tmp_path / "none.nff") in str(caught.value)


def test_text_stream_is_refused():
    with pytest.raises(TypeError, match="found a stream of str, expected bytes"):
        read_nff(io.StringIO("s 1 2 3 4"), Recorder())


# --- the parser's own contract


def test_parser_refuses_what_it_has_no_room_for():
    for sizes in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match="must be positive"):
            Parser(*sizes)
    parser = Parser(4, 1)
    with pytest.raises(ValueError, match="a chunk of 5 bytes"):
        parser.feed(b"12345")


def test_stub_has_the_values_of_the_enums():
    stub = (ROOT / "bfrt" / "formats" / "_nff.pyi").read_text()
    classes = re.findall(r"class (\w+)\(enum.IntEnum\):\n((?:    \w+ = \d+\n)+)", stub)
    declared = {
        name: {key: int(value) for key, value in re.findall(r"(\w+) = (\d+)", body)}
        for name, body in classes
    }
    compiled = {e.__name__: {m.name: m.value for m in e} for e in (Event, Fault, Entity)}
    assert declared == compiled


# --- anything at all


@given(st.binary(max_size=200), st.integers(1, 70))
def test_random_bytes(data, chunk_bytes):
    assert outcome(data, chunk_bytes, 1) == outcome(data)


WORDS = [
    *("v", "b", "l", "f", "c", "s", "p", "pp", "from", "at", "up", "angle", "hither"),
    *("resolution", "0", "1", "-1", "2.5", "3", "4", "1e999", "nan", "#", "\n", "\r\n", "p 3"),
]


@given(st.lists(st.sampled_from(WORDS), max_size=60), st.integers(1, 70))
def test_random_words(words, chunk_bytes):
    data = " ".join(words).encode()
    assert outcome(data, chunk_bytes, 2) == outcome(data)


@settings(max_examples=300)
@given(
    st.lists(
        st.tuples(st.integers(0, len(SCENE)), st.integers(0, 8), st.binary(max_size=8)),
        min_size=1,
        max_size=4,
    ),
    st.integers(1, 70),
)
def test_damaged_scenes(edits, chunk_bytes):
    data = SCENE
    for place, removed, added in edits:
        data = data[:place] + added + data[place + removed :]
    assert outcome(data, chunk_bytes, 1) == outcome(data)


# --- the standard scenes


def scenes():
    missing = pytest.mark.skip(reason=f"no NFF scenes in {SHARED / 'spd'}")
    return sorted((SHARED / "spd").glob("*.nff")) or [pytest.param(None, marks=missing)]


def plain_entities(text):
    """An independent tokenizer: every entity as (keyword, its words)."""
    words = re.sub(r"#.*", "", text).split()
    starts = [i for i, word in enumerate(words) if word in {*"vblfcsp", "pp"}]
    return [
        (words[start], words[start + 1 : stop])
        for start, stop in zip(starts, [*starts[1:], len(words)], strict=True)
    ]


def plain_read(text):
    """(objects of each kind, vertex counts of polygons, materials, keywords) by float()."""
    objects = {kind: [] for kind in Kind}
    counts, materials, keywords = [], set(), []
    for keyword, words in plain_entities(text):
        keywords.append(keyword)
        if keyword == "f":
            materials.add(tuple(map(float, words)))
        elif keyword == "pp":
            assert words[0] == "3"
            rows = np.array(words[1:], dtype=float).reshape(3, 6)
            objects[Kind.PATCH].append([*rows[:, :3].ravel(), *rows[:, 3:].ravel()])
        elif keyword == "p" and words[0] != "3":
            counts.append(int(words[0]))
            objects[Kind.POLYGON] += np.array(words[1:], dtype=float).reshape(-1, 3).tolist()
        elif keyword == "p":
            objects[Kind.TRIANGLE].append([float(word) for word in words[1:]])
        elif keyword in ("s", "c"):
            kind = Kind.SPHERE if keyword == "s" else Kind.CONE
            objects[kind].append([float(word) for word in words])
    return objects, counts, materials, keywords


@pytest.mark.parametrize("path", scenes(), ids=lambda path: path.stem if path else "none")
def test_standard_scene(path):
    sink = Recorder()
    read_nff(path, sink)
    objects, counts, materials, keywords = plain_read(path.read_text())
    assert sink.blocks == objects
    assert sink.counts == counts
    assert {(*material.color, *material[1:]) for material in sink.palette} == materials
    assert len(sink.lights) == keywords.count("l")
    assert len(sink.cameras) == keywords.count("v") == 1
    assert len(sink.backgrounds) == keywords.count("b") == 1
