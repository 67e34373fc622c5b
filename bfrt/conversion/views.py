"""The view of an NFF file, taken without its objects."""

from __future__ import annotations

import os

from bfrt.errors import SettingError
from bfrt.formats.nff import read_nff
from bfrt.scene import PathLike
from bfrt.store.model import Camera


class _View:
    """Keeps the camera of an NFF file, and nothing else."""

    def __init__(self) -> None:
        self.found: Camera | None = None

    def camera(self, camera: Camera) -> None:
        self.found = camera

    def place(self, origin: object, crs: str) -> None:
        """Ignore where objects are: a view has none."""

    def color_scale(self, scale: object) -> None:
        """Ignore what colors say: a view has none."""

    def light(self, light: object) -> None:
        """Ignore a light: a view has none."""

    def background(self, color: object) -> None:
        """Ignore a background: a view has none."""

    def material(self, material: object) -> int:
        return 0

    def append(self, kind: object, records: object, materials: object) -> None:
        """Ignore objects."""

    def append_polygons(self, vertices: object, counts: object, materials: object) -> None:
        """Ignore polygons."""


def read_view(path: PathLike) -> Camera:
    """Return the camera of an NFF file, which may consist of a ``v`` alone.

    Raises
    ------
    SettingError
        If it has none.
    """
    view = _View()
    read_nff(path, view)
    if view.found is None:
        raise SettingError(f"{os.fspath(path)}: found no view, expected a v with its fields")
    return view.found
