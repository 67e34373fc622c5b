"""The scenes of the Standard Procedural Databases (SPD), at any size.

::

    size ─► SpdScene: balls, gears, ... ─► tasks ─► blocks of parts ─┬─► write: a scene store
              (recipe)                     any thread makes one      └─► write_nff: text (nff)

A task makes up to about 70,000 objects and needs no other task, so that any size streams.
"""

from __future__ import annotations

from dataclasses import replace

from bfrt.errors import SettingError
from bfrt.spd.balls import Balls
from bfrt.spd.gears import Gears
from bfrt.spd.mount import Mount
from bfrt.spd.recipe import SpdScene
from bfrt.spd.rings import Rings
from bfrt.spd.teapot import Teapot
from bfrt.spd.tetra import Tetra
from bfrt.spd.tree import Tree

__all__ = [
    "DEFAULT_SIZES",
    "NAMES",
    "VIEWS",
    "balls",
    "gears",
    "mount",
    "rings",
    "scene",
    "teapot",
    "tetra",
    "tree",
]

_SCENES: dict[str, type[SpdScene]] = {
    made.name: made for made in (Balls, Gears, Mount, Rings, Teapot, Tetra, Tree)
}

#: The scenes that `scene` knows.
NAMES = tuple(_SCENES)

#: The package's default sizes, of about ten thousand objects each.
DEFAULT_SIZES = {
    "balls": 4, "gears": 4, "mount": 6, "rings": 7, "teapot": 12, "tetra": 6, "tree": 11
}  # fmt: skip

#: Views of a standard scene beside its own. The paper's third huge scene is rings 368 seen so that
#: the frustum holds about a million objects.
VIEWS = {"rings368m": replace(Rings.camera, angle=1.5)}


def balls(size: int) -> SpdScene:
    """Return a sphere that carries nine smaller ones, and so on, above a floor.

    Parameters
    ----------
    size : int
        Generations n of spheres: (9^(n + 1) - 1) / 8 + 1 objects.

    Returns
    -------
    SpdScene
        A recipe: `SpdScene.write` makes a scene store of it, `SpdScene.write_nff` a file.

    Raises
    ------
    SettingError
        If the size is less than 1.
    """
    return Balls(size)


def gears(size: int) -> SpdScene:
    """Return a block of interlocked gears above a ground.

    Parameters
    ----------
    size : int
        Gears n on each side of the block: 146 n^3 + 1 objects.

    Returns
    -------
    SpdScene
        As for `balls`, with the same errors.
    """
    return Gears(size)


def mount(size: int, hash: str = "package") -> SpdScene:
    """Return a fractal mountain under four crystal balls.

    Parameters
    ----------
    size : int
        Halvings n of the mountain's side: 2 * 4^n + 4 objects.
    hash : {"package", "jenkins"}
        The hash that the heights come from: the package's own, or Bob Jenkins's, which is more even
        and which the paper used.

    Returns
    -------
    SpdScene
        As for `balls`.

    Raises
    ------
    SettingError
        If the size is less than 1, or there is no such hash.
    """
    return Mount(size, hash)


def rings(size: int) -> SpdScene:
    """Return a pyramid of chained rings before a wall.

    Parameters
    ----------
    size : int
        Layers n: 10 n (n + 1) (2n + 1) + 1 objects.

    Returns
    -------
    SpdScene
        As for `balls`, with the same errors.
    """
    return Rings(size)


def teapot(size: int) -> SpdScene:
    """Return Newell's teapot on a chessboard.

    Parameters
    ----------
    size : int
        Cells n on each side of a patch: 65 n^2 - 8 n objects.

    Returns
    -------
    SpdScene
        As for `balls`, with the same errors.
    """
    return Teapot(size)


def tetra(size: int) -> SpdScene:
    """Return a Sierpinski tetrahedron.

    Parameters
    ----------
    size : int
        Levels n: 4^n objects.

    Returns
    -------
    SpdScene
        As for `balls`, with the same errors.
    """
    return Tetra(size)


def tree(size: int) -> SpdScene:
    """Return a tree on a field.

    Parameters
    ----------
    size : int
        Generations n of forks: 2 (2^(n + 1) - 1) + 1 objects.

    Returns
    -------
    SpdScene
        As for `balls`, with the same errors.
    """
    return Tree(size)


def scene(name: str, size: int, **options: str) -> SpdScene:
    """Return the standard scene of a name.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size : int
        The package's size factor, 1 or more.
    **options : str
        Options of the scene beside its size: mount's `hash`.

    Returns
    -------
    SpdScene
        A recipe: `SpdScene.write` makes a scene store of it, `SpdScene.write_nff` a file.

    Raises
    ------
    SettingError
        If there is no scene of this name, the size is less than 1, or the scene has no such option.
    """
    if name not in _SCENES:
        raise SettingError(f"spd: found scene {name!r}, expected one of {', '.join(NAMES)}")
    try:
        return _SCENES[name](size, **options)
    except TypeError:
        if not options:
            raise
        given = ", ".join(options)
        raise SettingError(f"spd: found option {given} for {name}, which has none") from None
