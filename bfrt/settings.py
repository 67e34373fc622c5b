"""The settings that renders and ray queries share, checked once, where they come in.

None of them changes an answer or a picture.
"""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bfrt.errors import SettingError
from bfrt.memory import default_memory, parse_memory
from bfrt.paths import is_folder, path_of, without_links
from bfrt.workers import usable_threads


@dataclass(frozen=True)
class Refinement:
    """Describes one of the paper's refinements, which includes those before it, or the tree.

    Attributes
    ----------
    name : str
        The paper's, small.
    lazy : bool
        Whether geometry lies apart from boxes and is read only where a ray meets its box, or hits
        it (the paper's S and G).
    hierarchy : bool
        Whether only boxes below those of the hierarchy that are near rays are read (its B).
    tree : bool
        Whether rays go through treelets, in place of the paper's grid.
    """

    name: str
    lazy: bool
    hierarchy: bool
    tree: bool = False


#: By their names, the least first.
REFINEMENTS = {
    made.name: made
    for made in (
        Refinement("base", lazy=False, hierarchy=False),
        Refinement("sg", lazy=True, hierarchy=False),
        Refinement("sgb", lazy=True, hierarchy=True),
        Refinement("tree", lazy=True, hierarchy=False, tree=True),
    )
}

#: The finest of a grid, which is taken where none is asked for and objects are in the order given.
FINEST = "sgb"
TREE = "tree"


@dataclass(frozen=True)
class Settings:
    """Holds how a scene is traced: the settings that renders and ray queries have in common.

    Attributes
    ----------
    memory : int
        Bytes of the whole process.
    threads : int
    refinement : Refinement
    grid : int, optional
        Voxels on the longest axis of each grid, whatever the rule says.
    max_grid : int, optional
        The most that there may be on that axis.
    fresh_marks : bool
        Whether voxel marks are made again.
    scratch : Path, optional
        Folder for what does not fit in memory.
    """

    memory: int
    threads: int
    refinement: Refinement
    grid: int | None = None
    max_grid: int | None = None
    fresh_marks: bool = False
    scratch: Path | None = None

    @classmethod
    def of(
        cls,
        memory: str | int | None = None,
        threads: int | None = None,
        refine: str = FINEST,
        grid: int | None = None,
        max_grid: int | None = None,
        fresh_marks: bool = False,
        scratch: str | os.PathLike[str] | None = None,
    ) -> Settings:
        """Check the settings of `bfrt.render` and the queries as a caller gives them.

        Raises
        ------
        SettingError
            For the first that cannot be honoured.
        """
        if not isinstance(refine, str) or refine not in REFINEMENTS:
            raise SettingError(
                f"refine: found {refine!r}, expected one of {', '.join(REFINEMENTS)}"
            )
        of_grid = {"grid": grid, "max_grid": max_grid, "fresh_marks": fresh_marks or None}
        for name, value in of_grid.items():
            if refine == TREE and value is not None:
                raise SettingError(f"{name}: found {value} with refine {TREE!r}, which has no grid")
        return cls(
            memory=default_memory() if memory is None else parse_memory(memory),
            threads=usable_threads() if threads is None else at_least_one("threads", threads),
            refinement=REFINEMENTS[refine],
            grid=None if grid is None else at_least_one("grid", grid),
            max_grid=None if max_grid is None else at_least_one("max_grid", max_grid),
            fresh_marks=fresh_marks,
            scratch=None if scratch is None else folder_of("scratch", scratch),
        )

    def scratch_beside(self, path: Path) -> Path:
        """Return the folder for spools: the one asked for, else one beside a path."""
        return scratch_folder(self.scratch, path)


def chosen(name: str, given: Iterable[str], known: Collection[str]) -> tuple[str, ...]:
    """Return which of the known names a caller asks for, in the order in which they are known.

    Raises
    ------
    SettingError
        For a name that there is not; if it is no sequence of names.
    """
    expected = f"a sequence of {', '.join(known)}"
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise SettingError(f"{name}: found {given!r:.80}, expected {expected}")
    asked = tuple(given)
    for each in asked:
        if not isinstance(each, str) or each not in known:
            raise SettingError(f"{name}: found {each!r:.80}, expected {expected}")
    return tuple(each for each in known if each in asked)


def number_of(value: object) -> float:
    """Return a real number as a float: NaN for what is none, infinity for what no float reaches."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def at_least_one(name: str, value: int, most: int | None = None) -> int:
    """Return the value, if it is a whole number of 1 or more, up to `most` where that is given.

    Raises
    ------
    SettingError
        If it is not.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise SettingError(f"{name}: found {value!r}, expected a whole number of 1 or more")
    if most is not None and value > most:
        raise SettingError(f"{name}: found more than {most}, expected a number from 1 to that")
    return int(value)


def folder_of(name: str, value: str | os.PathLike[str]) -> Path:
    """Return a folder that is there.

    Raises
    ------
    SettingError
        If it is not.
    """
    folder = path_of(name, value)
    if not is_folder(folder):
        raise SettingError(f"{name}: found {folder}, expected a folder that is there")
    return folder


def scratch_folder(scratch: str | os.PathLike[str] | None, beside: Path) -> Path:
    """Return the folder for temporary files.

    Parameters
    ----------
    scratch : path-like, optional
        The one that is asked for.
    beside : Path
        Without one, its parent, or the system's temporary folder where that is read-only.
    """
    if scratch is not None:
        return folder_of("scratch", scratch)
    parent = without_links(beside).parent
    return parent if os.access(parent, os.W_OK) else Path(tempfile.gettempdir())
