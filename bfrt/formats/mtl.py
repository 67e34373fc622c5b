"""MTL, the materials beside an OBJ file, as far as bfrt's have the same."""

from __future__ import annotations

import math
from pathlib import Path

from bfrt.errors import SceneError
from bfrt.formats.source import Source, shown
from bfrt.store.model import Material

#: A library is small; this is read at the most.
LIBRARY_BYTES = 1 << 26

#: Illumination models from which on light is reflected.
MIRRORS = 3

#: Statements that are kept, and how many numbers each has.
NUMBERS = {b"Kd": 3, b"Ks": 3, b"Ns": 1, b"Ni": 1, b"d": 1, b"Tr": 1, b"illum": 1}


def read_mtl(path: Path) -> dict[bytes, Material]:
    """The materials of a library by their names.

    ``Kd`` is the color, ``d`` or ``Tr`` the transmittance, ``Ni`` the index of refraction; ``Ks``
    and ``Ns`` are kept where ``illum`` asks for reflection (3 and up), for in bfrt a specular
    surface is a mirror.

    Raises
    ------
    SceneError
        For a statement of these whose numbers are wrong.
    StreamError
        If the system refuses to read it.
    """
    with Source(path) as source:
        text = source.read(LIBRARY_BYTES)
        if source.size > LIBRARY_BYTES:
            raise SceneError(f"{path}: found {source.size} bytes, expected {LIBRARY_BYTES} or less")
    found: dict[bytes, Material] = {}
    name: bytes | None = None
    known: dict[bytes, tuple[float, ...]] = {}
    for number, line in enumerate(text.splitlines(), 1):
        key, *rest = line.split(b"#")[0].split() or (b"",)
        if key == b"newmtl":
            if name is not None:
                found[name] = material_of(known)
            name, known = line.strip()[len(key) :].strip(), {}
        elif key in NUMBERS and rest[:1] not in ([b"spectral"], [b"xyz"]):
            known[key] = numbers_of(path, number, key, rest)
    if name is not None:
        found[name] = material_of(known)
    return found


def numbers_of(path: Path, line: int, key: bytes, words: list[bytes]) -> tuple[float, ...]:
    """A statement's numbers, finite and not negative; one color stands for all three."""
    if key == b"d" and words[:1] == [b"-halo"]:
        words = words[1:]
    words = words * 3 if NUMBERS[key] == 3 and len(words) == 1 else words
    try:
        found = tuple(float(word) for word in words[: NUMBERS[key]])
    except ValueError:
        found = ()
    if len(found) < NUMBERS[key] or not all(math.isfinite(x) and 0 <= x < 3e38 for x in found):
        raise SceneError(
            f"{path}: line {line}: found {shown(b' '.join((key, *words)))}, expected "
            f"{key.decode()} with {NUMBERS[key]} finite numbers, 0 or more"
        )
    return found


def material_of(known: dict[bytes, tuple[float, ...]]) -> Material:
    """What statements make of a material."""
    red, green, blue = known.get(b"Kd", Material().color)
    mirrors = known.get(b"illum", (0.0,))[0] >= MIRRORS
    opaque = known.get(b"d", (1.0 - known.get(b"Tr", (0.0,))[0],))[0]
    return Material(
        (red, green, blue),
        kd=1.0,
        ks=max(known.get(b"Ks", (0.0,))) if mirrors else 0.0,
        shine=known.get(b"Ns", (1.0,))[0] if mirrors else 1.0,
        transmittance=min(max(1.0 - opaque, 0.0), 1.0),
        ior=known.get(b"Ni", (1.0,))[0] or 1.0,
    )
