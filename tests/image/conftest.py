"""Pictures with every awkward value, and a disk that is full."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from bfrt.image import exr
from bfrt.image.picture import Image
from bfrt.records import NO_HIT
from bfrt.streams import atomic_write
from bfrt.streams.atomic_write import atomic_path

AWKWARD = np.array(
    [np.nan, np.inf, -np.inf, -0.0, -1.0, 1e-40, 65504.0, 65519.0, 65520.0, 3e38], np.float32
)


def _make_image(height, width, metadata=None):
    """A picture of random bits' worth, its first pixels awkward, its last a miss."""
    random = np.random.default_rng([height, width])
    names = ["R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z"]
    channels = {n: random.random((height, width), dtype=np.float32) for n in names}
    for shift, pixels in enumerate(channels.values()):
        count = min(pixels.size, len(AWKWARD))
        pixels.reshape(-1)[:count] = np.roll(AWKWARD, shift)[:count]
    ids = random.integers(0, NO_HIT, (height, width), dtype=np.uint64)
    ids[-1, -1] = NO_HIT
    channels["id.lo"] = (ids & np.uint64(0xFFFFFFFF)).astype(np.uint32)
    channels["id.hi"] = (ids >> np.uint64(32)).astype(np.uint32)
    return Image(channels, {"scene": "rings 3"} if metadata is None else metadata)


@pytest.fixture
def make_image():
    """Makes a picture: `make_image(height, width, metadata)`."""
    return _make_image


@pytest.fixture
def full_disk(monkeypatch):
    """Temporary files lie on a disk that is full."""
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full here")

    @contextlib.contextmanager
    def atomic_path_on_full(path):
        with atomic_path(path) as temporary:
            temporary.unlink()
            temporary.symlink_to(full)
            yield temporary

    for module in (exr, atomic_write):
        monkeypatch.setattr(module, "atomic_path", atomic_path_on_full)
