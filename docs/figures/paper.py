"""The paper's figures 1 to 5, drawn anew: what is shown of voxels and rays is computed here.

python docs/figures/paper.py [FOLDER]
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

matplotlib.use("agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

Voxel = tuple[int, int]
Point = tuple[float, float]

INK, FAINT, RED, BLUE, GOLD = "#333333", "#bbbbbb", "#c1272d", "#2e6f9e", "#f0c060"


class Ball(NamedTuple):
    """An object: its middle and radius, in voxels."""

    x: float
    y: float
    r: float

    @property
    def region(self) -> set[Voxel]:
        """The voxels that its box covers."""
        columns = range(int(self.x - self.r), int(self.x + self.r) + 1)
        rows = range(int(self.y - self.r), int(self.y + self.r) + 1)
        return {(i, j) for i in columns for j in rows}

    def hit(self, ray: Ray) -> float | None:
        """The t of the nearest hit, or None."""
        to = np.subtract(ray.start, (self.x, self.y))
        d = np.array(ray.way)
        a, b, c = d @ d, to @ d, to @ to - self.r**2
        root = b * b - a * c
        return None if root < 0 else float((-b - root**0.5) / a)


class Ray(NamedTuple):
    """A ray: its name, start and direction, in voxels."""

    name: str
    start: Point
    way: Point

    def at(self, t: float) -> Point:
        return self.start[0] + t * self.way[0], self.start[1] + t * self.way[1]

    def walk(self, shape: Voxel) -> Iterator[tuple[Voxel, float]]:
        """The voxels that it goes through, each with the t at which it comes in."""
        voxel = [int(self.start[0]), int(self.start[1])]
        t = 0.0
        while 0 <= voxel[0] < shape[0] and 0 <= voxel[1] < shape[1]:
            yield (voxel[0], voxel[1]), t
            crossings = [
                ((voxel[k] + (d > 0)) - o) / d if d else np.inf
                for k, (o, d) in enumerate(zip(self.start, self.way, strict=True))
            ]
            k = int(np.argmin(crossings))
            t = crossings[k]
            voxel[k] += 1 if self.way[k] > 0 else -1


def grid(axis: Axes, shape: Voxel, step: int = 1, **style: Any) -> None:
    """Lines of a grid, each `step` voxels."""
    drawn: dict[str, Any] = {"color": FAINT, "linewidth": 0.6, "zorder": 1} | style
    for x in range(0, shape[0] + 1, step):
        axis.plot([x, x], [0, shape[1]], **drawn)
    for y in range(0, shape[1] + 1, step):
        axis.plot([0, shape[0]], [y, y], **drawn)


def fill(axis: Axes, voxels: set[Voxel], color: str, alpha: float = 0.55, side: int = 1) -> None:
    for i, j in voxels:
        axis.add_patch(Rectangle((i, j), side, side, color=color, alpha=alpha, linewidth=0))


def arrow(axis: Axes, start: Point, end: Point, color: str = INK, style: str = "-|>") -> None:
    axis.add_patch(
        FancyArrowPatch(start, end, arrowstyle=style, mutation_scale=9, color=color, shrinkA=0,
                        shrinkB=0, zorder=4)
    )  # fmt: skip


def panel(axis: Axes, shape: Voxel, title: str) -> None:
    axis.set(xlim=(-0.7, shape[0] + 0.3), ylim=(-0.4, shape[1] + 0.4), aspect="equal")
    axis.set_title(title, fontsize=9)
    axis.axis("off")


SHAPE = (8, 6)
BALLS = (Ball(3.6, 3.9, 0.75), Ball(6.4, 3.6, 0.8), Ball(5.2, 1.4, 0.5))
RAYS = (
    Ray("r1", (0, 3.0), (8, 0.75)),
    Ray("r2", (0, 5.4), (8, 0.3)),
    Ray("r3", (0, 0.1), (8, 3.36)),
)


def intersection(axes: Any) -> None:
    """Figure 1: marks, and two passes of rays that are stored in one candidate each."""
    marked = set().union(*(ball.region for ball in BALLS))
    stored: dict[str, list[Voxel]] = {}
    for ray in RAYS:
        stored[ray.name] = [voxel for voxel, _ in ray.walk(SHAPE) if voxel in marked]
    titles = ("(a) voxels that boxes cover are marked", "(b) the first pass", "(c) the second pass")
    for number, (axis, title) in enumerate(zip(axes, titles, strict=True)):
        panel(axis, SHAPE, title)
        grid(axis, SHAPE)
        fill(axis, marked, FAINT, 0.35)
        for ball in BALLS:
            axis.add_patch(Circle((ball.x, ball.y), ball.r, fill=False, color=INK, linewidth=1.2))
            corner = (ball.x - ball.r, ball.y - ball.r)
            side = 2 * ball.r
            axis.add_patch(Rectangle(corner, side, side, fill=False, color=BLUE, linewidth=0.9))
        for ray in RAYS:
            _of_a_pass(axis, ray, stored[ray.name], number)


def _of_a_pass(axis: Axes, ray: Ray, candidates: list[Voxel], number: int) -> None:
    """A ray as far as it has come when so many passes have ended."""
    axis.text(ray.start[0] - 0.1, ray.start[1], ray.name, ha="right", va="center", fontsize=8)
    there = candidates[:number]
    hits = [(t, ball) for ball in BALLS if (t := ball.hit(ray)) is not None and t > 0]
    met = [t for t, ball in hits if any(voxel in ball.region for voxel in there)]
    if number and len(there) == number:
        fill(axis, {there[-1]}, GOLD, 0.9)
    if number and not candidates:
        arrow(axis, ray.start, ray.at(1), FAINT)
        return
    ends = [t for voxel, t in ray.walk(SHAPE) if there and voxel == there[-1]]
    arrow(axis, ray.start, ray.at(1 if number == 0 else min([ends[0] + 0.06, *met])))
    if met:
        axis.plot(*ray.at(min(met)), "o", color=RED, markersize=5, zorder=5)


def formats(axes: Any) -> None:
    """Figure 2: files of geometry and boxes, and the hierarchy above."""
    (axis,) = axes
    axis.set(xlim=(0, 17), ylim=(0, 6.6))
    axis.axis("off")
    rows = [("geometry", 0.3, 8, "#dddddd"), ("boxes", 2.0, 8, "#bcd6e8")]
    rows += [("parents, level 1", 3.7, 4, "#7fb3d5"), ("parents, level 2", 5.4, 1, "#2e6f9e")]
    spans = {4: [(0, 3), (3, 4), (4, 6), (6, 8)], 1: [(0, 4)]}
    for name, y, count, color in rows:
        axis.text(0, y + 0.4, name, va="center", fontsize=9)
        for k in range(count):
            x = 3.6 + 1.65 * k
            axis.add_patch(Rectangle((x, y), 1.55, 0.8, facecolor=color, edgecolor=INK))
            if count != 8:
                children = spans[count][k]
                below = y - 1.7
                for child in (children[0], children[1] - 1):
                    arrow(axis, (x + 0.78, y), (3.6 + 1.65 * child + 0.78, below + 0.8), BLUE)
            elif name == "boxes":
                arrow(axis, (x + 0.78, y), (x + 0.78, 1.1), FAINT)


PARENTS = ((0.4, 4.9, 1.4, 0.8), (2.4, 0.3, 0.9, 5.2), (4.3, 4.4, 1.2, 1.3), (4.4, 1.1, 1.4, 0.9),
           (0.3, 0.5, 1.6, 1.3), (0.4, 2.4, 5.3, 0.4))  # fmt: skip


def subspaces(axes: Any) -> None:
    """Figure 3: which parents reach into a subspace, by cubes and by layers."""
    cuts = (("(a) cubes, the paper's", (3, 3, 3, 3)), ("(b) layers, ours", (0, 4, 6, 2)))
    for axis, (title, (x, y, width, height)) in zip(axes, cuts, strict=True):
        near = [
            px < x + width and px + w > x and py < y + height and py + h > y
            for px, py, w, h in PARENTS
        ]
        panel(axis, (6, 6), f"{title}: {sum(near)} of {len(near)} are looked into")
        grid(axis, (6, 6), linewidth=0.4)
        axis.add_patch(Rectangle((x, y), width, height, color=GOLD, alpha=0.5))
        lines = {"color": INK, "linewidth": 1.8}
        for place in (0, 3, 6) if width == 3 else (0, 2, 4, 6):
            axis.plot([0, 6], [place, place], **lines)
            ends = ([place, place], [0, 6]) if width == 3 else ([min(place, 6)] * 2, [0, 6])
            if width == 3 or place in (0, 6):
                axis.plot(*ends, **lines)
        for reaches, (px, py, w, h) in zip(near, PARENTS, strict=True):
            color = RED if reaches else BLUE
            axis.add_patch(Rectangle((px, py), w, h, fill=False, color=color, linestyle="--"))


SLABS = (Ray("r1", (0.6, 4.5), (5, -1.4)), Ray("r2", (11.3, 0.7), (-5, 1.1)),
         Ray("r3", (4.4, 0.8), (5, 1.2)), Ray("r4", (7.4, 4.6), (-5, -1.3)),
         Ray("r5", (9.6, 1.6), (0, 1)))  # fmt: skip


def slabs(axes: Any) -> None:
    """Figure 4: rays go through slabs, the ascending ones first, then those that descend."""
    shape, wide = (12, 5), 3
    names = (
        ("(a) slabs from the first to the last", 1),
        ("(b) and from the last to the first", -1),
    )
    for axis, (title, way) in zip(axes, names, strict=True):
        panel(axis, shape, title)
        grid(axis, shape, linewidth=0.4)
        for x in range(0, shape[0] + 1, wide):
            axis.plot([x, x], [0, shape[1]], color=INK, linewidth=1.8)
        for ray in SLABS:
            now = ray.way[0] * way > 0 or (ray.way[0] == 0 and way > 0)
            voxels = list(ray.walk(shape))[:9]
            if now:
                fill(axis, {voxel for voxel, _ in voxels}, GOLD, 0.45)
            arrow(axis, ray.start, ray.at(voxels[-1][1]), RED if now else FAINT)
            axis.text(*ray.start, f"{ray.name} ", ha="right", va="bottom", fontsize=8)
        first, last = (0.2, shape[0] - 0.2)[::way]
        arrow(axis, (first, -0.25), (last, -0.25), BLUE)


CROWD = (Ray("", (0, 5.2), (8, -1.5)), Ray("", (0, 4.4), (8, 0.3)), Ray("", (0.2, 0), (6, 8)),
         Ray("", (0, 1.6), (8, -0.4)))  # fmt: skip
WANTED = {(1, 5), (2, 4), (6, 1)}


def two_levels(axes: Any) -> None:
    """Figure 5: rays in upper voxels, and in the voxels of a lower-level block."""
    shape, side = (8, 8), 4
    through = [[v for v, _ in ray.walk(shape) if v in WANTED] for ray in CROWD]
    uppers = {(i // side * side, j // side * side) for i, j in WANTED}
    count = {u: sum(u == (i // side * side, j // side * side) for own in through for i, j in own)
             for u in uppers}  # fmt: skip
    most = max(count, key=lambda upper: count[upper])
    titles = ("(a) where rays are to be stored", "(b) upper voxels, with their rays",
              "(c) the block goes to the fullest", "(d) the others keep place and ray")  # fmt: skip
    for axis, title in zip(axes, titles, strict=True):
        panel(axis, shape, title)
    for axis in axes[:1]:
        grid(axis, shape)
        fill(axis, WANTED, GOLD, 0.9)
        for ray in CROWD:
            arrow(axis, ray.start, ray.at([t for _, t in ray.walk(shape)][-1]), RED)
    for axis in axes[1:]:
        grid(axis, shape, side, color=INK, linewidth=1.6)
    fill(axes[1], uppers, GOLD, 0.5, side)
    for (i, j), rays in count.items():
        axes[1].text(i + side / 2, j + side / 2, f"{rays} to store", ha="center", fontsize=8)
    inside = {v for v in WANTED if (v[0] // side * side, v[1] // side * side) == most}
    _block(axes[2], most, side)
    fill(axes[2], inside, GOLD, 0.9)
    rest = uppers - {most}
    fill(axes[3], rest, GOLD, 0.5, side)
    for i, j in rest:
        listed = "\n".join(f"ray, voxel {v}" for own in through for v in own if v not in inside)
        axes[3].text(i + side / 2, j + side / 2, listed, ha="center", va="center", fontsize=8)


def _block(axis: Axes, corner: Voxel, side: int) -> None:
    i, j = corner
    for k in range(side + 1):
        axis.plot([i + k, i + k], [j, j + side], color=FAINT, linewidth=0.8)
        axis.plot([i, i + side], [j + k, j + k], color=FAINT, linewidth=0.8)


FIGURES = {
    "intersection": (intersection, 3, (9.0, 2.6)),
    "formats": (formats, 1, (7.2, 2.6)),
    "subspaces": (subspaces, 2, (6.4, 3.3)),
    "slabs": (slabs, 2, (9.0, 2.4)),
    "two_levels": (two_levels, 4, (9.4, 2.7)),
}


def main(folder: str = str(Path(__file__).parent)) -> None:
    for name, (draw, panels, size) in FIGURES.items():
        figure, axes = pyplot.subplots(1, panels, figsize=size, squeeze=False, layout="constrained")
        draw(axes[0])
        figure.savefig(Path(folder) / f"{name}.png", dpi=110, metadata={"Software": None})
        pyplot.close(figure)


if __name__ == "__main__":
    main(*sys.argv[1:])
