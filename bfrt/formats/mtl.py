"""MTL, the materials beside an OBJ file, as far as bfrt's have the same."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import NamedTuple

from bfrt.errors import SceneError
from bfrt.formats.source import Source, quoted
from bfrt.store.model import Material

log = logging.getLogger(__name__)

#: A library is small; this is read at the most.
LIBRARY_BYTES = 1 << 26

#: Illumination models from which on light is reflected.
MIRRORS = 3

#: Statements that are kept, and how many numbers each has.
NUMBERS = {b"Kd": 3, b"Ks": 3, b"Ns": 1, b"Ni": 1, b"d": 1, b"Tr": 1, b"illum": 1}


class Statement(NamedTuple):
    """Holds a line of a material; `numbers` is None where they are wrong."""

    line: int
    words: list[bytes]
    numbers: tuple[float, ...] | None


def read_mtl(path: Path) -> dict[bytes, Material]:
    """Return the materials of a library by their names.

    ``Kd`` is the color, ``d`` or ``Tr`` the transmittance, ``Ni`` the index of refraction; ``Ks``
    and ``Ns`` are kept where ``illum`` asks for reflection (3 and up), for in bfrt a specular
    surface is a mirror. A statement that counts and whose numbers are wrong is named in a warning,
    and its default taken: a color is no reason to refuse a mesh.

    Raises
    ------
    SceneError
        If the library is larger than any.
    StreamError
        If the system refuses to read it.
    """
    with Source(path) as source:
        if source.size > LIBRARY_BYTES:
            raise SceneError(f"{path}: found {source.size} bytes, expected {LIBRARY_BYTES} or less")
        text = source.head(source.most_text)
    library = Library(path)
    found: dict[bytes, Material] = {}
    name: bytes | None = None
    known: dict[bytes, Statement] = {}
    for number, line in enumerate(text.splitlines(), 1):
        key, *rest = words_of(line) or [b""]
        if key == b"newmtl":
            if name is not None:
                found[name] = library.material(known)
            name, known = line.strip()[len(key) :].strip(), {}
        elif key in NUMBERS and rest[:1] not in ([b"spectral"], [b"xyz"]):
            known[key] = Statement(number, [key, *rest], numbers_of(key, rest))
    if name is not None:
        found[name] = library.material(known)
    elif text.strip():
        log.warning("%s: found no newmtl, expected materials that begin with it", path)
    return found


def words_of(line: bytes) -> list[bytes]:
    """Split a line into words up to a comment, which a word begins: ``1.#IND`` begins none."""
    words = line.split()
    return words[: next((i for i, word in enumerate(words) if word.startswith(b"#")), len(words))]


def numbers_of(key: bytes, words: list[bytes]) -> tuple[float, ...] | None:
    """Return a statement's numbers, finite and not negative; one stands for a color's three."""
    if key == b"d" and words[:1] == [b"-halo"]:
        words = words[1:]
    words = words * 3 if NUMBERS[key] == 3 and len(words) == 1 else words[: NUMBERS[key]]
    try:
        found = tuple(map(float, words))
    except ValueError:
        return None
    good = all(math.isfinite(x) and 0 <= x < 3e38 for x in found) and b"_" not in b"".join(words)
    return found if good and len(found) == NUMBERS[key] else None


class Library:
    """Interprets the statements of a library's materials."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def material(self, known: dict[bytes, Statement]) -> Material:
        """Make a material of its statements; those that bfrt does not use are not checked."""
        red, green, blue = self._numbers(known, b"Kd", Material().color)
        transmittance = self._transmittance(known)
        mirrors = self._numbers(known, b"illum", (0.0,))[0] >= MIRRORS
        return Material(
            (red, green, blue),
            kd=1.0,
            ks=max(self._numbers(known, b"Ks", (0.0,))) if mirrors else 0.0,
            shine=self._numbers(known, b"Ns", (1.0,))[0] if mirrors else 1.0,
            transmittance=transmittance,
            ior=self._numbers(known, b"Ni", (1.0,))[0] or 1.0,
        )

    def _transmittance(self, known: dict[bytes, Statement]) -> float:
        if b"d" in known:
            through = 1.0 - self._numbers(known, b"d", (1.0,))[0]
        else:
            through = self._numbers(known, b"Tr", (0.0,))[0]
        return min(max(through, 0.0), 1.0)

    def _numbers(
        self, known: dict[bytes, Statement], key: bytes, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        """Return a statement's numbers, or a default where it is missing or wrong."""
        if key not in known:
            return default
        line, words, numbers = known[key]
        if numbers is None:
            log.warning(
                "%s: line %d: found %s, expected %s with %d finite numbers, 0 or more; "
                "its default is taken",
                self._path,
                line,
                quoted(b" ".join(words)),
                key.decode(),
                NUMBERS[key],
            )
            return default
        return numbers
