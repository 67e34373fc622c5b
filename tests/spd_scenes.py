"""What the tests of the standard scenes share."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np

from bfrt.records import SCALARS, Kind
from bfrt.scene import open_scene
from bfrt.scene_writer import SceneWriter
from bfrt.spd.recipe import ORIGIN

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("BFRT_SHARED", ROOT.parent / "shared"))


class Recorder:
    """Writes down what it is fed. Its material numbers are not the scene's own."""

    def __init__(self):
        self.calls = []
        self.materials = []
        self.records = {}
        self.numbers = {}
        self.counts = []

    def camera(self, camera):
        self.calls.append(camera)

    def light(self, light):
        self.calls.append(light)

    def background(self, color):
        self.calls.append(color)

    def material(self, material):
        self.materials.append(material)
        return 100 + len(self.materials)

    def prepare(self, kind, records, counts, materials):
        assert records.dtype == np.float32 and materials.dtype == counts.dtype == np.uint32
        objects = len(records) if kind != Kind.POLYGON else len(counts)
        assert len(materials) == len(counts) == objects
        assert records.shape[1] == SCALARS[kind]
        assert kind != Kind.POLYGON or counts.sum() == len(records)
        return kind, records, counts, materials

    def add(self, block):
        kind, records, counts, materials = block
        if kind == Kind.POLYGON:
            self.counts.extend(counts.tolist())
        self.records.setdefault(kind, []).append(records)
        self.numbers.setdefault(kind, []).append(materials)

    def all(self, kind):
        return np.concatenate(self.records[kind]), np.concatenate(self.numbers[kind])


def text_of(scene):
    file = io.StringIO()
    scene.write_nff(file)
    return file.getvalue()


def joined(blocks, kind):
    """A kind's records, materials and counts, and its places in the whole scene."""
    columns, start = [], 0
    for block in blocks:
        for part in block:
            if part.kind is kind:
                counts = np.zeros(0) if part.counts is None else part.counts
                columns.append((part.records, part.materials, counts, part.places + start))
        start += sum(len(part.materials) for part in block)
    return [np.concatenate(column) for column in zip(*columns, strict=True)]


def spatial(scene, path):
    """A standard scene as a store in spatial order."""
    with SceneWriter(path, dtype=np.float32, origin=ORIGIN, order="spatial") as writer:
        scene.feed(writer, 1)
    return open_scene(path)
