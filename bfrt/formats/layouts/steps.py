"""Files of several steps, each in a group of its own, of which one is read."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

from bfrt.errors import SettingError
from bfrt.formats.naming import within
from bfrt.formats.reading import Reading
from bfrt.formats.table import Array, Arrays, Listed, frame_of

log = logging.getLogger(__name__)

#: Returns the attributes of an object, by its path, that have some names; None for no object.
Attributes = Callable[..., dict[str, Any] | None]


class Step(NamedTuple):
    """Names a step of a simulation and the folder of its particles."""

    number: int
    folder: str


class Layout(NamedTuple):
    """Describes a file's layout.

    Attributes
    ----------
    name : str
    steps : list of Step
        In the order of their numbers, one or more.
    arrays : Mapping
        The arrays of all, as they are read.
    """

    name: str
    steps: list[Step]
    arrays: Arrays


class StepArrays(Listed):
    """Maps paths to the arrays of a file, of which those of one step are listed.

    A path may be within the step's folder too.

    Parameters
    ----------
    layout : Layout
    step : Step
    """

    def __init__(self, layout: Layout, step: Step) -> None:
        super().__init__([key for key in layout.arrays if is_in(key, step.folder)])
        self._arrays = layout.arrays
        self._folder = step.folder

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and any(key in self._arrays for key in self._keys(name))

    def __getitem__(self, name: str) -> Array:
        for key in self._keys(name):
            if key in self._arrays:
                return self._arrays[key]
        raise KeyError(name)

    def _keys(self, name: str) -> tuple[str, str]:
        return name, within(self._folder, name)


def is_in(key: str, folder: str) -> bool:
    """Tell whether an array is in a folder, or in one that is in it."""
    return key.startswith(f"{folder}/")


def numbered(found: dict[int, str]) -> list[Step]:
    """Return steps, by their numbers' order, from the folder of each number."""
    return [Step(number, found[number]) for number in sorted(found)]


def step_of(layout: Layout, file: str, reading: Reading) -> Step:
    """Return the step that is read: that of the positions asked for, a frame, or the last.

    Raises
    ------
    SettingError
        If there are fewer, or positions of one step and a frame are asked for.
    """
    asked = (reading.positions or "").strip("/")
    named = [step for step in layout.steps if is_in(f"{asked}/", step.folder)]
    if named and reading.frame is not None:
        raise SettingError(
            f"{file}: found frame={reading.frame} and positions={reading.positions!r}, which are "
            f"of step {named[0].number}, expected one of them"
        )
    reading.uses.known.add("frame")
    frame = -1 if reading.frame is None else reading.frame
    place = frame_of(frame, len(layout.steps), f"{file}: steps of {layout.name}")
    chosen = named[0] if named else layout.steps[place]
    told = "%s: %s's step %d is read, one of %d"
    log.info(told, file, layout.name, chosen.number, len(layout.steps))
    return chosen
