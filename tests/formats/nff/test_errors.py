"""NFF that is refused, the parser's own contract, and anything at all."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from nff_files import ROOT, SCENE, VIEW, failure, outcome
from properties import examples

from bfrt.formats._nff import Entity, Event, Fault, Parser
from bfrt.formats.text import MOST_CORNERS

# --- errors --------------------------------------------------------------------------------------


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


# --- the parser's own contract -------------------------------------------------------------------


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


# --- anything at all -----------------------------------------------------------------------------


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


@examples(300)
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
