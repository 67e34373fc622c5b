"""LAS and LAZ files as tests write them with laspy."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("lazrs", reason="lazrs is not installed: bfrt[las]")
laspy = pytest.importorskip("laspy", reason="laspy is not installed: bfrt[las]")


RNG = np.random.default_rng(7)
COUNT = 30
UTM = np.array([500_000.0, 5_400_000.0, 300.0])
FORMATS = [0, 1, 2, 3, 6, 7, 8]
COLORED = {2, 3, 7, 8}
SUFFIXES = [".las", ".laz"]

#: Where a header has the number of its records, where points begin, the bytes of a point with
#: their count behind it, and how they are scaled.
POINTS_AT, RECORDS_AT, LENGTH_AT, SCALES_AT = 96, 100, 105, 131


def write(path, form=3, count=COUNT, offset=UTM, scale=0.001, extra=()):
    """A scan of some points; returns what laspy reads of it."""
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.scales, header.offsets = [scale] * 3, offset
    for name, kind in extra:
        header.add_extra_dim(laspy.ExtraBytesParams(name, kind))
    scan = laspy.LasData(header)
    rng = np.random.default_rng(count)
    scan.x, scan.y, scan.z = (offset + rng.uniform(-50, 50, (count, 3))).T
    scan.intensity = np.arange(count) * 1000 % 65536
    scan.classification = np.arange(count) % 3
    if form in COLORED:
        scan.red, scan.green, scan.blue = rng.integers(0, 65536, (3, count))
    for name, kind in extra:
        scan[name] = rng.uniform(0.5, 2, (count, int(kind[0]))) if kind[0].isdigit() else (
            rng.uniform(0.5, 2, count)
        )  # fmt: skip
    scan.write(path)
    return laspy.read(path)


def places(scan):
    return np.stack([np.asarray(scan.x), np.asarray(scan.y), np.asarray(scan.z)], axis=1)
