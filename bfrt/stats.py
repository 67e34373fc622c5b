"""Counters: what a render did, per phase and per depth, as a table and as JSON.

``bytes_read`` is what reads returned; ``seeks`` are reads that do not start where the last one of
that file ended; ``passes`` are sweeps over the objects, the preprocess's and the shading's too;
``box_tests`` are ray against object box, ``node_tests`` ray against a node of a tree, which has
eight boxes. Phase seconds are wall time and disjoint.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Protocol


class Scans(Protocol):
    """What reads objects, and knows how much it has read since it was asked last."""

    def counts(self) -> tuple[int, int]:
        """Bytes read, and seeks."""
        ...

    def geometry_read(self) -> int:
        """Objects whose geometry was read."""
        ...


class Spool(Protocol):
    """What writes and reads records, and knows how much since it was asked last."""

    def counts(self) -> tuple[int, int, int]:
        """Bytes read, bytes written and seeks."""
        ...


@dataclass
class Phase:
    """Counts one phase's time and traffic."""

    seconds: float = 0.0
    bytes_read: int = 0
    bytes_written: int = 0
    seeks: int = 0

    @contextmanager
    def timed(self) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds += time.perf_counter() - start

    def swept(self, scans: Scans) -> None:
        """Add the bytes and seeks of sweeps since the last call."""
        read, seeks = scans.counts()
        self.bytes_read += read
        self.seeks += seeks

    def spooled(self, spool: Spool) -> None:
        """Add the bytes and seeks of a spool since the last call."""
        read, written, seeks = spool.counts()
        self.bytes_read += read
        self.bytes_written += written
        self.seeks += seeks


@dataclass
class Rays:
    """Counts the rays sent, by kind, and the eye rays that hit."""

    eye: int = 0
    eye_hits: int = 0
    reflection: int = 0
    refraction: int = 0
    shadow: int = 0


@dataclass
class Phases:
    """Holds the counters of the four phases."""

    preprocess: Phase = field(default_factory=Phase)
    traversal: Phase = field(default_factory=Phase)
    intersection: Phase = field(default_factory=Phase)
    shading: Phase = field(default_factory=Phase)


@dataclass
class Counters:
    """Counts what happens in one depth, or in a whole render."""

    rays: Rays = field(default_factory=Rays)
    phases: Phases = field(default_factory=Phases)
    passes: int = 0
    boxes_read: int = 0
    geometry_read: int = 0
    box_tests: int = 0
    object_tests: int = 0
    voxel_steps: int = 0
    treelets_read: int = 0
    node_tests: int = 0
    seconds: float = 0.0

    def sweep(self, boxes: int, scans: Scans, begins: bool = True) -> None:
        """Count a pass, or the rest of one, with the boxes and the geometry that it read."""
        self.passes += begins
        self.boxes_read += boxes
        self.geometry_read += scans.geometry_read()

    def add(self, other: Any, to: Any = None) -> None:
        """Add another's counts to these, nested ones too."""
        target = self if to is None else to
        for f in fields(target):
            mine, theirs = getattr(target, f.name), getattr(other, f.name)
            if isinstance(mine, (int, float)):
                setattr(target, f.name, mine + theirs)
            else:
                self.add(theirs, mine)


def counters_of(counts: dict[str, Any]) -> Counters:
    """Return counters that `asdict` made a dict of."""

    def fill(target: Any, values: dict[str, Any]) -> None:
        for f in fields(target):
            if isinstance(values[f.name], dict):
                fill(getattr(target, f.name), values[f.name])
            else:
                setattr(target, f.name, values[f.name])

    made = Counters()
    fill(made, counts)
    return made


@dataclass
class Stats:
    """Holds the counters of a render, its settings and its memory."""

    objects: int
    scene_bytes: int
    settings: dict[str, Any]
    marks_reused: bool = False
    grids: list[dict[str, Any]] = field(default_factory=list)
    tree: dict[str, Any] | None = None
    hierarchy_seconds: float = 0.0
    bad_rays: int = 0
    unsure_points: int = 0
    total: Counters = field(default_factory=Counters)
    depths: list[Counters] = field(default_factory=list)
    peak_rss_bytes: int = 0

    @contextmanager
    def depth(self, number: int) -> Iterator[Counters]:
        """Yield counters, which at their end are added to those of depth `number` and the total."""
        counters = Counters()
        start = time.perf_counter()
        try:
            yield counters
        finally:
            counters.seconds = time.perf_counter() - start
            if number > len(self.depths):
                self.depths.append(Counters())
            self.depths[number - 1].add(counters)
            whole = self.total.seconds
            self.total.add(counters)
            self.total.seconds = whole

    def kept(
        self, number: int, counters: Counters, *, started: float, began: float
    ) -> dict[str, Any]:
        """Return the counts so far for JSON, with those of depth `number`, which goes on.

        Parameters
        ----------
        number : int
        counters : Counters
            Its counts.
        started, began : float
            When all the work started and when the depth began, by `time.perf_counter`.
        """
        total, depths = deepcopy((self.total, self.depths))
        while len(depths) < number:
            depths.append(Counters())
        depths[number - 1].add(counters)
        now, seconds = time.perf_counter(), total.seconds
        total.add(counters)
        total.seconds = seconds + now - started
        depths[number - 1].seconds += now - began
        return {
            "marks_reused": self.marks_reused,
            "total": asdict(total),
            "depths": [asdict(depth) for depth in depths],
        }

    def go_on(self, kept: dict[str, Any]) -> None:
        """Go on from the counts that `kept` returned."""
        self.marks_reused = kept["marks_reused"]
        self.total.add(counters_of(kept["total"]))
        self.depths = [counters_of(depth) for depth in kept["depths"]]

    def as_dict(self) -> dict[str, Any]:
        """Return the counters under the keys that the documentation lists, ready for JSON."""
        return {
            "objects": self.objects,
            "scene_bytes": self.scene_bytes,
            "settings": self.settings,
            "marks_reused": self.marks_reused,
            "grids": self.grids,
            "tree": self.tree,
            "hierarchy_seconds": self.hierarchy_seconds,
            "bad_rays": self.bad_rays,
            "unsure_points": self.unsure_points,
            **asdict(self.total),
            "peak_rss_bytes": self.peak_rss_bytes,
            "depths": [asdict(depth) for depth in self.depths],
        }

    def table(self) -> str:
        """Return a table for people: a row a depth, then the phases."""
        head = ("depth", "rays", "hits", "shadow", "passes", "box tests", "object tests", "seconds")
        rows = [head]
        for number, depth in enumerate([*self.depths, self.total], 1):
            rays = depth.rays
            sent = rays.eye + rays.reflection + rays.refraction
            rows.append(
                (
                    "all" if depth is self.total else str(number),
                    f"{sent:,}",
                    f"{rays.eye_hits:,}",
                    f"{rays.shadow:,}",
                    f"{depth.passes:,}",
                    f"{depth.box_tests:,}",
                    f"{depth.object_tests:,}",
                    f"{depth.seconds:.2f}",
                )
            )
        phases = [("phase", "seconds", "MB read", "MB written", "seeks")]
        for f in fields(Phases):
            phase = getattr(self.total.phases, f.name)
            phases.append(
                (
                    f.name,
                    f"{phase.seconds:.2f}",
                    f"{phase.bytes_read / 1e6:,.1f}",
                    f"{phase.bytes_written / 1e6:,.1f}",
                    f"{phase.seeks:,}",
                )
            )
        peak = f"peak memory {self.peak_rss_bytes / 2**20:.1f} MiB"
        return "\n".join([aligned(rows), "", aligned(phases), "", peak])


def aligned(rows: Sequence[tuple[str, ...]]) -> str:
    """Return rows of cells as a table with aligned columns."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    )


def peak_rss() -> int:
    """Return the most memory that this process has held, bytes.

    VmHWM where the system has it: ``ru_maxrss`` starts at the parent's.
    """
    try:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    except OSError:  # another system, or one that does not tell
        pass
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
