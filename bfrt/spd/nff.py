"""A standard scene as NFF text: numbers have six digits, as C's %g writes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from bfrt.spd._text import lines
from bfrt.spd.blocks import Block, Part
from bfrt.store.model import Camera, Light, Material, Vector


class BlockText(NamedTuple):
    """Holds the text of a block.

    Attributes
    ----------
    text : str
        An object a line, or several. The first object's material is named, too: whether it has to
        be, the block before tells.
    objects : int
        How many there are.
    first, last : int
        The materials of the first and of the last; -1 if there is no object.
    """

    text: str
    objects: int
    first: int
    last: int


def head_text(background: Vector, camera: Camera, lights: tuple[Light, ...]) -> str:
    """Return the text before the first object."""
    lines = [
        f"b {_numbers(*background)}",
        "v",
        f"from {_numbers(*camera.eye)}",
        f"at {_numbers(*camera.at)}",
        f"up {_numbers(*camera.up)}",
        f"angle {_numbers(camera.angle)}",
        f"hither {_numbers(camera.hither)}",
        "resolution {} {}".format(*camera.resolution),
        *(f"l {_numbers(*light.position)}" for light in lights),
    ]
    return "\n".join(lines) + "\n"


def fill_text(material: Material) -> str:
    """Return the line that sets a material."""
    return f"f {_numbers(*material.color, *material[1:])}\n"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:g}" for value in values)


def block_text(block: Block, fills: list[bytes]) -> BlockText:
    """Return the text of a block's objects, in the package's order.

    Parameters
    ----------
    block : tuple of Part
        Their records are float64.
    fills : list of bytes
        What sets each of the scene's materials.
    """
    objects = sum(len(part.materials) for part in block)
    owner, index = np.empty(objects, np.int64), np.empty(objects, np.int64)
    materials = np.empty(objects, np.uint32)
    for number, part in enumerate(block):
        owner[part.places] = number
        index[part.places] = np.arange(len(part.places))
        materials[part.places] = part.materials
    columns = [
        (part.kind, np.ascontiguousarray(part.records).reshape(-1), _starts(part)) for part in block
    ]
    text = lines(columns, owner, index, materials, fills).decode("ascii")
    first, last = (int(materials[0]), int(materials[-1])) if objects else (-1, -1)
    return BlockText(text, objects, first, last)


def _starts(part: Part) -> npt.NDArray[np.int64]:
    """Return where each polygon begins, in vertices, and where the last ends."""
    counts = np.zeros(0, np.int64) if part.counts is None else part.counts
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
