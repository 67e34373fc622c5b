"""The box hierarchy: levels of merged boxes over a stream's own (the paper's refinement B).

::

    level 2    |        box, end 3         |    box, end 5   |        32 bytes each
                    |                               |
    level 1    | end 4 | end 9 | end 12    | end 20 | end 31 |
                   |
    boxes      0 1 2 3 | 4 ...                                        the objects' own
    quantised  0 1 2 3 | 4 ...                                        the same in 6 bytes each

A box's children are those from where the one before it ends. Boxes are merged in the order of the
objects while the surface of the result is at most T of the grid's, T = (s / N^(1/3))^2 for N
boxes: that of a cube of s voxels, were there as many voxels as boxes. Where N is small, or enough
levels are made, one last level takes t for T. (The paper has the scene's box for the grid's, which
a ground polygon makes so large that all else is merged into a few boxes; ours stays out of the
grid, so it does not count here either.)

Beyond the paper, the objects' boxes are kept a second time, quantised inside their parents
(bfrt/geometry/quantised.pxd): marks are made of those, and rays meet them first: a
quarter of the bytes.

In spatial order `LEAST_CHILDREN` boxes or more are merged into one, whatever the surface: they lie
together, and where objects are large and overlap, levels of a box for each would take more room
than the objects.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import SettingError
from bfrt.records import CODE_BYTES, PARENT
from bfrt.refusals import refused
from bfrt.store._hierarchy import MOST_LEVELS, Merger, quantise
from bfrt.streams.writer import FileWriter

#: The most objects of a box of the first level, where theirs are quantised in it: so many wait
#: until it is complete.
MOST_CHILDREN = 4096

#: The fewest boxes that are merged into one in spatial order, but for the last of a level.
LEAST_CHILDREN = 8

#: Bits of a quantised side, and of none.
BITS = (8, 0)

Boxes = Iterable[NDArray[np.float32]]


@dataclass(frozen=True)
class Hierarchy:
    """Holds the settings of a hierarchy, by the paper's letters.

    Parameters
    ----------
    s : float
        The size of a merged box, more than 0: boxes are merged, in the order of the objects, while
        the surface of the result is at most that of a cube of s voxels a side, in a grid of as many
        voxels as there are boxes. That is T = (s / N^(1/3))^2 of the grid's surface for N boxes.
        In spatial order eight are merged in any case.
    n : int
        A level over n boxes or fewer is the last; 1 or more.
    l : int
        The most levels, 1 to 8.
    t : float
        T for the last level, 0 or more: 1 merges all boxes that are left.
    bits : {8, 0}
        Bits a side of objects' boxes, which are kept quantised beside the exact ones; 0 keeps the
        exact ones only. Spheres have no quantised boxes: their records are as small. (The paper has
        no letter for this.)

    Raises
    ------
    SettingError
        If a setting is out of range.
    """

    s: float = 3.0
    n: int = 1000
    l: int = 4  # noqa: E741 (the paper's letter)
    t: float = 1.0
    bits: int = BITS[0]

    def __post_init__(self) -> None:
        if not (0.0 < self.s < math.inf and self.n >= 1 and 0.0 <= self.t < math.inf):
            raise SettingError(f"hierarchy: found {self}, expected s > 0, n >= 1 and t >= 0")
        if self.bits not in BITS:
            raise SettingError(f"hierarchy: found bits={self.bits}, expected 8, or 0 for none")
        if not 1 <= self.l <= MOST_LEVELS:
            raise SettingError(f"hierarchy: found l={self.l}, expected 1 to {MOST_LEVELS}")

    def threshold(self, count: int, level: int) -> tuple[float, bool]:
        """Return T for the `level` over `count` boxes, and whether that level is the last."""
        if count <= self.n or level >= self.l:
            return self.t, True
        return (self.s / count ** (1 / 3)) ** 2, False


def parse_hierarchy(text: str, default: Hierarchy | None = None) -> Hierarchy:
    """Parse settings such as ``"s=3,n=1000,l=4,t=1,bits=8"``; the default has those left out.

    Raises
    ------
    SettingError
        If the text is something else, or a setting is out of range.
    """
    base = default or Hierarchy()
    kinds = {f.name: type(getattr(base, f.name)) for f in fields(base)}
    given = {f.name: getattr(base, f.name) for f in fields(base)}
    for part in text.split(","):
        name, _, value = part.strip().partition("=")
        try:
            given[name] = kinds[name](value)
        except (KeyError, ValueError):
            raise SettingError(
                f"hierarchy: found {part!r}, expected settings such as s=3,n=1000,l=4,t=1"
            ) from None
    return Hierarchy(**given)


class Level:
    """Writes one level of a stream's hierarchy.

    Parameters
    ----------
    path : Path
        Its file: ``level1``, ``level2`` ... in the stream's folder.
    limit : float
        The surface that a merged box has at the most.
    durable : bool
        Whether its files outlive a loss of power.
    quantised : bool
        Whether to keep the boxes below quantised, in a file of that name.
    least : int
        Boxes that are merged into one whatever its surface, but for the last.

    Attributes
    ----------
    files : dict of str to FileWriter
        The level's files by their names.
    count : int
        Number of its boxes so far.
    seconds : float
        What `add` has taken.
    """

    def __init__(
        self, path: Path, limit: float, durable: bool, *, quantised: bool = False, least: int = 1
    ) -> None:
        self.path = path
        self.files: dict[str, FileWriter] = {}
        try:
            for name in [path.name, *(["quantised"] if quantised else [])]:
                self.files[name] = FileWriter(path.with_name(name), durable)
        except BaseException:
            self.abandon()
            raise
        self.count = 0
        self.seconds = 0.0
        self._merger = Merger(limit, MOST_CHILDREN if quantised else 1 << 62, least)
        self._waiting = np.empty((0, 6), np.float32)  # for their parent
        self._coded = 0

    def add(self, boxes: NDArray[np.float32]) -> None:
        """Take the next boxes (n, 6) of the level below."""
        start = time.perf_counter()
        made = np.empty(len(boxes), PARENT)
        self._keep(made[: self._merger.merge(boxes, made)], boxes)
        self.seconds += time.perf_counter() - start

    def finish(self) -> None:
        """Complete the last box, and the files."""
        made = np.empty(1, PARENT)
        self._keep(made[: self._merger.finish(made)], self._waiting[:0])
        for file in self.files.values():
            file.close()

    def abandon(self) -> None:
        for file in self.files.values():
            file.abandon()

    def _keep(self, made: NDArray[np.void], boxes: NDArray[np.float32]) -> None:
        self.files[self.path.name].write(made)
        self.count += len(made)
        if "quantised" not in self.files:
            return
        children = np.concatenate([self._waiting, boxes])
        n = int(made["end"][-1]) - self._coded if len(made) else 0
        codes = np.empty((n, CODE_BYTES), np.uint8)
        quantise(children[:n], made, self._coded, codes)
        self.files["quantised"].write(codes)
        self._coded += n
        self._waiting = children[n:].copy()


class HierarchyWriter:
    """Makes the hierarchy of a stream, level by level.

    Each is made in one pass over the one below, whose number of boxes has to be known.

    Parameters
    ----------
    folder : Path
        The stream's folder.
    settings : Hierarchy
        How large merged boxes are, and how many levels there are.
    surface : float
        The surface of the group's grid.
    durable : bool
        Whether its files outlive a loss of power.
    quantised : bool
        Whether to keep the objects' boxes quantised too.
    least : int
        Boxes that are merged into one whatever its surface, but for the last of a level.

    Attributes
    ----------
    levels : list of Level
        Those that are begun, from the first.
    """

    def __init__(
        self,
        folder: Path,
        settings: Hierarchy,
        surface: float,
        *,
        durable: bool,
        quantised: bool = False,
        least: int = 1,
    ) -> None:
        self.levels: list[Level] = []
        self._folder = folder
        self._settings = settings
        self._surface = surface
        self._durable = durable
        self._quantised = quantised
        self._least = least
        self._last = False  # whether the highest level so far has none above

    def begin(self, below: int) -> None:
        """Begin the next level, over `below` boxes, which `add` takes."""
        number = len(self.levels) + 1
        ratio, self._last = self._settings.threshold(below, number)
        path, limit = self._folder / f"level{number}", ratio * self._surface
        quantised = self._quantised and number == 1
        level = Level(path, limit, self._durable, quantised=quantised, least=self._least)
        self.levels.append(level)

    def add(self, boxes: NDArray[np.float32]) -> None:
        """Take the next boxes (n, 6) below the level that was begun."""
        self.levels[-1].add(boxes)

    def complete(self, boxes: Boxes, count: int) -> None:
        """Complete all levels.

        Parameters
        ----------
        boxes : iterable of (n, 6) float32
            The boxes of all objects, in their order. Not used if the first level was begun.
        count : int
            Number of objects; there are no levels over none.
        """
        try:
            if count and not self.levels:
                self._pass_over(boxes, count)
            while self.levels:
                highest = self.levels[-1]
                highest.finish()
                if self._last:
                    break
                self._pass_over(level_boxes(highest.path), highest.count)
        except BaseException:
            self.abandon()
            raise

    def _pass_over(self, boxes: Boxes, count: int) -> None:
        self.begin(count)
        for block in boxes:
            self.add(block)

    def abandon(self) -> None:
        """Give the files up."""
        for level in self.levels:
            level.abandon()


def level_boxes(path: Path) -> Iterator[NDArray[np.float32]]:
    """Yield the boxes of a level, block by block."""
    try:
        with path.open("rb") as file:
            while block := file.read(PARENT.itemsize << 15):
                numbers = np.frombuffer(block, "<f4").reshape(-1, PARENT.itemsize // 4)
                yield np.ascontiguousarray(numbers[:, :6])
    except OSError as error:
        raise refused(path, 0, error, "reading") from error
