"""A picture of a sharded scene on a cluster: the depth loop is here, and all objects elsewhere.

::

    for each depth:
        cross        rays go to the carriers whose bounds they meet, nearest first
        settle       light of those that met nothing to the film; the others are hits
        shade        each hit where its object is; back come rays, and elements of the film

Film and queues are the client's: in bands of rows, and on its disk, where its memory does not hold
them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.budget import Room
from bfrt.cluster.counters import Part, add_part
from bfrt.cluster.watching import Watch
from bfrt.image.frame import FrameSize, held_frame
from bfrt.image.image_buffer import ImageBuffer, resolve
from bfrt.image.pictures import Images
from bfrt.memory import BASELINE, default_memory
from bfrt.phases.settling import set_out, settle
from bfrt.phases.shading import SHADED_HIT_BYTES
from bfrt.phases.traversal import FEWEST_RAYS
from bfrt.phases.viewpoints import viewpoints_of
from bfrt.progress import Progress, Report, tell
from bfrt.records import HIT, HIT_BYTES, QUEUED_BYTES
from bfrt.render_state import RenderState
from bfrt.rendering import images_of, tell_of_bad_rays
from bfrt.settings import scratch_folder
from bfrt.shards.store import ShardedStore
from bfrt.stats import Counters, Stats
from bfrt.view import Views
from bfrt.wavefront.cargo import BLOCK
from bfrt.wavefront.carriers import Carrier
from bfrt.wavefront.far_shading import FarShading, Owners
from bfrt.wavefront.ferry import Ferry
from bfrt.wavefront.frame_tasks import HitShading, Meeting, Preparing
from bfrt.wavefront.routing import Boxes, boxes_of
from bfrt.wavefront.site import Site
from bfrt.wavefront.travel import RenderStats, ShadingTravel, Travel
from bfrt.wavefront.window import AHEAD, Window

#: Of what a frame leaves of the client's memory: blocks of rays, hits, queues.
BLOCKS_PART = 0.3
HITS_PART = 0.3
QUEUES_PART = 0.3

#: A block of rays: itself, a copy that travels, one that comes, and its routes.
BLOCK_BYTES = BLOCK * 4 * HIT_BYTES


class ClientRoom(NamedTuple):
    """Tells what the client's memory holds: of the render, and blocks of rays under way."""

    render: Room
    blocks: int

    @classmethod
    def of(cls, frame: FrameSize, memory: int, carriers: int) -> ClientRoom:
        """Divide so many bytes."""
        left = memory - BASELINE
        held = held_frame(frame, left, FEWEST_RAYS)
        left = max(0, left - held.bytes)
        blocks = min(AHEAD * carriers + 1, int(left * BLOCKS_PART) // BLOCK_BYTES)
        hits = int(left * HITS_PART) // (HIT_BYTES + SHADED_HIT_BYTES)
        queue = int(left * QUEUES_PART) // (2 * QUEUED_BYTES)
        room = Room(held.rows, held.on_disk, max(hits, FEWEST_RAYS), max(queue, FEWEST_RAYS))
        return cls(room, max(1, blocks))


class Wave(NamedTuple):
    """Holds what is said of the whole work.

    Attributes
    ----------
    store : ShardedStore
        The scene, with no shard open here.
    carriers : list of Carrier
    sites : list of Site
        Each carrier's.
    """

    store: ShardedStore
    carriers: list[Carrier]
    sites: list[Site]

    @property
    def boxes(self) -> list[Boxes]:
        """Return the boxes of each carrier's shards."""
        shards = self.store.manifest.shards
        return [boxes_of(self.store, [shards[n] for n in each.numbers]) for each in self.carriers]


class FarRender:
    """Renders views together, band by band.

    Parameters
    ----------
    wave : Wave
    window : Window
    views : Views
    stats : RenderStats
        The counters of the render.
    report : Report
        Called after each task.
    """

    def __init__(
        self, wave: Wave, window: Window, views: Views, stats: RenderStats, report: Report
    ) -> None:
        store = wave.store
        room = ClientRoom.of(views.frame, default_memory(), len(wave.carriers))
        scratch = scratch_folder(None, store.path)
        self._wave = wave
        self._window = window
        self._views = views
        self._stats = stats
        self._report = report
        self._hits = room.render.hits
        self._background = np.array(views.illumination.background, np.float64)
        self._owners = Owners(store.manifest, wave.carriers)
        self._state = RenderState.first(store, room.render, scratch, views, stats)
        tasks = [Meeting(site) for site in wave.sites]
        self._ferry = Ferry(window, tasks, wave.boxes, room.blocks, self._count)

    def run(self) -> ImageBuffer:
        """Trace all bands; return the finished pictures."""
        state = self._state
        try:
            while True:
                while len(state.queue):
                    self._one_depth()
                resolve(state.film, state.image)
                if state.band == state.bands:
                    return state.image
                state.next_band()
        except BaseException:
            state.image.close()
            raise
        finally:
            state.close()

    def _one_depth(self) -> None:
        """Trace the waiting rays, and shade their hits."""
        state = self._state
        state.depth += 1
        rays, travel = len(state.queue), self._stats.travel_of(state.depth)
        travel.rays += rays
        with self._stats.depth(state.depth) as counters:
            if state.depth == 1:
                counters.rays.eye = rays
            self._trace(counters, travel.tracing)
            state.following.clear()
            self._shade(counters, travel.shading, rays)
        state.turn()

    def _trace(self, counters: Counters, travel: Travel) -> None:
        """Find the hits of the rays that wait."""
        state, rays = self._state, len(self._state.queue)
        for block in self._ferry.cross(
            self._setting_out(), travel, lambda through: self._tell(through, rays)
        ):
            hits, eye_hits = settle(block, state.film, self._background)
            state.hits.append(block[:hits])
            counters.rays.eye_hits += eye_hits

    def _shade(self, counters: Counters, travel: ShadingTravel, rays: int) -> None:
        """Shade the hits, and gather the rays that go on."""
        state, views = self._state, self._views
        seen = viewpoints_of(views, self._wave.store.origin)
        last = state.depth >= views.depth
        tasks = [HitShading(site, seen, views.aovs, last) for site in self._wave.sites]
        shading = FarShading(self._window, self._owners, tasks, self._hits, self._count)
        shading.shade(
            state.hits, state.film, state.following, travel, lambda: self._tell(rays, rays)
        )
        for spool in (state.hits, state.waiting, state.following):
            counters.phases.shading.spooled(spool)

    def _setting_out(self) -> Iterator[NDArray[Any]]:
        """Yield the rays that wait, in blocks, (n,) of records.HIT."""
        queue = self._state.queue
        while len(queue):
            some = queue.read(BLOCK)
            rays = np.empty(len(some), HIT)
            self._stats.bad_rays += set_out(some, rays)
            yield rays

    def _tell(self, through: int, rays: int) -> None:
        state = self._state
        tell(self._report, Progress(state.depth, through, rays, state.band, state.bands))

    def _count(self, part: Part) -> None:
        """Add the counters of a task, which are those of the present depth."""
        name, stats = part
        stats.depths[:0] = [Counters() for _ in range(self._state.depth - 1)]
        add_part(self._stats, (name, stats))


def prepare(wave: Wave, window: Window, stats: RenderStats, *, fresh_marks: bool) -> None:
    """Get all shards ready, each carrier its own, and begin the counters."""
    parts: dict[int, Stats] = {}
    for number, site in enumerate(wave.sites):
        window.send(number, Preparing(site), fresh_marks)
    while window.busy:
        done = window.take()
        _, parts[done.carrier] = done.result
        add_part(stats, done.result)
    each = [parts[number] for number in range(len(wave.sites))]
    stats.marks_reused = all(part.marks_reused for part in each)
    stats.grids = [grid for part in each for grid in part.grids]
    trees = [part.tree for part in each if part.tree is not None]
    if trees:
        stats.tree = {
            "treelets": sum(tree["treelets"] for tree in trees),
            "resident": all(tree["resident"] for tree in trees),
        }
    stats.settings = {**each[0].settings, **stats.settings}


def render(wave: Wave, client: Any, views: Views, report: Report, *, fresh_marks: bool) -> Images:
    """Render views of a sharded scene, as `bfrt.render` does here.

    Parameters
    ----------
    wave : Wave
    client : distributed.Client
    views : Views
    report : Report
        Called first, and after each task.
    fresh_marks : bool
        Whether marks are made again.

    Raises
    ------
    StoreError, BudgetError, SettingError, Cancelled, DiskFullError, StreamError
        As `bfrt.render`; those of a shard or a budget name the worker.
    """
    start = time.perf_counter()
    store = wave.store
    objects = store.manifest.objects
    stats = RenderStats(objects, 0, {"depth": views.depth})
    with Watch(client, 0, None) as watch:
        window = Window(watch, wave.carriers)
        prepare(wave, window, stats, fresh_marks=fresh_marks)
        buffer = FarRender(wave, window, views, stats, report).run()
    stats.total.seconds = time.perf_counter() - start
    tell_of_bad_rays(stats)
    images = images_of(buffer, store, views, stats)
    for image in images:
        image.metadata["objects"] = str(objects)
    return images
