"""NFF scenes, read from anything that has text, and the standard ones."""

from __future__ import annotations

import errno
import io
import re
import sys
import tracemalloc

import numpy as np
import pytest
from nff_files import SCENE, SHARED, VIEW, Recorder, Trickle, failure, outcome, parse

from bfrt.errors import SceneError, StreamError
from bfrt.formats.nff import _read, read_nff
from bfrt.formats.text import MOST_CORNERS
from bfrt.records import Kind
from bfrt.store.model import Camera, Light, Material

# --- scenes --------------------------------------------------------------------------------------


def test_scene_has_every_entity():
    sink = parse(SCENE)
    assert sink.cameras == [
        Camera((4.0, 5.0, 6.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 30.0, resolution=(640, 480))
    ]
    assert sink.backgrounds == [(0.25, 0.5, 1.0)]
    assert sink.lights == [
        Light((1.0, 2.0, 3.0)),
        Light((1.0, 2.0, 3.0), (0.5, 0.25, 0.0)),
        Light((7.0, 8.0, 9.0)),
    ]
    assert list(sink.palette) == [
        Material(),
        Material((1.0, 0.5, 0.25), 0.75, 0.125, 10.0, 0.5, 1.5),
        Material((1.0, 1.0, 1.0), 1.0, 0.0, 1.0, 0.0, 1.0),
    ]
    assert sink.blocks[Kind.SPHERE] == [[1, 2, 3, 4], [-10, 2, 0.3, -0.5], [9, 9, 9, 9]]
    assert sink.paints[Kind.SPHERE] == [0, 1, 2]
    assert sink.blocks[Kind.CONE] == [[0, 0, 0, 1, 0, 0, 2, 0.5], [0, 0, 0, -1, 0, 0, 2, -0.5]]
    assert sink.paints[Kind.CONE] == [1, 1]
    assert sink.blocks[Kind.TRIANGLE] == [[0, 0, 0, 1, 0, 0, 0, 1, 0]]
    assert sink.paints[Kind.TRIANGLE] == [1]


def test_polygons_of_four_and_more_corners():
    sink = parse(SCENE)
    assert sink.counts == [4, 5]
    assert sink.blocks[Kind.POLYGON] == [
        *([0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]),
        *([0, 0, 1], [4, 0, 1], [4, 4, 1], [2, 1, 1], [0, 4, 1]),
    ]
    assert sink.paints[Kind.POLYGON] == [1, 2]


def test_patch_of_four_becomes_a_fan():
    sink = parse(SCENE)
    assert sink.blocks[Kind.PATCH] == [
        [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1],
        [0, 0, 0, 1, 0, 0, 1, 1, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0],
        [0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0, 0, 3, 0, 0, 4, 0, 0],
    ]
    assert sink.paints[Kind.PATCH] == [2, 2, 2]


def test_hither_is_kept():
    assert parse(VIEW).cameras[0].hither == 0.5


def test_empty_file_is_black_and_has_no_camera():
    for data in (b"", b"\n\n", b"# nothing", b" \r\n#\r\n"):
        sink = parse(data)
        assert sink.cameras == sink.lights == sink.sizes == []
        assert sink.backgrounds == [(0.0, 0.0, 0.0)]


def test_view_and_light_may_end_the_file():
    assert len(parse(b"s 1 1 1 1\n" + VIEW).cameras) == 1
    assert parse(b"l 1 2 3").lights == [Light((1.0, 2.0, 3.0))]
    assert parse(b"l 1 2 3 # 4 5 6\n").lights == [Light((1.0, 2.0, 3.0))]
    assert parse(b"l 1 2 3 .5 +1 0").lights == [Light((1.0, 2.0, 3.0), (0.5, 1.0, 0.0))]


def test_default_material_only_where_needed():
    assert list(parse(b"f 1 1 1 1 1 1 1 1 s 1 1 1 1").palette) == [Material((1.0,) * 3, 1, 1, 1, 1)]
    assert list(parse(b"p 3 0 0 0 1 0 0 0 1 0").palette) == [Material()]


def test_line_ends_do_not_matter():
    plain = SCENE.replace(b"\r", b"\n")
    for end in (b"\r\n", b"\r", b"\r\n\r\n"):
        assert outcome(plain.replace(b"\n", end)) == outcome(plain)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
def test_lines_are_counted_whatever_ends_them(end):
    data = end.join([b"s 1 1 1 1", b"", b"# comment", b"s 1 1", b"", b"1 x", b""])
    for chunk_bytes in (1, 2, 3, 1000):
        assert failure(data, chunk_bytes).startswith("line 6: found 'x'")


@pytest.mark.parametrize("chunk_bytes", range(1, 65))
def test_chunks_may_end_anywhere(chunk_bytes):
    whole = parse(SCENE).everything()
    assert outcome(SCENE, chunk_bytes) == whole
    sink = Recorder()
    _read(Trickle(SCENE, chunk_bytes), sink, None, 1 << 20, 3)
    assert sink.everything() == whole


@pytest.mark.parametrize("block_objects", [1, 2, 3, 7])
def test_blocks_keep_the_order(block_objects):
    lines = []
    for i in range(20):
        lines.append(b"f 0 0 %d 1 0 1 0 1\ns %d 0 0 1\nc %d 0 0 1 0 0 1 1" % (i % 5, i, i))
        corners = b"".join(b" %d %d 0" % (i, j) for j in range(4 + i))
        lines.append(b"p %d%s" % (4 + i, corners))
    text = b"\n".join(lines)
    sink = parse(text, 17, block_objects)
    assert max(sink.sizes) <= block_objects
    assert sink.everything() == parse(text).everything()
    assert [record[0] for record in sink.blocks[Kind.SPHERE]] == list(range(20))
    assert sink.paints[Kind.SPHERE] == [i % 5 for i in range(20)]
    assert sink.counts == list(range(4, 24))


def test_large_polygon():
    corners = np.arange(3 * 100_000).reshape(-1, 3)
    text = b"p 100000\n" + b"\n".join(b"%d %d %d" % tuple(row) for row in corners.tolist())
    sink = parse(text)
    assert sink.counts == [100_000]
    assert np.array_equal(sink.blocks[Kind.POLYGON], corners)


def test_lying_count_takes_no_memory():
    data = b"p %d 0 0 0" % MOST_CORNERS
    failure(data)
    tracemalloc.start()
    try:
        failure(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 24 * MOST_CORNERS / 2


# --- sources -------------------------------------------------------------------------------------


def test_path_and_its_name_in_messages(tmp_path):
    good, bad = tmp_path / "good.nff", tmp_path / "bad.nff"
    good.write_bytes(SCENE)
    bad.write_bytes(b"s 1 2 3\n")
    for source in (good, str(good)):
        sink = Recorder()
        read_nff(source, sink)
        assert sink.everything() == parse(SCENE).everything()
    with pytest.raises(SceneError, match=rf"^{re.escape(str(bad))}: line 1: "):
        read_nff(bad, Recorder())
    with bad.open("rb") as stream:
        with pytest.raises(SceneError, match=rf"^{re.escape(str(bad))}: line 1: "):
            read_nff(stream, Recorder())
        assert not stream.closed


def test_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(SCENE)))
    sink = Recorder()
    read_nff("-", sink)
    assert sink.everything() == parse(SCENE).everything()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"s")))
    with pytest.raises(SceneError, match=r"^<stdin>: line 1: found end of file"):
        read_nff("-", Recorder())


def test_progress_counts_bytes():
    seen = []
    _read(io.BytesIO(SCENE), Recorder(), seen.append, 100, 16384)
    assert seen == [*range(100, len(SCENE), 100), len(SCENE)]
    seen.clear()
    read_nff(io.BytesIO(SCENE), Recorder(), progress=seen.append)
    assert seen == [len(SCENE)]


class Broken(io.RawIOBase):
    """A stream that gives one object, and then something else than data."""

    name = "disk.nff"

    def __init__(self, then):
        self.parts = [b"s 1 2 3 4\n", then]

    def read(self, size=-1):
        part = self.parts.pop(0)
        if isinstance(part, OSError):
            raise part
        return part


@pytest.mark.parametrize(
    ("then", "number"),
    [
        (OSError(errno.EIO, "bad sector"), errno.EIO),
        (OSError("no number"), errno.EIO),
        (None, errno.EAGAIN),
    ],
)
def test_refused_read(then, number):
    with pytest.raises(StreamError) as caught:
        read_nff(Broken(then), Recorder())
    assert caught.value.errno == number
    assert (caught.value.path, caught.value.offset) == ("disk.nff", 10)
    assert str(caught.value).startswith("disk.nff: reading at byte 10: ")


def test_missing_file(tmp_path):
    with pytest.raises(StreamError) as caught:
        read_nff(tmp_path / "none.nff", Recorder())
    assert caught.value.errno == errno.ENOENT
    assert str(tmp_path / "none.nff") in str(caught.value)


def test_text_stream_is_refused():
    with pytest.raises(TypeError, match="found a stream of str, expected bytes"):
        read_nff(io.StringIO("s 1 2 3 4"), Recorder())


# --- the standard scenes -------------------------------------------------------------------------


def scenes():
    missing = pytest.mark.skip(reason=f"no NFF scenes in {SHARED / 'spd'}")
    return sorted((SHARED / "spd").glob("*.nff")) or [pytest.param(None, marks=missing)]


def plain_entities(text):
    """An independent tokenizer: every entity as (keyword, its words)."""
    words = re.sub(r"#.*", "", text).split()
    starts = [i for i, word in enumerate(words) if word in {*"vblfcsp", "pp"}]
    return [
        (words[start], words[start + 1 : stop])
        for start, stop in zip(starts, [*starts[1:], len(words)], strict=True)
    ]


def plain_read(text):
    """(objects of each kind, vertex counts of polygons, materials, keywords) by float()."""
    objects = {kind: [] for kind in Kind}
    counts, materials, keywords = [], set(), []
    for keyword, words in plain_entities(text):
        keywords.append(keyword)
        if keyword == "f":
            materials.add(tuple(map(float, words)))
        elif keyword == "pp":
            assert words[0] == "3"
            rows = np.array(words[1:], dtype=float).reshape(3, 6)
            objects[Kind.PATCH].append([*rows[:, :3].ravel(), *rows[:, 3:].ravel()])
        elif keyword == "p" and words[0] != "3":
            counts.append(int(words[0]))
            objects[Kind.POLYGON] += np.array(words[1:], dtype=float).reshape(-1, 3).tolist()
        elif keyword == "p":
            objects[Kind.TRIANGLE].append([float(word) for word in words[1:]])
        elif keyword in ("s", "c"):
            kind = Kind.SPHERE if keyword == "s" else Kind.CONE
            objects[kind].append([float(word) for word in words])
    return objects, counts, materials, keywords


@pytest.mark.parametrize("path", scenes(), ids=lambda path: path.stem if path else "none")
def test_standard_scene(path):
    sink = Recorder()
    read_nff(path, sink)
    objects, counts, materials, keywords = plain_read(path.read_text())
    assert sink.blocks == objects
    assert sink.counts == counts
    assert {(*material.color, *material[1:]) for material in sink.palette} == materials
    assert len(sink.lights) == keywords.count("l")
    assert len(sink.cameras) == keywords.count("v") == 1
    assert len(sink.backgrounds) == keywords.count("b") == 1
