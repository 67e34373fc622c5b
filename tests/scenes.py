"""Random scenes and rays that are hard to trace, for tests of every room.

All generators take a ``numpy.random.Generator``: the same seed makes the same scene.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bfrt.records import Kind
from bfrt.reference.independent import Objects

Array = NDArray[np.float64]
Rays = tuple[Array, Array]

EVERY_KIND = tuple(Kind)
LATTICE = 8  # cells an axis of the scene on a grid


# --- scenes ------------------------------------------------------------------------------------


def random_objects(
    rng: np.random.Generator,
    n: int,
    kinds: Sequence[Kind] = EVERY_KIND,
    spread: float = 10.0,
    size: float = 0.5,
) -> Objects:
    """`n` objects of about `size`, their centres in a cube of side `spread` around the origin.

    One radius of ten is negative; cones are cones, truncated cones and cylinders; polygons have
    three to eight vertices and are mostly concave.
    """
    counts = dict(zip(kinds, np.bincount(rng.integers(len(kinds), size=n), minlength=len(kinds)),
                      strict=True))  # fmt: skip

    def centres(kind: Kind) -> Array:
        return rng.uniform(-spread / 2, spread / 2, (counts.get(kind, 0), 3))

    corners = _corners(rng, centres(Kind.PATCH), size)
    vertices, sides = _polygons(rng, centres(Kind.POLYGON), size)
    return Objects(
        spheres=_spheres(rng, centres(Kind.SPHERE), size),
        cones=_cones(rng, centres(Kind.CONE), size),
        triangles=_corners(rng, centres(Kind.TRIANGLE), size),
        patches=np.hstack([corners, np.tile(units(rng, len(corners)), 3)]),
        vertices=vertices,
        counts=sides,
    )


def _spheres(rng: np.random.Generator, centres: Array, size: float) -> Array:
    radius = size * rng.uniform(0.1, 0.5, len(centres)) * _signs(rng, len(centres))
    return np.column_stack([centres, radius])


def _cones(rng: np.random.Generator, centres: Array, size: float) -> Array:
    n = len(centres)
    half = units(rng, n) * size * rng.uniform(0.1, 0.5, (n, 1))
    base = size * rng.uniform(0.05, 0.3, n)
    form = rng.integers(3, size=n)
    apex = np.choose(form, [np.zeros(n), base, size * rng.uniform(0.05, 0.3, n)])
    sign = _signs(rng, n)
    return np.column_stack([centres - half, sign * base, centres + half, sign * apex])


def _corners(rng: np.random.Generator, centres: Array, size: float) -> Array:
    return np.tile(centres, 3) + size * rng.uniform(-0.5, 0.5, (len(centres), 9))


def _polygons(
    rng: np.random.Generator, centres: Array, size: float, flat: bool = False
) -> tuple[Array, NDArray[np.int64]]:
    """Stars around their centres, in a plane of their own or, if `flat`, in that of z."""
    counts = rng.integers(3, 9, len(centres))
    owner = np.repeat(np.arange(len(centres)), counts)
    step = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    angle = 2 * np.pi * (step + rng.uniform(-0.3, 0.3, len(owner))) / counts[owner]
    reach = size * rng.uniform(0.1, 0.5, len(owner))
    normal = np.tile([0.0, 0.0, 1.0], (len(centres), 1)) if flat else units(rng, len(centres))
    one, two = (axis[owner] for axis in frames(normal))
    across = reach * np.cos(angle), reach * np.sin(angle)
    return centres[owner] + across[0][:, None] * one + across[1][:, None] * two, counts


def _signs(rng: np.random.Generator, n: int) -> Array:
    return np.where(rng.random(n) < 0.1, -1.0, 1.0)


def hard_scenes(rng: np.random.Generator) -> dict[str, Objects]:
    """Scenes by what is hard about them."""
    return {
        "empty": Objects(),
        **{f"one {kind.label}": random_objects(rng, 1, [kind]) for kind in Kind},
        "huge beside tiny": joined(
            random_objects(rng, 12, spread=10.0, size=40.0),
            random_objects(rng, 600, spread=10.0, size=0.01),
        ),
        "overlapping": random_objects(rng, 2000, spread=1.0, size=1.0),
        "twice the same": twice(random_objects(rng, 200)),
        "flat": flat_scene(rng, 300),
        "grid": lattice_scene(rng),
        "far from the origin": moved(random_objects(rng, 300), np.array([5e5, 4.5e6, -120.0])),
    }


def flat_scene(
    rng: np.random.Generator, n: int, spread: float = 10.0, size: float = 1.0
) -> Objects:
    """Triangles, patches and polygons, `n` of each, all of them in the plane z = 0."""

    def centres() -> Array:
        return rng.uniform(-spread / 2, spread / 2, (n, 3)) * [1.0, 1.0, 0.0]

    onto_plane = np.tile([1.0, 1.0, 0.0], 3)
    vertices, counts = _polygons(rng, centres(), size, flat=True)
    return Objects(
        triangles=_corners(rng, centres(), size) * onto_plane,
        patches=np.hstack([
            _corners(rng, centres(), size) * onto_plane,
            np.tile([0.0, 0.0, 1.0], (n, 3)),
        ]),
        vertices=vertices,
        counts=counts,
    )  # fmt: skip


def lattice_scene(rng: np.random.Generator) -> Objects:
    """Objects of the unit cube whose boxes begin and end on a grid: on voxels' walls, likely.

    Every coordinate is a multiple of 1/16, so a float32 holds it.
    """
    cell = np.stack(np.meshgrid(*[np.arange(LATTICE)] * 3, indexing="ij"), -1).reshape(-1, 3)
    low = cell / LATTICE
    kind = rng.permutation(len(low)) % len(Kind)
    axes = np.eye(3) / LATTICE
    turn = rng.integers(3, size=len(low))
    one, two = axes[(turn + 1) % 3], axes[(turn + 2) % 3]
    faces = np.stack([low, low + one, low + one + two, low + two], axis=1)

    def of(which: Kind, rows: Array) -> Array:
        return rows[kind == which]

    middle = low + 0.5 / LATTICE
    half = np.full((len(low), 1), 0.5 / LATTICE)
    corners = faces[:, :3].reshape(-1, 9)
    base = middle - axes[turn] / 2
    squares = of(Kind.POLYGON, faces)
    return Objects(
        spheres=of(Kind.SPHERE, np.hstack([middle, half])),
        cones=of(
            Kind.CONE, np.hstack([base, half, base + axes[turn], half * (turn[:, None] == 0)])
        ),
        triangles=of(Kind.TRIANGLE, corners),
        patches=of(Kind.PATCH, np.hstack([corners, np.tile(np.eye(3)[turn], 3)])),
        vertices=squares.reshape(-1, 3),
        counts=np.full(len(squares), 4),
    )


def joined(*parts: Objects) -> Objects:
    """One scene of several, the objects of each kind one after another."""
    return Objects(
        spheres=np.concatenate([part.spheres for part in parts]),
        cones=np.concatenate([part.cones for part in parts]),
        triangles=np.concatenate([part.triangles for part in parts]),
        patches=np.concatenate([part.patches for part in parts]),
        vertices=np.concatenate([part.vertices for part in parts]),
        counts=np.concatenate([part.counts for part in parts]),
    )


def twice(objects: Objects) -> Objects:
    """Every object and its double: of each two, the one with the lesser id is the nearest."""
    return joined(objects, objects)


def mapped(
    objects: Objects, axes: Sequence[int] = (0, 1, 2), offset: Array | float = 0.0
) -> Objects:
    """The scene with its axes permuted, then moved; an odd permutation mirrors it."""
    rows = list(axes)

    def placed(points: Array) -> Array:
        return (points.reshape(-1, 3)[:, rows] + offset).reshape(points.shape)

    spheres, cones, patches = objects.spheres, objects.cones, objects.patches
    return Objects(
        spheres=np.hstack([placed(spheres[:, :3]), spheres[:, 3:]]),
        cones=np.hstack([
            placed(cones[:, :3]), cones[:, 3:4], placed(cones[:, 4:7]), cones[:, 7:]
        ]),
        triangles=placed(objects.triangles),
        patches=np.hstack([
            placed(patches[:, :9]),
            patches[:, 9:].reshape(-1, 3)[:, rows].reshape(-1, 9),
        ]),
        vertices=placed(objects.vertices),
        counts=objects.counts,
    )  # fmt: skip


def moved(objects: Objects, offset: Array) -> Objects:
    return mapped(objects, offset=offset)


# --- rays --------------------------------------------------------------------------------------


def random_rays(rng: np.random.Generator, objects: Objects, n: int) -> dict[str, Rays]:
    """`n` rays of each sort, by what is hard about them: origins and directions, (n, 3) each."""
    low, high = box(objects)
    ends, others = _segments(objects)
    origins = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (n, 3))
    inside = rng.uniform(low, high, (n, 3))
    vertex = ends[rng.integers(len(ends), size=n)]
    edge = rng.integers(len(ends), size=n)
    along = ends[edge] + rng.random((n, 1)) * (others[edge] - ends[edge])
    corner = _corners_of_grid(rng, low, high, n)
    second = _corners_of_grid(rng, low, high, n)
    across = np.where((second == corner).all(axis=1, keepdims=True), high - low, second - corner)
    axis = _axis_directions(rng, n)
    return {
        "random": (origins, inside - origins),
        "along an axis": (inside - axis * np.max(high - low), axis),
        "in a plane of the grid": _in_plane(rng, vertex, n),
        "grazing": _grazing(rng, objects, n),
        "from far away": _far(rng, inside, low, high),
        "from inside": (_interior(rng, objects, n), units(rng, n)),
        "from a vertex": (vertex, units(rng, n)),
        "from a corner of the grid": (corner, units(rng, n)),
        "along an axis from a corner of the grid": (corner, axis),
        "at a vertex": (origins, vertex - origins),
        "at an edge": (origins, along - origins),
        "at a corner of the grid": (origins, corner - origins),
        "through two corners of the grid": (corner - 3 * across, across),
        "almost parallel": _almost_parallel(rng, inside, axis, np.max(high - low)),
        "of any length": (origins, (inside - origins) * 10 ** rng.uniform(-3, 3, (n, 1))),
    }


def box(objects: Objects) -> tuple[Array, Array]:
    """The bounds, a unit cube if there are no objects; no side is zero."""
    low, high = objects.bounds()
    if not len(objects):
        return np.zeros(3), np.ones(3)
    least = 1e-3 * np.max(high - low) * (high == low)
    return low - least, high + least


def units(rng: np.random.Generator, n: int) -> Array:
    """`n` directions of length one, from all sides alike."""
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def frames(normal: Array) -> tuple[Array, Array]:
    """For each unit vector two more, so that the three are at right angles."""
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    one = np.cross(normal, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    return one, np.cross(normal, one)


def _segments(objects: Objects) -> tuple[Array, Array]:
    """Two points of each edge: outlines, cones' axes, spheres' centres with their tops."""
    top = objects.spheres[:, :3] + objects.spheres[:, 3:] * [0.0, 0.0, 1.0]
    triangles = np.concatenate([objects.triangles, objects.patches[:, :9]]).reshape(-1, 3, 3)
    turned = np.roll(triangles, -1, axis=1)
    following = np.arange(1, len(objects.vertices) + 1)
    last = np.cumsum(objects.counts)
    following[last - 1] = last - objects.counts
    ends = [
        objects.spheres[:, :3],
        objects.cones[:, :3],
        triangles.reshape(-1, 3),
        objects.vertices,
    ]
    others = [top, objects.cones[:, 4:7], turned.reshape(-1, 3), objects.vertices[following]]
    if not len(objects):
        return np.zeros((1, 3)), np.ones((1, 3))
    return np.concatenate(ends), np.concatenate(others)


def _corners_of_grid(rng: np.random.Generator, low: Array, high: Array, n: int) -> Array:
    """Corners of the lattices of 1, 2, 4, ... 64 cells an axis."""
    cells = 2 ** rng.integers(0, 7, (n, 1))
    return low + (high - low) * rng.integers(0, cells + 1, (n, 3)) / cells


def _axis_directions(rng: np.random.Generator, n: int) -> Array:
    """Along the axes, either way; zeros of both signs."""
    direction = np.where(rng.random((n, 3)) < 0.5, -0.0, 0.0)
    direction[np.arange(n), rng.integers(3, size=n)] = rng.choice([-1.0, 1.0], n)
    return direction


def _in_plane(rng: np.random.Generator, points: Array, n: int) -> Rays:
    """Through `points`, with one component of the direction exactly zero."""
    direction = units(rng, n)
    axis = rng.integers(3, size=n)
    direction[np.arange(n), axis] = rng.choice([-0.0, 0.0], n)
    origins = points - 3.0 * direction
    return origins, direction


def _grazing(rng: np.random.Generator, objects: Objects, n: int) -> Rays:
    """Tangents of spheres, in planes of triangles, and along cones from base to apex."""
    through, direction = _interior(rng, objects, n), units(rng, n)
    if len(objects.spheres):
        part = slice(0, None, 3)
        s = objects.spheres[rng.integers(len(objects.spheres), size=len(through[part]))]
        through[part] = s[:, :3] + s[:, 3:] * frames(direction[part])[0]
    flat = np.concatenate([objects.triangles, objects.patches[:, :9]])
    if len(flat):
        part = slice(1, None, 3)
        t = flat[rng.integers(len(flat), size=len(through[part]))]
        weight = rng.uniform(-1, 1, (len(t), 2))
        through[part] = t[:, :3]
        direction[part] = weight[:, :1] * (t[:, 3:6] - t[:, :3]) + weight[:, 1:] * (
            t[:, 6:] - t[:, :3]
        )
    if len(objects.cones):
        part = slice(2, None, 3)
        c = objects.cones[rng.integers(len(objects.cones), size=len(through[part]))]
        axis = c[:, 4:7] - c[:, :3]
        out = frames(axis / np.linalg.norm(axis, axis=1, keepdims=True))[0]
        through[part] = c[:, :3] + c[:, 3:4] * out
        direction[part] = c[:, 4:7] + c[:, 7:] * out - through[part]
    return through - 4.0 * direction, direction


def _far(rng: np.random.Generator, targets: Array, low: Array, high: Array) -> Rays:
    """At `targets` from a million diagonals away, the direction unit."""
    direction = units(rng, len(targets))
    return targets - 1e6 * np.linalg.norm(high - low) * direction, direction


def _interior(rng: np.random.Generator, objects: Objects, n: int) -> Array:
    """Points well inside of spheres and cones, or on flat objects."""
    ends, others = _segments(objects)
    row = rng.integers(len(ends), size=n)
    return ends[row] + rng.uniform(0.1, 0.9, (n, 1)) * (others[row] - ends[row])


def _almost_parallel(rng: np.random.Generator, targets: Array, axis: Array, away: float) -> Rays:
    """Along `axis` but for components from 1e-300 to 1e-8."""
    tiny = rng.choice([1e-300, 1e-30, 1e-17, 1e-12, 1e-8, -1e-300, -1e-17, -1e-8], axis.shape)
    return targets - axis * away, np.where(axis == 0, tiny, axis)
