"""The range of numbers that a map makes colors of: given, the least and the greatest, or ranks.

A rank is found exactly, and in little memory, however many numbers there are: those of float64 are
in order as whole numbers of 64 bits, whose digits of 16 bits are counted, the first digit of all
numbers, then the next one of those that begin as the one that is looked for. Each digit is a pass;
what has few bits, as float32, needs fewer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SceneError, SettingError
from bfrt.formats.reading import End

#: Yields all numbers, block by block, as often as it is called.
Blocks = Callable[[], Iterable[NDArray[Any]]]

#: Bits of a number, and of a digit.
BITS = 64
DIGIT = 16

SIGN = np.uint64(1 << (BITS - 1))


def ends_of(
    blocks: Blocks, asked: tuple[End, End] | None, name: str, *, log: bool
) -> tuple[float, float]:
    """Return the numbers of a map's ends.

    Parameters
    ----------
    blocks : callable
        All numbers; not called where both ends are given.
    asked : tuple of 2 End, optional
        By default the least and the greatest of all finite numbers.
    name : str
        Of the file, for errors.
    log : bool
        Whether only numbers above 0 count.

    Raises
    ------
    SceneError
        If there are no numbers.
    SettingError
        If the ends are not in order, or not above 0 where they have to be.
    """
    if asked is None:
        return value_range(blocks(), name, log=log)
    ranked = [end.rank for end in asked if end.rank is not None]
    found = iter(numbers_at(blocks, ranked, name, log=log) if ranked else ())
    lo, hi = (end.number if end.rank is None else next(found) for end in asked)
    if not lo <= hi or (log and lo <= 0.0):
        above = ", above 0" if log else ""
        raise SettingError(
            f"color_range: found {lo:g} to {hi:g} in {name}, expected the lesser first{above}"
        )
    return lo, hi


def value_range(
    values: Iterable[NDArray[Any]], name: str, *, log: bool = False
) -> tuple[float, float]:
    """Find the least and the greatest of all finite numbers, or of those above 0.

    Raises
    ------
    SceneError
        If there are none.
    """
    lo, hi = math.inf, -math.inf
    for block in values:
        counted = counting(block, log)
        if len(counted):
            lo, hi = min(lo, float(counted.min())), max(hi, float(counted.max()))
    if lo > hi:
        raise nothing(name, log)
    return lo, hi


def counting(block: NDArray[Any], log: bool) -> NDArray[Any]:
    """Return the numbers that count: those that are finite, or of these those above 0."""
    finite = np.isfinite(block)
    counted: NDArray[Any] = block[finite & (block > 0) if log else finite]
    return counted


def nothing(name: str, log: bool) -> SceneError:
    """Return the error that there is no number."""
    above = " above 0" if log else ""
    return SceneError(f"{name}: found no finite number{above} to color by, expected one or more")


def numbers_at(blocks: Blocks, ranks: list[Fraction], name: str, *, log: bool) -> list[float]:
    """Return the least numbers that are not below so many of all, each rank a part from 0 to 1.

    Raises
    ------
    SceneError
        If there are no numbers.
    """
    keys, places = [0] * len(ranks), [0] * len(ranks)
    for shift in range(BITS - DIGIT, -1, -DIGIT):
        counts, used = digits_of(blocks, keys, shift, log)
        if shift == BITS - DIGIT:
            total = int(counts[0].sum())
            if not total:
                raise nothing(name, log)
            places = [max(0, math.ceil(rank * total) - 1) for rank in ranks]
        for number, key in enumerate(keys):
            ends = np.cumsum(counts[key])
            digit = min(int(np.searchsorted(ends, places[number], "right")), len(ends) - 1)
            places[number] -= int(ends[digit] - counts[key][digit])
            keys[number] = key << DIGIT | digit
        if not used & (1 << shift) - 1:  # all further digits are those of zeros
            return [number_of(key, shift) for key in keys]
    return [number_of(key, 0) for key in keys]


def digits_of(
    blocks: Blocks, keys: list[int], shift: int, log: bool
) -> tuple[dict[int, NDArray[np.int64]], int]:
    """Count, in a pass, the next digits of the numbers that begin as each key.

    Returns
    -------
    counts : dict of int to (2^DIGIT,) int64
    used : int
        The bits that any number has.
    """
    counts = {key: np.zeros(1 << DIGIT, np.int64) for key in keys}
    used, first = 0, shift == BITS - DIGIT
    for block in blocks():
        bits = counting(block, log).astype(np.float64).view(np.uint64)
        used |= int(np.bitwise_or.reduce(bits, initial=np.uint64(0)))
        ordered = np.where(bits & SIGN, ~bits, bits | SIGN)
        begins = None if first else ordered >> np.uint64(shift + DIGIT)
        for key, count in counts.items():
            own = ordered if begins is None else ordered[begins == np.uint64(key)]
            digits = (own >> np.uint64(shift)) & np.uint64((1 << DIGIT) - 1)
            count += np.bincount(digits.astype(np.int64), minlength=1 << DIGIT)
    return counts, used


def number_of(key: int, shift: int) -> float:
    """Return the number whose first digits are a key, and whose other bits are zero."""
    ordered = key << shift
    if not ordered >> BITS - 1:  # a negative number, whose bits are turned
        return float(np.uint64(~(ordered | (1 << shift) - 1) & (1 << BITS) - 1).view(np.float64))
    return float(np.uint64(ordered & (1 << BITS - 1) - 1).view(np.float64))
