"""The state of a render: what it is between two depths, and what is saved between two passes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.budget import Room
from bfrt.checkpoint.soundness import Sound, expect
from bfrt.checkpoint.state import HEADER, Facts, SavedState, StateWriter
from bfrt.image.film import Film
from bfrt.image.image_buffer import ImageBuffer
from bfrt.phases.eye import EyeRays
from bfrt.phases.traversal import Queue
from bfrt.records import HIT, HIT_BYTES, QUEUED, QUEUED_BYTES
from bfrt.stats import Stats
from bfrt.store.store import Store
from bfrt.streams.spool import Spool
from bfrt.view import Views


@dataclass
class RenderState:
    """Holds all the state of a render between two depths.

    Attributes
    ----------
    bands : int
        The bands of rows of the frame.
    band : int
        The band of rows that is rendered, from 1.
    depth : int
        The depth that was traced last, from 1; 0 before the first.
    eye_rays : callable
        Makes the queue of the camera's rays to film elements [first, last), of the rows that the
        film has.
    queue : Queue
        Rays of the next depth: the camera's, then `waiting`.
    waiting, following : Spool
        Rays of the next depth and of the one after it.
    hits : Spool
        Hits that wait for shading; empty between depths.
    film : Film
        The light so far, of this band.
    image : ImageBuffer
        The bands before it, of all views.
    stats : Stats
        The counters so far.
    store : Store
        The scene.
    """

    bands: int
    band: int
    depth: int
    eye_rays: Callable[..., EyeRays]
    queue: Queue
    waiting: Spool
    following: Spool
    hits: Spool
    film: Film
    image: ImageBuffer
    stats: Stats
    store: Store

    @classmethod
    def first(
        cls, store: Store, room: Room, scratch: Path, views: Views, stats: Stats
    ) -> RenderState:
        """Return the state at the beginning.

        Parameters
        ----------
        room : Room
            What memory holds.
        scratch : Path
            Folder for what it does not.
        """
        frame = views.frame
        width, height = frame.width, frame.height
        film = Film(width, height, views.samples, room.rows, views.aovs, frame.views)

        def eye_rays(first: int, last: int, rows: NDArray[np.uint32] | None = None) -> EyeRays:
            return EyeRays(store, views.cameras, views.samples, first, last, rows)

        return cls(
            bands=room.bands(height),
            band=1,
            depth=0,
            eye_rays=eye_rays,
            queue=eye_rays(*film.elements()),
            waiting=Spool(QUEUED, room.queue, scratch),
            following=Spool(QUEUED, room.queue, scratch),
            hits=Spool(HIT, room.hits, scratch),
            film=film,
            image=ImageBuffer(width, height, scratch if room.frame_on_disk else None, frame.views),
            stats=stats,
            store=store,
        )

    def turn(self) -> None:
        """Go on to the next depth: the rays just made become the waiting ones."""
        self.hits.clear()
        self.waiting, self.following = self.following, self.waiting
        self.queue = self.waiting

    def next_band(self) -> None:
        """Go on to the next band, from its first depth on."""
        self.film.advance()
        self.band, self.depth = self.band + 1, 0
        self.queue = self.eye_rays(*self.film.elements())

    def take_rows(self, rows: NDArray[np.uint32]) -> None:
        """Begin with some rows of the frame's elements, which the film has room for."""
        self.film.take_rows(rows)
        self.queue = self.eye_rays(0, len(rows) * self.film.shape[1], rows)

    def close(self) -> None:
        """Free the disk."""
        for spool in (self.waiting, self.following, self.hits):
            spool.close()

    def bytes(self, hits: int) -> int:
        """Return about as many bytes as `save` writes, with so many hits."""
        queued = (len(self.waiting) + len(self.following)) * QUEUED_BYTES
        film = sum(plane.nbytes for plane, _ in self.film.planes())
        return queued + hits * HIT_BYTES + film + self.image.bytes

    def save(self, writer: StateWriter, hits: Iterable[NDArray[Any]]) -> Facts:
        """Save it between two passes, of which there is one for each load of hits in shading.

        Parameters
        ----------
        writer : StateWriter
        hits : iterable of ndarray
            Hits that wait for shading, where `hits` may have been parted.
        """
        for name, plane in self._planes():
            writer.put(name, [plane])
        writer.put("waiting", self.waiting.waiting())
        writer.put("following", self.following.waiting())
        writer.put("hits", hits)
        types = self.image.types()
        for name in types:
            writer.put(f"image.{name}", self.image.complete(name))
        return {
            "band": self.band,
            "depth": self.depth,
            "rows": self.film.held,
            "row": self.film.row,
            "eye_rays": None if self.queue is self.waiting else len(self.queue),
            "image": {name: dtype.str for name, dtype in types.items()},
        }

    def restore(self, saved: SavedState) -> None:
        """Go on from what was saved; the depth that was under way is the next one then."""
        facts = saved.facts
        self._check(saved)
        self.band, self.depth = facts["band"], facts["depth"] - 1
        self.film.begin_at(facts["row"])
        for name, plane in self._planes():
            saved.fill(name, plane)
        self.waiting.restore(saved.blocks("waiting", QUEUED))
        self.following.restore(saved.blocks("following", QUEUED))
        self.hits.restore(saved.blocks("hits", HIT))
        types = {name: np.dtype(text) for name, text in facts["image"].items()}
        channels = {name: saved.blocks(f"image.{name}", types[name]) for name in types}
        self.image.restore(types, channels, facts["row"])
        self.queue = self.waiting
        if facts["eye_rays"] is not None:
            eye_rays = self.eye_rays(*self.film.elements())
            eye_rays.leave(facts["eye_rays"])
            self.queue = eye_rays
        self.stats.go_on(facts["stats"])

    def _check(self, saved: SavedState) -> None:
        """Refuse what is not the state of a band of this frame."""
        facts, path = saved.facts, saved.folder / HEADER
        row, height = facts["row"], self.film.shape[0] - self.film.corners
        begins = row == self.film.held * (facts["band"] - 1) and row < height
        expect(path, "row", row, right=begins and facts["rows"] == self.film.held)
        expect(path, "depth", facts["depth"], right=facts["depth"] > 0)
        expect(path, "tracer", None, right=facts["shading"] or facts["tracer"] is not None)
        self.film.begin_at(row)
        first, last = self.film.elements()
        left = facts["eye_rays"]
        expect(
            path, "eye_rays", left, right=left is None or left <= len(self.eye_rays(first, last))
        )
        for name, dtype in facts["image"].items():
            pixels = saved.count(f"image.{name}", np.dtype(dtype))
            expect(path, name, pixels, right=pixels == row * self.image.pixels)
        expect(path, "image", [*facts["image"]], right=bool(facts["image"]) == (row > 0))
        saved.sound = Sound(self.store, (row * self.film.shape[1], last))

    def _planes(self) -> list[tuple[str, Any]]:
        """Return the arrays of the film by the names of their files."""
        return [(f"film{number}", plane) for number, (plane, _) in enumerate(self.film.planes())]
