"""NFF text, and a sink that keeps what is read of it."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest

from bfrt.errors import SceneError
from bfrt.formats.nff import _read
from bfrt.records import SCALARS, Kind

ROOT = Path(__file__).resolve().parents[1]
SHARED = Path(os.environ.get("BFRT_SHARED", ROOT.parent / "shared"))

VIEW = b"v\nfrom 4 5 6\nat 0 0 1\nup 0 0 1\nangle 30\nhither 0.5\nresolution 640 480\n"

# One of everything, in odd places: line breaks inside entities, several entities on a line,
# comments behind numbers, all kinds of blanks and line ends.
SCENE = (
    b"# a comment with \xe9\x00 bytes\n"
    b"b .25 0.5 1. #color\n"
    b"v from 4 5 6 at\t0 0 1\r\nresolution +640 480 angle 30 up 0 0 1\n"
    b"s 1 2 3 4\n"
    b"l 1 2 3\nl 1 2 3 0.5 0.25 0\n"
    b"f 1 0.5 0.25 0.75 0.125 10 0.5 1.5\n"
    b"c 0 0 0 1\n0 0 2 .5\n"
    b"c 0 0 0 -1 0 0 2 -.5 s -1e1 +2 3E-1 -0.5\r\n"
    b"p 3\n0 0 0\n1 0 0\n0 1 0\n"
    b"p 4 0 0 0 2 0 0 2 2 0 0 2 0\n"
    b"l 7 8 9\x0b"
    b"f 1 1 1 1 0 1 0 1\n"
    b"p 5\n0 0 1 4 0 1 4 4 1\n# in the midst\n2 1 1 0 4 1\r"
    b"pp 3\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n"
    b"pp 4\n0 0 0 1 0 0  1 0 0 2 0 0  1 1 0 3 0 0  0 1 0 4 0 0\n"
    b"s 9 9 9 9"
)


class Recorder:
    """A sink that keeps a copy of everything, and checks what each call promises."""

    def __init__(self):
        self.cameras = []
        self.lights = []
        self.backgrounds = []
        self.palette = {}
        self.blocks = {kind: [] for kind in Kind}
        self.paints = {kind: [] for kind in Kind}
        self.counts = []
        self.sizes = []

    def camera(self, camera):
        self.cameras.append(camera)

    def light(self, light):
        self.lights.append(light)

    def background(self, color):
        self.backgrounds.append(color)

    def material(self, material):
        return self.palette.setdefault(material, len(self.palette))

    def append(self, kind, records, materials):
        assert kind is not Kind.POLYGON
        assert len(materials) == len(records) > 0
        self.keep(kind, records, materials)

    def append_polygons(self, vertices, counts, materials):
        assert counts.dtype == np.int64
        assert len(counts) == len(materials) > 0
        assert counts.sum() == len(vertices)
        self.counts += counts.tolist()
        self.keep(Kind.POLYGON, vertices, materials)

    def keep(self, kind, records, materials):
        assert records.dtype == np.float64
        assert records.flags.c_contiguous
        assert records.shape[1] == SCALARS[kind]
        assert materials.dtype == np.uint32
        self.sizes.append(len(materials))
        self.blocks[kind] += records.tolist()
        self.paints[kind] += materials.tolist()

    def everything(self):
        """All but how the objects were cut into blocks; repr tells 0.0 from -0.0."""
        parts = self.cameras, self.lights, self.backgrounds, self.palette, self.counts
        return repr((parts, self.blocks, self.paints))


class Trickle(io.RawIOBase):
    """A stream whose reads are shorter than asked for."""

    def __init__(self, data, most):
        self.data = io.BytesIO(data)
        self.most = most

    def read(self, size=-1):
        return self.data.read(min(size, self.most))


def parse(data, chunk_bytes=1 << 20, block_objects=16384):
    sink = Recorder()
    _read(io.BytesIO(data), sink, None, chunk_bytes, block_objects)
    return sink


def failure(data, chunk_bytes=1 << 20):
    """The message of the error, without the name of the stream."""
    with pytest.raises(SceneError) as caught:
        parse(data, chunk_bytes)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("<stream>: ")
    return message.removeprefix("<stream>: ")


def outcome(data, chunk_bytes=1 << 20, block_objects=16384):
    """What a text becomes: a scene, or an error."""
    try:
        return parse(data, chunk_bytes, block_objects).everything()
    except SceneError as error:
        return str(error)


# --- numbers -------------------------------------------------------------------------------------


def number(text):
    """A number as the reader has it."""
    return parse(b"s " + text.encode() + b" 0 0 0").blocks[Kind.SPHERE][0][0]
