"""Counters of work that many workers share: their sum, and those of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from bfrt.stats import Counters, Stats

#: The counters of a task, with the name of its worker.
Part = tuple[str, Stats]


@dataclass
class ClusterStats(Stats):
    """Holds the sum of the counters of all workers, and the counters of each.

    Seconds are sums too, so that they may be more than have passed; those of a whole render are
    the time that it took. ``peak_rss_bytes`` is the most that one worker has held.

    Attributes
    ----------
    workers : dict of str to bfrt.stats.Stats
        The counters of each worker, by its name.
    """

    workers: dict[str, Stats] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the counters under the keys that the documentation lists, ready for JSON."""
        each = {name: stats.as_dict() for name, stats in self.workers.items()}
        return {**super().as_dict(), "workers": each}


def summed(parts: Iterable[Part]) -> ClusterStats:
    """Return the counters of all tasks of some work, of which there is one at least."""
    parts = list(parts)
    _, first = parts[0]
    whole = ClusterStats(first.objects, first.scene_bytes, first.settings, first.marks_reused)
    for part in parts:
        add_part(whole, part)
    return whole


def add_part(whole: ClusterStats, part: Part) -> None:
    """Add the counters of a task to the sum, and to those of its worker."""
    name, stats = part
    own = whole.workers.setdefault(name, _nothing(stats))
    for target in (whole, own):
        _add(target, stats)


def _nothing(stats: Stats) -> Stats:
    return Stats(stats.objects, stats.scene_bytes, stats.settings, stats.marks_reused)


def _add(whole: Stats, stats: Stats) -> None:
    """Add the counters of a task; what its session is like is that of the first."""
    whole.grids = whole.grids or stats.grids
    whole.tree = whole.tree or stats.tree
    whole.hierarchy_seconds = stats.hierarchy_seconds
    whole.bad_rays += stats.bad_rays
    whole.unsure_points += stats.unsure_points
    whole.total.add(stats.total)
    while len(whole.depths) < len(stats.depths):
        whole.depths.append(Counters())
    for mine, theirs in zip(whole.depths, stats.depths, strict=False):
        mine.add(theirs)
    whole.peak_rss_bytes = max(whole.peak_rss_bytes, stats.peak_rss_bytes)
