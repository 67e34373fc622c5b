"""What a file contains, told by a bounded look at it, and the option that takes each part.

A format tells it by one function, ``contents_of_FORMAT(path) -> list of Row``, which
`bfrt.conversion.contents` has in its table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from bfrt.errors import SceneError
from bfrt.formats.source import CHUNK_BYTES, Source

#: The options that take a column of numbers.
COLOR = "--color-by {}"
RADIUS = "--radius {}"
OWN_COLORS = "--color-by rgb"
NORMALS = "normals: --smooth"
FACES = "faces"
VERTICES = "vertices"
POINTS = "points"


class Row(NamedTuple):
    """Describes a part of a file.

    Attributes
    ----------
    name : str
        Of an array, a column, a statement.
    shape : tuple of int
        Its rows, and what each has.
    dtype : str
        The type of its numbers.
    use : str
        What it becomes, and the options that take it; empty if nothing does.
    """

    name: str
    shape: tuple[int, ...]
    dtype: str
    use: str


def statements_of(path: str, uses: Mapping[str, str]) -> list[Row]:
    """Count the statements that the lines at a text's begin have, by their first words.

    Parameters
    ----------
    path : str
    uses : mapping of str to str
        The words that count, and what they become.

    Raises
    ------
    SceneError
        If there are none, and the text has no more.
    StreamError
        If the system refuses to read it.
    """
    with Source(path) as source:
        head = source.head(CHUNK_BYTES)
        is_whole = source.most_text <= CHUNK_BYTES
    lines = head.replace(b"\r", b"\n").split(b"\n")
    first = (line.split(maxsplit=1) for line in (lines if is_whole else lines[:-1]))
    found = Counter(words[0].decode("latin1") for words in first if words)
    if is_whole and not any(found[word] for word in uses):
        raise SceneError(f"{path}: found no line of {', '.join(uses)}, expected some")
    where = "text" if is_whole else f"text, first {CHUNK_BYTES >> 20} MiB"
    return [Row(word, (found[word],), where, use) for word, use in uses.items() if found[word]]
