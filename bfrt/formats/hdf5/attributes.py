"""Attributes of HDF5's groups and datasets, and arrays that are nothing but attributes.

openPMD keeps an array of one number as a group of two attributes, ``value`` and ``shape``: a
constant record component.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5g
from numpy.typing import NDArray

from bfrt.errors import SceneError
from bfrt.formats.source import Source, printable

#: Numbers of an attribute, at the most.
MOST_NUMBERS = 1 << 12

VALUE, SHAPE = "value", "shape"


def attributes_of(thing: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Return those of an object's attributes that it has: texts, numbers, and lists of them.

    Raises
    ------
    ValueError
        If one is of another kind, or is too long.
    """
    there = (name for name in names if h5a.exists(thing, name.encode()))
    return {name: attribute_of(thing, name) for name in there}


def attribute_of(thing: Any, name: str) -> Any:
    """Return the attribute of a name; else as `attributes_of`."""
    shape = h5a.open(thing, name.encode()).shape
    if shape is not None and math.prod(shape) > MOST_NUMBERS:
        raise ValueError(f"attribute {name} of shape {shape}")
    value = h5py.AttributeManager(Held(thing))[name]
    plain = plain_of(value)
    if plain is None:
        raise ValueError(f"attribute {name} of {type(value).__name__}")
    return plain


class Held:
    """Holds an object's id, which is all that h5py's attributes need."""

    def __init__(self, thing: Any) -> None:
        self.id = thing


def plain_of(value: Any) -> Any:
    """Return texts and numbers, and lists of them, as Python has them; None for all else."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, np.ndarray):
        items = [plain_of(item) for item in value.reshape(-1)]
        return None if None in items else items
    if isinstance(value, np.generic) and value.dtype.kind in "fiub":
        return value.item()
    return str(value) if isinstance(value, str) else None


def is_constant(thing: Any) -> bool:
    """Tell whether an object is a constant record component."""
    if not isinstance(thing, h5g.GroupID) or len(thing):
        return False
    return bool(h5a.exists(thing, VALUE.encode()) and h5a.exists(thing, SHAPE.encode()))


class Constant:
    """Presents a constant record component: a `bfrt.formats.table.Array`.

    Parameters
    ----------
    source : Source
        The file that it is in.
    name : str
        Its path.
    group : h5py.h5g.GroupID

    Raises
    ------
    SceneError
        If its attributes are no number and no shape of rows.
    """

    def __init__(self, source: Source, name: str, group: Any) -> None:
        self.name = f"{source.name}: {printable(name)}"
        try:
            found = attributes_of(group, (VALUE, SHAPE))
        except ValueError as error:
            raise SceneError(
                f"{self.name}: found {error}, expected {VALUE}, a number, and {SHAPE}, of rows"
            ) from error
        value, shape = one_of(found[VALUE]), found[SHAPE]
        shape = shape if isinstance(shape, list) else [shape]
        rows = all(type(n) is int and 0 <= n < 1 << 62 for n in shape)
        if type(value) not in (int, float, bool) or not shape or not rows:
            raise SceneError(
                f"{self.name}: found {VALUE}={value!r:.40} and {SHAPE}={shape!r:.80}, expected a "
                "number, and a shape of rows"
            )
        self.shape: tuple[int, ...] = tuple(shape)
        self._value = np.asarray(value)
        self.dtype: np.dtype[Any] = self._value.dtype

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        for first in range(0, self.shape[0], rows):
            n = min(rows, self.shape[0] - first)
            yield np.full((n, *self.shape[1:]), self._value)

    def frame(self, number: int) -> Constant:
        """Refuse to be taken for frames, which it has not."""
        raise SceneError(
            f"{self.name}: found a constant of shape {self.shape}, expected one dimension"
        )

    def shallow(self) -> Constant:
        """Refuse as `frame` does."""
        return self.frame(-1)


def one_of(value: Any) -> Any:
    """Return the number of a list of one, else the value."""
    return value[0] if isinstance(value, list) and len(value) == 1 else value
