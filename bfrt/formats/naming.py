"""The meaning of a file's arrays by their names: a mesh, positions, radii, colors.

A name's last part counts, in any case; the part before, its folder, tells what belongs together:

::

    positions       PartType0/Coordinates     all/position/value (H5MD)   e/position/x y z (openPMD)
    a column of it  PartType0/Masses          all/mass/value              e/weighting
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bfrt.errors import SceneError, SettingError
from bfrt.formats.table import Array, Arrays, Rows, abreast, level, listed

#: Names that positions go by.
CENTERS = (
    "centers", "positions", "points", "coordinates", "pos", "coords", "xyz", "position",
)  # fmt: skip
RADII = ("radii", "radius")
COLORS = ("colors", "rgb", "color")
NORMAL_NAMES = ("normals", "vertex_normals")

#: Names that the faces of a mesh go by, beside vertices.
FACES = ("faces", "triangles")

#: Names of three columns that are positions, or colors.
AXES = (("x", "y", "z"),)
CHANNELS = (("red", "green", "blue"), ("r", "g", "b"))

#: What H5MD calls an array, which its folder is named for.
VALUE = "value"


def folder_of(key: str) -> str:
    """Return the part of a key before the last slash."""
    return key.rpartition("/")[0]


def within(folder: str, name: str) -> str:
    """Return the key of a name in a folder."""
    return f"{folder}/{name}" if folder else name


def name_of(key: str) -> str:
    """Return the name of a key's array; for H5MD's ``value`` it is that of the folder."""
    folder, _, name = key.rpartition("/")
    return (folder.rpartition("/")[2] if name == VALUE else name).lower()


def called(arrays: Arrays, names: Iterable[str]) -> list[str]:
    """List the keys of arrays that have one of some names."""
    return [key for key in arrays if name_of(key) in names]


def homes(near: str) -> Iterator[str]:
    """Yield the folders that may hold an array's companions: its own, and the parent where the
    folder is named for the array, as in H5MD and openPMD.
    """
    folder = folder_of(near)
    yield folder
    if folder.rpartition("/")[2].lower() in CENTERS:
        yield folder_of(folder)


def beside(arrays: Arrays, names: Iterable[str], near: str) -> list[str]:
    """List the keys of arrays of some names that belong to another array, the nearest first."""
    there = called(arrays, names)
    return [key for home in homes(near) for key in there if home == home_of(key)]


def home_of(key: str) -> str:
    """Return the folder that an array is in; for H5MD's ``value`` it is the one around its own."""
    folder, _, name = key.rpartition("/")
    return folder_of(folder) if name == VALUE else folder


def named(arrays: Arrays, name: str, file: str, setting: str, near: str = "") -> str:
    """Return the key of the array of a name: beside another, or by its whole name.

    Raises
    ------
    SettingError
        If there is none.
    """
    for key in keys_of(name, near):
        if key in arrays:
            return key
    raise SettingError(
        f"{file}: found no array {name!r} for {setting}, expected one of {listed(arrays)}"
    )


def keys_of(name: str, near: str) -> Iterator[str]:
    """Yield the keys that a name may stand for."""
    there = [within(home, name) for home in homes(near)]
    for key in (*there, name, name.lstrip("/")):
        yield key
        yield f"{key}/{VALUE}"


def three(arrays: Arrays, folder: str, names: tuple[tuple[str, ...], ...]) -> list[str]:
    """Find the keys of three columns in a folder, all in lower case, upper case or capitalised."""
    for group in names:
        for form in (str.lower, str.upper, str.capitalize):
            keys = [within(folder, form(name)) for name in group]
            if all(key in arrays for key in keys):
                return keys
    return []


def folders_of_three(arrays: Arrays) -> list[str]:
    """List the folders that have x, y and z."""
    folders = (folder_of(key) for key in arrays if key.rpartition("/")[2] in ("z", "Z"))
    return [folder for folder in dict.fromkeys(folders) if three(arrays, folder, AXES)]


def mesh_in(file: str, arrays: Arrays, home: str | None = None) -> list[str]:
    """Find the keys of vertices and of faces in one folder; an empty list if there are none.

    Parameters
    ----------
    file : str
    arrays : Mapping
    home : str, optional
        The folder that is asked for.

    Raises
    ------
    SceneError
        If several folders have them, but not the outermost.
    """
    vertices, faces = called(arrays, ("vertices",)), faces_called(arrays)
    pairs = ([v, f] for v in vertices for f in faces if folder_of(v) == folder_of(f))
    found = {folder_of(pair[0]): pair for pair in pairs}
    return the_one(file, arrays, found) if home is None else found.get(home.strip("/"), [])


def faces_called(arrays: Arrays) -> list[str]:
    """List the keys of arrays of faces: by their name, or whole numbers that are triangles."""
    faces, triangles = (called(arrays, (name,)) for name in FACES)
    homes_of_faces = {folder_of(key) for key in faces}
    own = [key for key in triangles if folder_of(key) not in homes_of_faces]
    return faces + [key for key in own if arrays[key].dtype.kind in "iu"]


def triangles_in(file: str, arrays: Arrays) -> list[str]:
    """Find the key of triangles; an empty list if there are none.

    Raises
    ------
    SceneError
        If several folders have them, but not the outermost.
    """
    found = called(arrays, ("triangles",))
    return the_one(file, arrays, {folder_of(key): [key] for key in found})


def the_one(file: str, arrays: Arrays, found: dict[str, list[str]]) -> list[str]:
    """Return the keys in the outermost folder, or in the only one; an empty list if none."""
    if len(found) > 1 and "" not in found:
        keys = [key for keys in found.values() for key in keys]
        raise SceneError(
            f"{file}: found {listed(arrays, keys)}, expected one mesh, or positions= with the "
            "name of points or of one's group"
        )
    return found.get("") or next(iter(found.values()), [])


def positions_in(file: str, arrays: Arrays) -> list[str]:
    """Find the keys of the only positions: of one array, or of three columns.

    Raises
    ------
    SceneError
        If there are none, or several.
    """
    known = ("spheres", *CENTERS)
    triples = {folder: three(arrays, folder, AXES) for folder in folders_of_three(arrays)}
    found = [[key] for key in called(arrays, known)]
    found += [triples[folder] for folder in triples if name_of(folder) in known]
    if len(found) > 1:
        found = [keys for keys in found if len(keys) == 3 or is_points(arrays[keys[0]])] or found
    elif not found:
        found = [keys for keys in triples.values() if all(is_column(arrays[k]) for k in keys)]
    if len(found) != 1:
        there = [key for keys in found for key in keys] or None
        raise SceneError(
            f"{file}: found {listed(arrays, there)}, expected one array named as one of "
            f"{', '.join(known)}, or x, y and z, or vertices and faces, or positions= with its name"
        )
    return found[0]


def positions_named(file: str, arrays: Arrays, name: str) -> list[str]:
    """Find the keys of the positions that a setting names: an array, three, or those in a folder.

    Raises
    ------
    SettingError
        If there are none.
    """
    folder = name.strip("/")
    columns = three(arrays, folder, AXES)
    if not columns and not any(key in arrays for key in keys_of(name, "")):
        columns = positions_within(arrays, folder)
    return columns or [named(arrays, name, file, "positions")]


def positions_within(arrays: Arrays, folder: str) -> list[str]:
    """Find the keys of the only positions in folders whose paths end so; else an empty list."""
    end = f"/{folder}"
    found = [[key] for key in called(arrays, CENTERS) if f"/{home_of(key)}".endswith(end)]
    for inner in folders_of_three(arrays):
        if f"/{folder_of(inner)}".endswith(end) and name_of(inner) in CENTERS:
            found.append(three(arrays, inner, AXES))
    return found[0] if len(found) == 1 else []


def colors_in(file: str, arrays: Arrays, near: str) -> Rows:
    """Find the colors that belong to an array, or the only ones in the file.

    Raises
    ------
    SettingError
        If there are none, or several.
    """
    anywhere = called(arrays, COLORS)
    found = [[key] for key in beside(arrays, COLORS, near)]
    found = found or [keys for home in homes(near) if (keys := three(arrays, home, CHANNELS))][:1]
    found = found or [[key] for key in anywhere]
    if len(found) != 1:
        raise SettingError(
            f"{file}: found {listed(arrays, anywhere or None)}, expected one array of colors "
            f"(n, 3), named as one of {', '.join(COLORS)}, or red, green and blue"
        )
    return joined(arrays, found[0])


def joined(arrays: Arrays, keys: list[str]) -> Rows:
    """Return the array of one key, or the arrays of several keys as columns of one."""
    if len(keys) == 1:
        return level(arrays[keys[0]], 2)
    return abreast([level(arrays[key], 1) for key in keys])


def is_rows(array: Rows, *columns: int) -> bool:
    """Tell whether an array has rows of `columns` numbers."""
    return len(array.shape) == 2 and array.shape[1] in columns and array.dtype.kind in "fiub"


def is_points(array: Array) -> bool:
    """Tell whether an array may be positions, or frames or a map of positions."""
    rows = len(array.shape) in (2, 3) and array.shape[-1] in (3, 4)
    return rows and array.dtype.kind in "fiub"


def is_column(array: Array) -> bool:
    """Tell whether an array may be a column of numbers."""
    return len(array.shape) == 1 and array.dtype.kind in "fiub"
