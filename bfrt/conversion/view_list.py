"""A file of views: one a line, or NFF's ``v`` with its fields, as often as there are views.

::

    # from      at       up       angle         v
    4 3 2       0 0 0    0 0 1    40            from 4 3 2
    -3 4 2      0 0 0    0 0 1    40            at 0 0 0 ...
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from bfrt.errors import SceneError
from bfrt.paths import facts_at, is_file
from bfrt.refusals import calling
from bfrt.store.model import Camera

#: Bytes of such a file, at the most.
MOST_BYTES = 1 << 24

#: Fields of a view, and how many numbers each has; all but the last two are needed.
FIELDS = {"from": 3, "at": 3, "up": 3, "angle": 1, "hither": 1, "resolution": 2}
NEEDED = ("from", "at", "up", "angle")
NUMBERS = sum(FIELDS[name] for name in NEEDED)

EXPECTED = f"{NUMBERS} numbers (from, at, up, angle), or v and its fields"


class ViewList:
    """Gathers views, line by line.

    Parameters
    ----------
    path : path-like
        By which errors name the file.
    resolution : tuple of 2 int
        Of views that have none of their own.
    """

    def __init__(self, path: str | os.PathLike[str], resolution: tuple[int, int]) -> None:
        self.cameras: list[Camera] = []
        self._path = os.fspath(path)
        self._resolution = resolution
        self._fields: dict[str, list[float]] | None = None  # of a v that has begun
        self._begun = self._line = 0

    def take(self, text: str) -> None:
        """Take the next line."""
        self._line += 1
        words = text.partition("#")[0].replace(",", " ").split()
        if not words:
            return
        if words == ["v"]:
            self.end()
            self._fields, self._begun = {}, self._line
        elif words[0] in FIELDS and self._fields is not None:
            self._field(words[0], self._numbers(words[1:]))
        else:
            self.end()
            numbers = self._numbers(words)
            if len(numbers) != NUMBERS:
                raise self._fault(f"found {len(numbers)} numbers, expected {EXPECTED}")
            fields = {"from": numbers[:3], "at": numbers[3:6], "up": numbers[6:9]}
            self._add({**fields, "angle": numbers[9:]}, self._line)

    def end(self) -> None:
        """End the v that has begun, if one has."""
        fields, self._fields = self._fields, None
        if fields is None:
            return
        missing = [name for name in NEEDED if name not in fields]
        if missing:
            self._line = self._begun
            raise self._fault(f"found a v without {missing[0]}, expected {', '.join(NEEDED)}")
        self._add(fields, self._begun)

    def _field(self, name: str, numbers: list[float]) -> None:
        assert self._fields is not None
        if name in self._fields or len(numbers) != FIELDS[name]:
            found = "it twice" if name in self._fields else f"{len(numbers)} numbers"
            raise self._fault(f"{name}: found {found}, expected {FIELDS[name]} numbers once")
        self._fields[name] = numbers

    def _add(self, fields: dict[str, list[float]], line: int) -> None:
        size = fields.get("resolution", self._resolution)
        whole: Any = tuple(int(n) if n in range(1 << 16) else n for n in size)
        eye, at, up = (_vector(fields[name]) for name in ("from", "at", "up"))
        (angle,) = fields["angle"]
        try:
            self.cameras.append(Camera(eye, at, up, angle, resolution=whole))
        except SceneError as error:
            raise SceneError(f"{self._path}:{line}: {error}") from None

    def _numbers(self, words: list[str]) -> list[float]:
        try:
            return [float(word) for word in words]
        except ValueError:
            found = " ".join(words)
            raise self._fault(f"found {found!r:.60}, expected {EXPECTED}") from None

    def _fault(self, text: str) -> SceneError:
        return SceneError(f"{self._path}:{self._line}: {text}")


def _vector(numbers: list[float]) -> tuple[float, float, float]:
    x, y, z = numbers
    return x, y, z


def read_views(path: str | os.PathLike[str], resolution: tuple[int, int]) -> list[Camera]:
    """Read a file of views.

    Parameters
    ----------
    path : path-like
    resolution : tuple of 2 int
        Of views that have none of their own.

    Raises
    ------
    SceneError
        If it has none, or is something else; it names file and line.
    StreamError
        If the system refuses to read it.
    """
    file = Path(path)
    facts = facts_at(file)
    if facts is None or not is_file(file) or facts.st_size > MOST_BYTES:
        raise SceneError(
            f"{os.fspath(path)}: found {'no file' if facts is None else 'none'} of views, expected "
            f"a file of {MOST_BYTES} bytes or fewer"
        )
    with calling(file, "reading"):
        text = file.read_bytes().decode("utf-8-sig", "replace")
    views = ViewList(path, resolution)
    for line in text.splitlines():
        views.take(line)
    views.end()
    if not views.cameras:
        raise SceneError(f"{os.fspath(path)}: found no view, expected {EXPECTED}")
    return views.cameras
