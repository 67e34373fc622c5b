"""Eye rays as a queue: the first depth's, made as they are taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.image.frame import FrameSize
from bfrt.phases._eye import EyeRayGenerator
from bfrt.records import QUEUED
from bfrt.store.model import Camera, cross
from bfrt.store.store import Store


def count_eye_rays(frame: FrameSize, rows: int | None = None) -> int:
    """Return the number of eye rays of a frame, or of its first rows."""
    rows = frame.height if rows is None else rows
    return frame.across * (rows + (frame.samples == 0)) * max(1, frame.samples)


class EyeRays:
    """Makes the eye rays of views of one size, in the order of film elements and samples.

    Parameters
    ----------
    cameras : sequence of Camera
        Of the views, from left to right, as they lie in the film.
    first, last : int
        The film elements, pixels or their corners, whose rays they are: [first, last).
    samples : int
        A pixel, stratified: in a grid that has one sample in each of `samples` rows and
        columns, moved by a hash of the pixel. 0 is SPD's procedure: one ray at each pixel corner,
        so (width + 1) (height + 1) of a view, the outermost at half
        the angle.
    rows : (n,) uint32, optional
        Which rows of the frame's elements the film has; by default all.
    """

    def __init__(
        self,
        store: Store,
        cameras: Sequence[Camera],
        samples: int,
        first: int = 0,
        last: int | None = None,
        rows: NDArray[np.uint32] | None = None,
    ) -> None:
        frame = FrameSize(*cameras[0].resolution, samples, views=len(cameras))
        empty = store.bounds.empty
        self._generator = EyeRayGenerator(
            np.stack([view_vectors(camera, store.origin) for camera in cameras]),
            frame.width,
            frame.height,
            samples,
            coprime_turn(samples),
            np.zeros((2, 3)) if empty else np.stack([store.bounds.lo, store.bounds.hi]),
        )
        if rows is not None:
            self._generator.take_rows(rows)
        each = max(1, samples)
        self._taken = first * each
        self._total = count_eye_rays(frame) if last is None else last * each

    def __len__(self) -> int:
        return self._total - self._taken

    def leave(self, left: int) -> None:
        """Pass over rays until `left` of them wait."""
        self._taken = self._total - left

    def read(self, most: int) -> NDArray[Any]:
        """Return the next rays, (n,) of records.QUEUED with n <= most."""
        rays = np.empty(min(most, len(self)), QUEUED)
        self._generator.generate(self._taken, rays)
        self._taken += len(rays)
        return rays


def view_vectors(camera: Camera, origin: tuple[float, ...]) -> NDArray[np.float64]:
    """Return eye, forward, and the image's right and upper half axes, (4, 3) float64.

    The one place where trigonometry is done: once a view.
    """
    eye = np.array(camera.eye, np.float64)
    forward = np.array(camera.at, np.float64) - eye
    forward /= np.sqrt((forward * forward).sum())
    right = np.array(cross(tuple(forward), camera.up))
    right /= np.sqrt((right * right).sum())
    up = np.array(cross(tuple(right), tuple(forward)))
    half = math.tan(math.radians(camera.angle) / 2)
    aspect = camera.resolution[0] / camera.resolution[1]
    return np.stack([eye - np.array(origin), forward, right * (half * aspect), up * half])


def coprime_turn(samples: int) -> int:
    """Return the step nearest to samples / golden ratio that visits every row once."""
    if samples < 2:
        return 1
    best = round(samples * (math.sqrt(5) - 1) / 2)
    return next(
        turn
        for off in range(samples)
        for turn in (best - off, best + off)
        if turn > 0 and math.gcd(turn, samples) == 1
    )
