"""What named arrays are and could be, by their names, shapes and types."""

from __future__ import annotations

from bfrt.errors import BfrtError
from bfrt.formats.contents import (
    COLOR,
    FACES,
    NORMALS,
    OWN_COLORS,
    POINTS,
    RADIUS,
    VERTICES,
    Row,
)
from bfrt.formats.layouts.layout import layouts_in, no_attributes
from bfrt.formats.layouts.steps import Attributes, StepArrays
from bfrt.formats.naming import (
    AXES,
    CENTERS,
    COLORS,
    NORMAL_NAMES,
    RADII,
    faces_called,
    folder_of,
    folders_of_three,
    is_column,
    is_points,
    name_of,
    three,
)
from bfrt.formats.table import Array, Arrays


def rows_of_arrays(
    file: str, arrays: Arrays, attributes: Attributes | None = None, *, framed: bool = False
) -> list[Row]:
    """List arrays, each with the option that takes it; of files of steps those of the last.

    Parameters
    ----------
    file : str
        Its name, for errors.
    arrays : Mapping
    attributes : callable, optional
        The attributes of the file's objects.
    framed : bool
        Whether arrays of one dimension too many have frames.
    """
    layouts = layouts_in(file, arrays, attributes or no_attributes)
    rows: list[Row] = []
    for layout in layouts:
        last = layout.steps[-1]
        use = f"{layout.name}, of which follows {last.folder}: --frame N"
        rows.append(Row("steps", (len(layout.steps),), "", use))
        rows += rows_of(StepArrays(layout, last), framed=framed)
    return rows or rows_of(arrays, framed=framed)


def rows_of(arrays: Arrays, *, framed: bool) -> list[Row]:
    """List arrays, each with the option that takes it."""
    columns = {key: folder for folder in folders_of_three(arrays)
               for key in three(arrays, folder, AXES)}  # fmt: skip
    vertices = {folder_of(key) for key in arrays if name_of(key) == VERTICES}
    meshes = {folder_of(key) for key in faces_called(arrays)} & vertices
    rows: list[Row] = []
    for key in arrays:
        try:
            array = arrays[key]
        except BfrtError as error:
            rows.append(Row(key, (), "", f"not read: {error}"))
            continue
        if folder_of(key) in meshes and (use := use_in_mesh(key, array)):
            pass
        elif key in columns and is_column(array):
            folder = columns[key]
            use = f"{POINTS}: --positions {folder}" if folder else POINTS
        else:
            use = use_of(key, array, framed=framed)
        rows.append(Row(key, array.shape, str(array.dtype), use))
    return rows


def use_in_mesh(key: str, array: Array) -> str:
    """Return what an array is beside vertices and faces; empty if it is nothing of a mesh."""
    name = name_of(key)
    if name == VERTICES:
        return "vertices of a mesh"
    if name in NORMAL_NAMES:
        return NORMALS
    if name in (FACES, "triangles") and array.dtype.kind in "iu":
        return "faces of a mesh"
    return COLOR.format(key) if is_column(array) else ""


def use_of(key: str, array: Array, *, framed: bool) -> str:
    """Return what an array could be by itself, and the options that take it."""
    name, shape = name_of(key), array.shape
    if name in COLORS and len(shape) > 1:
        return OWN_COLORS
    if name == "triangles" and shape[1:] in ((3, 3), (9,)):
        return "triangles"
    if name == "spheres" and is_points(array):
        return "spheres"
    if is_points(array):
        frame = " --frame N" if framed and len(shape) == 3 else ""
        known = f"{POINTS}: " if name in CENTERS else ""
        return f"{known}--positions {key}{frame}"
    frames = framed and len(shape) == 2 and array.dtype.kind in "fiub"
    if is_column(array) or frames:
        options = [RADIUS, COLOR] if name in RADII else [COLOR, RADIUS]
        return ", ".join(option.format(key) for option in options)
    return ""
