"""Counters of what goes between the client and the workers: records, as they travel."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from bfrt.cluster.counters import ClusterStats
from bfrt.wavefront.cargo import Cargo


@dataclass
class Sent:
    """Counts what is sent with tasks.

    Attributes
    ----------
    legs : int
        Tasks.
    bytes_sent : int
        Of the records, as they travel.
    """

    legs: int = 0
    bytes_sent: int = 0

    def depart(self, cargo: Cargo) -> None:
        """Count a task, and what goes with it."""
        self.legs += 1
        self.bytes_sent += len(cargo)


@dataclass
class Travel(Sent):
    """Counts rays on their way to be traced.

    Attributes
    ----------
    rays : int
        Rays sent: each as often as it goes to a carrier.
    found : int
        Records that come back: hits, counts, or rays that something stops.
    bytes_received : int
        Of these, as they travel.
    """

    rays: int = 0
    found: int = 0
    bytes_received: int = 0

    def sent(self, rays: int, cargo: Cargo) -> None:
        """Count rays that depart."""
        self.rays += rays
        self.depart(cargo)

    def came(self, found: int, cargo: Cargo) -> None:
        """Count what has come back for them."""
        self.found += found
        self.bytes_received += len(cargo)


@dataclass
class ShadingTravel(Sent):
    """Counts hits on their way to be shaded, and what comes back.

    Attributes
    ----------
    hits : int
        Hits sent: each once.
    rays : int
        Rays that go on from them.
    elements : int
        Elements of the film that get light.
    bytes_of_rays, bytes_of_film : int
        Of what comes back, as it travels.
    """

    hits: int = 0
    rays: int = 0
    elements: int = 0
    bytes_of_rays: int = 0
    bytes_of_film: int = 0


@dataclass
class DepthTravel:
    """Counts what travels for the rays of one depth of a render.

    Attributes
    ----------
    rays : int
        Rays of the depth.
    tracing : Travel
    shading : ShadingTravel
    """

    rays: int = 0
    tracing: Travel = field(default_factory=Travel)
    shading: ShadingTravel = field(default_factory=ShadingTravel)

    @property
    def bytes(self) -> int:
        """Return all bytes, both ways."""
        one, other = self.tracing, self.shading
        traced = one.bytes_sent + one.bytes_received
        return traced + other.bytes_sent + other.bytes_of_rays + other.bytes_of_film


@dataclass
class TravelStats(ClusterStats):
    """Holds the counters of all workers, and what has travelled for a query.

    Attributes
    ----------
    travel : Travel
    """

    travel: Travel = field(default_factory=Travel)

    def as_dict(self) -> dict[str, Any]:
        """Return the counters under the keys that the documentation lists, ready for JSON."""
        return {**super().as_dict(), "travel": asdict(self.travel)}


@dataclass
class RenderStats(ClusterStats):
    """Holds the counters of all workers, and what has travelled for a picture.

    Attributes
    ----------
    travel : list of DepthTravel
        Of each depth, all bands together.
    """

    travel: list[DepthTravel] = field(default_factory=list)

    def travel_of(self, depth: int) -> DepthTravel:
        """Return the counters of a depth, from 1."""
        while len(self.travel) < depth:
            self.travel.append(DepthTravel())
        return self.travel[depth - 1]

    def as_dict(self) -> dict[str, Any]:
        """Return the counters under the keys that the documentation lists, ready for JSON."""
        return {**super().as_dict(), "travel": [asdict(depth) for depth in self.travel]}
