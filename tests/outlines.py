"""Outlines of faces, and what triangles must be to fill them."""

from __future__ import annotations

import numpy as np
import pytest

from bfrt.formats.reading import Reading
from bfrt.formats.triangulation import Triangulation

U = [(0, 0), (3, 0), (3, 4), (2, 4), (2, 1), (1, 1), (1, 4), (0, 4)]
KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]

#: Two dents between teeth, their corners on lines with others.
COMB = [(0, 0), (4, 0), (4, 2), (3, 1), (2, 2), (1, 1), (0, 2)]
BOW_TIE = [(0, 0), (2, 2), (2, 0), (0, 2)]


def raised(outline, height=lambda x, y: 0.25 * x + 0.5 * y):
    """An outline as a face in space."""
    return np.array([(x, y, height(x, y)) for x, y in outline], np.float64)


def write(path, vertices, faces):
    """An OBJ file."""
    lines = ["v " + " ".join(map(repr, row)) for row in np.asarray(vertices, float).tolist()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def write_one(path, corners):
    """A file of a single face."""
    write(path, corners, [range(len(corners))])


def newell(corners):
    """The area of a face as a vector."""
    rest = corners - corners[0]
    return np.cross(rest, np.roll(rest, -1, axis=0)).sum(axis=0) / 2


def triangles_of(corners, counts=None, dtype=np.float64):
    """The triangles of faces (k, 3, 3), and what is told of them."""
    corners = np.asarray(corners, dtype)
    counts = np.array([len(corners)] if counts is None else counts, np.uint32)
    made = Triangulation("x", Reading(triangulate=True))
    triangles = made.triangles(corners, counts, np.arange(len(counts)))
    return triangles.reshape(-1, 3, 3), made


def areas_of(triangles, normal):
    """Signed areas as seen along a normal."""
    a, b, c = np.moveaxis(triangles.astype(float), 1, 0)
    return np.cross(b - a, c - a) @ (normal / np.linalg.norm(normal)) / 2


def check_filled(corners, triangles):
    """The triangles fill the face, turn as it does, and have all its edges and each other's."""
    area = newell(np.asarray(corners, float))
    parts = areas_of(triangles, area)
    assert len(triangles) == len(corners) - 2
    assert parts.min() >= -1e-9 * np.linalg.norm(area)
    assert parts.sum() == pytest.approx(np.linalg.norm(area), rel=1e-9)
    check_closed(corners, triangles)


def check_closed(corners, triangles):
    """Edges that are passed one way only are those of the face."""
    ring = [tuple(row) for row in np.asarray(corners).tolist()]
    left = {}
    edges = list(zip(ring, [*ring[1:], ring[0]], strict=True))
    for a, b, c in triangles.tolist():
        edges += [(tuple(q), tuple(p)) for p, q in ((a, b), (b, c), (c, a))]
    for p, q in edges:
        left[p, q] = left.get((p, q), 0) + 1
    assert all(count == left.get((q, p), 0) for (p, q), count in left.items())


def turned(outline, seed, dtype):
    """An outline in a plane that lies anywhere."""
    rng = np.random.default_rng(seed)
    axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (np.asarray(outline, float) @ axes[:2] + rng.normal(size=3) * 10).astype(dtype)
