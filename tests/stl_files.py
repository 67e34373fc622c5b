"""STL files as tests write them, of bytes and of text."""

from __future__ import annotations

import struct

import numpy as np

RNG = np.random.default_rng(5)
TRIANGLES = RNG.normal(size=(5, 3, 3)).astype(np.float32)


def binary(triangles=TRIANGLES, header=b"made by a test", count=None):
    """An STL file of bytes."""
    parts = [header.ljust(80, b"\0"), struct.pack("<I", len(triangles) if count is None else count)]
    for triangle in np.asarray(triangles, np.float32):
        parts.append(struct.pack("<12fH", 9, 8, 7, *triangle.reshape(-1).tolist(), 0xFFFF))
    return b"".join(parts)


def text(triangles=TRIANGLES, name="", *, end="\n"):
    """An STL file of text."""
    lines = [f"solid{name}"]
    for triangle in np.asarray(triangles).tolist():
        lines += ["facet normal 0 0.5 -1e-3", "outer loop"]
        lines += [f"  vertex {x!r} {y!r} {z!r}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return end.join([*lines, f"endsolid{name}", ""]).encode()


def expected(triangles):
    return [tuple(map(tuple, triangle)) for triangle in np.float64(triangles).tolist()]
