"""The rays of a camera, to ask about what a picture shows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.phases._eye import EyeRayGenerator
from bfrt.phases.eye import view_vectors
from bfrt.store.model import Camera


def camera_rays(camera: Camera, *, rows: slice | None = None) -> NDArray[np.float64]:
    """Return the rays of a camera through the middles of its pixels.

    They are made as a picture's are, to the last bit, but that a picture's samples are elsewhere in
    the pixel: at its corners, or where `samples` of them are spread.

    Parameters
    ----------
    camera : Camera
        Such as `Scene.camera` or `Scene.framing_camera`.
    rows : slice, optional
        Which rows of pixels, from the top, one after another; by default all. A picture that memory
        does not hold is asked about by parts.

    Returns
    -------
    (h, w, 6) ndarray of float64
        Origins, world coordinates, and unit directions; the first row is the top.

    Raises
    ------
    SettingError
        If `camera` is none, or `rows` is no slice of step 1.

    Examples
    --------
    >>> hits = scene.cast_rays(bfrt.camera_rays(camera))
    >>> hits["t_hit"].shape
    (512, 512)
    >>> bands = (bfrt.camera_rays(camera, rows=slice(y, y + 64)) for y in range(0, 65536, 64))
    >>> scene.cast_rays(bands, out="folder")
    """
    if not isinstance(camera, Camera):
        raise SettingError(f"camera: found {type(camera).__name__}, expected a Camera")
    width, height = camera.resolution
    first, last = _rows_of(rows, height)
    view = np.stack([view_vectors(camera, (0.0, 0.0, 0.0))])
    generator = EyeRayGenerator(view, width, height, 1, 1, np.zeros((2, 3)))
    rays = np.empty((last - first, width, 6))
    generator.centers(first * width, rays.reshape(-1, 6))
    return rays


def _rows_of(rows: slice | None, height: int) -> tuple[int, int]:
    """Return the first row and the end of the rows."""
    if rows is None:
        return 0, height
    try:
        first, last, step = rows.indices(height)
    except (AttributeError, TypeError):
        step = 0
    if step != 1:
        raise SettingError(f"rows: found {rows!r:.80}, expected a slice of step 1, as slice(0, 64)")
    return first, max(first, last)
