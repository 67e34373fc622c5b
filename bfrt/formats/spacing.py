"""The spacing of points: the median distance to the nearest neighbor, on a sample of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.formats._nearest import meet
from bfrt.formats.object_writer import finite

#: Points of the sample: with so few the median is good to a tenth, as a radius need not be better.
SAMPLE = 256

#: The sample is the same in each run.
SEED = 20010405

Blocks = Callable[[], Iterator[NDArray[Any]]]


class Spacing(NamedTuple):
    """Tells the spacing of points.

    Attributes
    ----------
    distance : float
        The median distance of a point to the nearest that is elsewhere; 0 if none is.
    sample : int
        Points that it is the median of.
    """

    distance: float
    sample: int


def spacing_of(blocks: Blocks) -> Spacing:
    """Find the spacing of points by two passes over them.

    Parameters
    ----------
    blocks : callable
        Yields the centers of all, (n, 3), block by block; those that are not finite do not count.
    """
    sample = sample_of(blocks)
    if not len(sample):
        return Spacing(0.0, 0)
    # Beside the first, so that what map coordinates have in common is no part of the squares.
    origin = sample[0].copy()
    scale = float(np.abs(sample - origin).max()) or 1.0
    places = np.ascontiguousarray(((sample - origin) / scale).T)
    nearest = np.full(len(sample), np.inf)
    for centers in good(blocks):
        meet(np.ascontiguousarray((centers - origin) / scale), places, nearest)
    there = np.sqrt(nearest[np.isfinite(nearest)])
    median = float(np.median(there)) * scale if len(there) else 0.0
    return Spacing(median, len(there))


def sample_of(blocks: Blocks) -> NDArray[np.float64]:
    """Choose up to `SAMPLE` points, each as likely as the others: those of the least draws."""
    random = np.random.default_rng(SEED)
    chosen = np.empty((0, 3))
    draws = np.empty(0)
    for centers in good(blocks):
        drawn = random.random(len(centers))
        if len(draws) == SAMPLE:
            few = drawn < draws[-1]
            centers, drawn = centers[few], drawn[few]
        draws = np.concatenate([draws, drawn])
        first = np.argsort(draws, kind="stable")[:SAMPLE]
        chosen = np.concatenate([chosen, centers])[first]
        draws = draws[first]
    return chosen


def good(blocks: Blocks) -> Iterator[NDArray[np.float64]]:
    """Yield the centers that are finite, as float64."""
    for centers in blocks():
        yield centers[finite(centers)].astype(np.float64, copy=False)
