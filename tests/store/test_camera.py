"""Cameras as callers give them: any numbers that are finite, and one sentence for all else."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

import bfrt
from bfrt.errors import SceneError

HUGE = 10**400
VIEW = {"eye": (0, -8, 3), "at": (0, 0, 0), "up": (0, 0, 1)}


@pytest.mark.parametrize("name", list(VIEW))
@pytest.mark.parametrize(
    "value", ["abc", (1, 2), None, ("1", "2", "3"), (HUGE, 0, 0), (np.nan, 0, 0), 3, (1, 2, 3, 4)],
    ids=lambda value: str(value)[:12],
)  # fmt: skip
def test_what_is_no_vector(name, value):
    with pytest.raises(SceneError, match=rf"^camera: {name}: found .*, expected"):
        bfrt.Camera(**{**VIEW, name: value})


@pytest.mark.parametrize("name", ["angle", "hither"])
@pytest.mark.parametrize("value", ["40", None, np.nan, np.inf, HUGE, True, 1j, (45,)])
def test_what_is_no_number(name, value):
    with pytest.raises(SceneError, match=rf"^camera: found {name} .*, expected a finite number"):
        bfrt.Camera(**VIEW, **{name: value})


@pytest.mark.parametrize(
    "value", [(2,), None, (True, True), (1, 2, 3), (0, 1), (1, 65536), (1.0, 2), "ab", 7, (HUGE, 1)]
)
def test_what_is_no_resolution(value):
    with pytest.raises(SceneError, match=r"^camera: found resolution .{1,80}, expected 1 to 65535"):
        bfrt.Camera(**VIEW, resolution=value)


def test_numbers_of_every_kind_are_one_camera():
    """Lists and arrays too: it is hashed, compared and written as JSON."""
    given = {name: np.array(value, np.float32) for name, value in VIEW.items()}
    size = (np.int64(3), np.uint8(2))
    one = bfrt.Camera(**VIEW, angle=40, resolution=[3, 2])
    other = bfrt.Camera(**given, angle=np.float32(40), resolution=np.array(size))
    assert one == other == bfrt.Camera(**VIEW, angle=40.0, resolution=size)
    assert hash(one) == hash(other)
    assert json.loads(json.dumps(asdict(other)))["resolution"] == [3, 2]
