"""A reader alone, whose objects go nowhere: many more inputs a second than by whole conversions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.conversion.sources import SceneFile, sources_of
from bfrt.formats.reading import Reading
from bfrt.records import Kind

#: Numbers of an object of each kind that comes in rows.
NUMBERS = {Kind.SPHERE: 4, Kind.CONE: 8, Kind.TRIANGLE: 9, Kind.PATCH: 18}


class Checked:
    """A sink that keeps nothing, and holds what it is given to what `SceneSink` says of it."""

    def __init__(self) -> None:
        self._materials: dict[Any, int] = {}

    def passed_over(self, *_: object) -> None:
        """Take what is said of the whole scene."""

    camera = light = background = place = color_scale = passed_over

    def material(self, material: Any) -> int:
        return self._materials.setdefault(material, len(self._materials))

    def append(self, kind: Kind, records: NDArray[Any], materials: NDArray[np.uint32]) -> None:
        assert records.shape == (len(materials), NUMBERS[kind])
        self._check(records, materials)

    def append_polygons(
        self, vertices: NDArray[Any], counts: NDArray[np.int64], materials: NDArray[np.uint32]
    ) -> None:
        assert vertices.shape == (counts.sum(), 3)
        assert len(counts) == len(materials) and counts.min(initial=4) >= 4
        self._check(vertices, materials)

    def _check(self, numbers: NDArray[Any], materials: NDArray[np.uint32]) -> None:
        assert numbers.dtype in (np.float32, np.float64)
        assert materials.max(initial=0) < max(1, len(self._materials))


def read(path: Path, settings: Mapping[str, Any], scratch: Path) -> None:
    """Read a file, and keep nothing of it."""
    (source,) = sources_of(path)
    assert isinstance(source, SceneFile)
    source.reader(source.name, Checked(), Reading(**settings, scratch=scratch), None)
