"""The layout that a file has: the one of those known that its attributes and names tell."""

from __future__ import annotations

from typing import Any

from bfrt.errors import SceneError
from bfrt.formats.layouts.frames import Framed
from bfrt.formats.layouts.h5part import h5part_in
from bfrt.formats.layouts.openpmd import openpmd_in
from bfrt.formats.layouts.steps import Attributes, Layout, StepArrays, is_in, step_of
from bfrt.formats.reading import Reading
from bfrt.formats.table import Arrays


def layouts_in(file: str, arrays: Arrays, attributes: Attributes) -> list[Layout]:
    """List the layouts of steps that a file has."""
    found = openpmd_in(file, arrays, attributes), h5part_in(arrays)
    return [layout for layout in found if layout is not None]


def arranged(
    file: str, arrays: Arrays, reading: Reading, attributes: Attributes | None = None
) -> Arrays:
    """Return the arrays of a file as those of one frame.

    Parameters
    ----------
    file : str
        Its name, for errors.
    arrays : Mapping
    reading : Reading
    attributes : callable, optional
        The attributes of the file's objects, of a format that has such: then any array of one
        dimension too many has frames, else only one that H5MD names, or where a frame is asked for.

    Raises
    ------
    SceneError
        If it has several layouts.
    SettingError
        If it does not have the frame that is asked for.
    """
    layouts = layouts_in(file, arrays, attributes or no_attributes)
    if len(layouts) > 1 and reading.positions is None:
        there = ", ".join(f"{layout.steps[0].folder} of {layout.name}" for layout in layouts)
        raise SceneError(
            f"{file}: found {there}, expected one layout, or positions= with the name of points"
        )
    for layout in layouts:
        if len(layouts) == 1 or asks_for(layout, reading):
            return StepArrays(layout, step_of(layout, file, reading))
    return Framed(arrays, reading, values_only=attributes is None and reading.frame is None)


def asks_for(layout: Layout, reading: Reading) -> bool:
    """Tell whether the positions that are asked for are of a layout."""
    asked = (reading.positions or "").strip("/")
    return any(is_in(f"{asked}/", step.folder) for step in layout.steps)


def no_attributes(path: str, *names: str) -> dict[str, Any] | None:
    """Return no attributes, as of a format that has none."""
    return None
