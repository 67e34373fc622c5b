"""Numbers of NFF against float(), and words that are none."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from nff_files import failure, number
from properties import examples


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


@examples(500)
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
