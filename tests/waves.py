"""Pictures of sharded scenes without a cluster: tasks are done here, in any order."""

from __future__ import annotations

import os
import pickle
from dataclasses import fields

import numpy as np

from bfrt.cluster.asked import Asked
from bfrt.illumination import LightAsked
from bfrt.rendering import images_of
from bfrt.view import Views, asked_for
from bfrt.wavefront.carriers import Carrier, ShardPlace
from bfrt.wavefront.frame import FarRender, Wave, prepare
from bfrt.wavefront.site import Site
from bfrt.wavefront.travel import RenderStats
from bfrt.wavefront.window import Done

OF_LIGHT = {field.name for field in fields(LightAsked)}


class WindowHere:
    """Does tasks in this process: of those that are under way any one, whose seed decides."""

    def __init__(self, carriers, seed):
        self._rng = np.random.default_rng(seed)
        self._under_way = []
        self.carriers = carriers
        self.order = []

    @property
    def busy(self):
        return bool(self._under_way)

    def under_way(self, carrier):
        return sum(own == carrier for own, _, _ in self._under_way)

    def send(self, carrier, task, given, note=None):
        self._under_way.append((carrier, pickle.dumps((task, given)), note))

    def take(self):
        carrier, sent, note = self._under_way.pop(self._rng.integers(len(self._under_way)))
        self.order.append(carrier)
        task, given = pickle.loads(sent)
        return Done(carrier, note, pickle.loads(pickle.dumps(task(given))))


def wave_of(sharded, parts, refine, **settings):
    """The work on a scene whose shards, by their numbers, are parted among carriers."""
    store = sharded.store
    asked = Asked(
        settings.pop("memory", "160MiB"), 1, refine or "sgb", None, None, False, None, **settings
    )
    carriers = [Carrier(tuple(part), (f"worker {n}",)) for n, part in enumerate(parts)]
    path = os.fspath(sharded.path)
    sites = [Site(ShardPlace(path, store.checksum, own), asked, refine) for own, _ in carriers]
    return Wave(store, carriers, sites)


def render_here(wave, seed=0, report=lambda _: None, **view):
    """A picture, or those of several views, by tasks that end in an order of their own."""
    store = wave.store
    asked = {name: view.pop(name) for name in OF_LIGHT & view.keys()}
    shown = Views.of(
        store, view.get("camera"), view.get("samples"), view.get("depth", 5), view.get("aovs", ()),
        LightAsked(**asked),
    )  # fmt: skip
    stats = RenderStats(store.manifest.objects, 0, {"depth": shown.depth})
    window = WindowHere(wave.carriers, seed)
    prepare(wave, window, stats, fresh_marks=False)
    buffer = FarRender(wave, window, shown, stats, report).run()
    return asked_for(images_of(buffer, store, shown, stats), view.get("camera"))
