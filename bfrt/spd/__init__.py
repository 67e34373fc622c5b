"""The scenes of the Standard Procedural Databases, at any size."""

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
    """A sphere with `size` generations of nine spheres on each: (9^(n + 1) - 1) / 8 + 1 objects."""
    return Balls(size)


def gears(size: int) -> SpdScene:
    """`size` x `size` x `size` interlocked gears: 146 n^3 + 1 objects."""
    return Gears(size)


def mount(size: int, hash: str = "package") -> SpdScene:
    """A fractal mountain under four crystal balls: 2 * 4^n + 4 objects.

    `hash` is ``"package"``, the package's own, or ``"jenkins"``, the better one that it has an
    option for and that the paper used.
    """
    return Mount(size, hash)


def rings(size: int) -> SpdScene:
    """A pyramid of `size` layers of chained rings: 10 n (n + 1) (2n + 1) + 1 objects."""
    return Rings(size)


def teapot(size: int) -> SpdScene:
    """Newell's teapot on a chessboard, `size` x `size` cells a patch: 65 n^2 - 8 n objects."""
    return Teapot(size)


def tetra(size: int) -> SpdScene:
    """A Sierpinski tetrahedron of `size` levels: 4^n objects."""
    return Tetra(size)


def tree(size: int) -> SpdScene:
    """A tree of `size` generations of forks, on a field: 2 (2^(n + 1) - 1) + 1 objects."""
    return Tree(size)


def scene(name: str, size: int, **options: str) -> SpdScene:
    """The standard scene of this name.

    Parameters
    ----------
    name : str
        One of `NAMES`.
    size : int
        The package's size factor, 1 or more.
    **options : str
        What the scene takes beside its size: mount's `hash`.

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
