"""A store opens when it is whole, and says what is wrong when it is not."""

from __future__ import annotations

import copy
import json
import os
import shutil

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import random_objects

import bfrt
from bfrt.errors import StoreError, StreamError
from bfrt.grid.marks import writing_marks
from bfrt.grid.marks_home import marks_path
from bfrt.grid.marks_layout import Layout
from bfrt.ids import object_id
from bfrt.records import INDEX_BITS, Kind
from bfrt.store.header import header_text
from bfrt.store.model import Camera, Light, Material
from bfrt.store.store import has_magic, open_store
from bfrt.store.writer import StoreWriter

HUGE = [[-1e4, -1e4, 0], [1e4, -1e4, 0], [0, 1e4, 0]]


def make(path):
    """A small store that has something of everything, marks and an outlier too."""
    objects = random_objects(np.random.default_rng(1), 20)
    with StoreWriter(path, dtype="float32", order="given") as writer:
        writer.camera(Camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
        writer.light(Light((1.0, 2.0, 3.0)))
        numbers = [writer.material(Material(kd=kd / 8)) for kd in range(3)]
        for kind, table in (
            (Kind.SPHERE, objects.spheres),
            (Kind.CONE, objects.cones),
            (Kind.TRIANGLE, objects.triangles),
            (Kind.PATCH, objects.patches),
        ):
            writer.append(kind, table, np.resize(numbers, len(table)))
        writer.append_polygons(
            objects.vertices, objects.counts, np.resize(numbers, len(objects.counts))
        )
        writer.triangles([HUGE], 1)
    store = open_store(path)
    path = marks_path(store, store.groups[0], path.parent)
    with writing_marks(path, store, Layout((2, 3, 4), 2)) as writer:
        writer.add(np.full((1, 512), 63, np.uint8), np.ones((1, 1), np.uint8))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Not to be changed."""
    path = tmp_path_factory.mktemp("store") / "whole.bfrt"
    make(path)
    return path


@pytest.fixture
def path(whole, tmp_path):
    """To be damaged."""
    return shutil.copytree(whole, tmp_path / "a.bfrt")


def files_of(path):
    return sorted(str(p.relative_to(path)) for p in path.rglob("*") if p.is_file())


NAMES = [
    *(f"0/{kind}/geometry" for kind in ("cone", "patch", "polygon", "sphere", "triangle")),
    *(f"0/{kind}/level1" for kind in ("cone", "patch", "polygon", "sphere", "triangle")),
    *(f"0/{kind}/boxes" for kind in ("cone", "patch", "polygon", "triangle")),
    *(f"0/{kind}/quantised" for kind in ("cone", "patch", "polygon", "triangle")),
    "0/polygon/offsets",
    *(f"0/{kind}/materials" for kind in ("cone", "patch", "polygon", "sphere", "triangle")),
    "palette",
]


def test_the_files_of_a_store(whole):
    assert files_of(whole) == sorted([*NAMES, "0/marks", "made.json", "scene.json"])
    store = open_store(whole)
    assert {p for p, _ in store.files()} == {whole / name for name in NAMES}
    sizes = sum((whole / name).stat().st_size for name in [*NAMES, "scene.json"])
    assert store.bytes == sizes
    group = store.groups[0]
    assert object_id(Kind.TRIANGLE, store.streams[2].count - 1) in group.outliers
    assert group.gridded == store.objects - len(group.outliers)
    store.verify()


def test_open_reads_the_header_only(path):
    for name in NAMES:
        size = (path / name).stat().st_size
        (path / name).write_bytes(b"\xff" * size)
    open_store(path)  # O(1): the sizes are right


# --- what open finds -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("change", [-1, 1, None])
def test_a_file_of_another_size(path, name, change):
    file = path / name
    size = file.stat().st_size
    if change is None:
        file.unlink()
    else:
        os.truncate(file, size + change)
    with pytest.raises(StoreError) as caught:
        open_store(path)
    found = "the file is missing" if change is None else f"found {size + change} bytes"
    assert str(caught.value).startswith(f"{file}: {found}")
    assert f"expected {size}" in str(caught.value)


def test_a_folder_is_missing(path):
    shutil.rmtree(path / "0" / "cone")
    with pytest.raises(StoreError, match=r"cone.\w+: the file is missing"):
        open_store(path)
    (path / "0" / "cone").write_bytes(b"a file in its place")
    with pytest.raises(StoreError, match=r"cone.\w+: the file is missing"):
        open_store(path)


@pytest.mark.parametrize("what", ["nothing", "a file", "a folder", "a folder for a header"])
def test_no_store_at_all(tmp_path, what):
    path = tmp_path / "a.bfrt"
    if what == "a file":
        path.write_bytes(b"x")
    elif what != "nothing":
        path.mkdir()
    if what == "a folder for a header":
        (path / "scene.json").mkdir()
    with pytest.raises(StoreError, match="not a scene store: expected a directory") as caught:
        open_store(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert not has_magic(path)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
def test_a_header_that_may_not_be_read(path):
    (path / "scene.json").chmod(0)
    with pytest.raises(StreamError, match=r"scene\.json: reading at byte 0"):
        open_store(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("version", 1, "found format version 1, expected 5: convert the scene again"),
        ("version", "1", "found format version '1', expected 5"),
        ("magic", "another", "found 'another', expected 'bfrt scene store'"),
        ("magic", ["x"] * 999, "expected 'bfrt scene store'"),
    ],
)
def test_another_version_or_magic(path, key, value, message):
    rewrite(path, lambda header: header.update({key: value}))
    with pytest.raises(StoreError) as caught:
        open_store(path)
    assert str(caught.value).startswith(f"{path / 'scene.json'}: ")
    assert message in str(caught.value)
    assert len(str(caught.value)) < 500


DEEP = b"[" * 100_000
NESTED = b'{"magic": "bfrt scene store", "version": 5, "x": ' + b"[" * 900 + b"]" * 900 + b"}"


@given(data=st.binary(max_size=200))
@example(data=b"")
@example(data=b"null")
@example(data=b'{"magic": "bfrt scene store"}')
@example(data=b'{"magic": "bfrt scene store", "version": 5}')
@example(data=b'{"magic": "bfrt scene store", "version": 5, "checksum": NaN}')
@example(data=b'{"magic": "bfrt scene store", "version": 5, "checksum": 1e999}')
@example(data=b'{"magic": "bfrt scene store", "version": 5, "x": "\\ud800"}')
@example(data=b'{"magic": {}, "version": ' + b"9" * 5000 + b"}")
@example(data=b"\xff\xfe{\x00}\x00")
@example(data=DEEP)
@example(data=NESTED)
def test_any_bytes_for_a_header(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("garbage")
    (path / "scene.json").write_bytes(data)
    with pytest.raises(StoreError, match=r"scene\.json"):
        open_store(path)


def rewrite(path, change):
    """Change a header and give it the checksum that it then has."""
    header = json.loads((path / "scene.json").read_text())
    header = change(header) or header
    (path / "scene.json").write_text(header_text(header))


def leaves(value, way=()):
    """The way to every value in a header, objects and lists included."""
    if way:
        yield way
    if isinstance(value, (dict, list)):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(part, (*way, key))


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([-1, 0, 1 << 31, 1 << 32, 1 << 48, 1 << 63, 1 << 64, 10**400])
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=6,
)


@given(data=st.data(), value=JSON)
def test_a_header_with_a_true_checksum_and_another_value(whole, tmp_path_factory, data, value):
    """It is refused as a StoreError, or it opens as a store that can be asked everything."""
    header = json.loads((whole / "scene.json").read_text())
    way = data.draw(st.sampled_from(list(leaves(header))))
    change = data.draw(st.sampled_from(["value", "remove", "add"]))
    part = header
    for key in way[:-1]:
        part = part[key]
    if change == "remove":
        del part[way[-1]]
    elif change == "value":
        part[way[-1]] = value
    elif isinstance(part, dict):
        part["more"] = value
    else:
        part.append(value)
    path = shutil.copytree(whole, tmp_path_factory.mktemp("changed") / "a.bfrt")
    (path / "scene.json").write_text(header_text(header))
    try:
        store = open_store(path)
    except StoreError as error:
        assert str(path) in str(error)
        assert len(str(error)) < 1000
        return
    finally:
        shutil.rmtree(path.parent)
    used(store)


def used(store):
    """Ask for what a render asks for, all of which must be of its type."""
    assert all(type(x) is float for x in (*store.origin, *store.background))
    assert store.camera is None or isinstance(store.camera, Camera)
    assert store.bounds.lo.dtype == store.bounds.hi.dtype == np.float64
    assert store.groups
    materials = store.palette.bytes // 32
    for group in store.groups:
        assert group.gridded >= 0
        assert (group.grid_bounds.lo <= group.grid_bounds.hi).all() or not group.gridded
        for id in group.outliers:
            stream = store.streams[[s.number for s in store.streams].index(id >> INDEX_BITS)]
            assert 0 <= id & ((1 << INDEX_BITS) - 1) < stream.count
    for stream in store.streams:
        assert type(stream.wide) is bool
        assert 0 <= stream.degenerate <= stream.count
        assert stream.material < materials
        assert {n: f.bytes for n, f in stream.files.items()} == stream.expected_bytes()
    for light in store.lights:
        assert all(type(x) is float for x in (*light.position, *light.color))


@pytest.mark.parametrize(
    ("way", "value", "message"),
    [
        (("groups", 0, "streams", 0, "count"), -3, "groups: streams: count: found -3"),
        (("groups", 0, "streams", 0, "count"), True, "count: found True"),
        (("groups", 0, "streams", 0, "count"), 5, "contradicts its own counts"),
        (("groups", 0, "streams", 0, "wide"), 0, "wide: found 0, expected true or false"),
        (("groups", 0, "streams", 0, "kind"), 5, "kind: found 5"),
        (("groups", 0, "streams", 0, "kind"), 1, "ascending order"),
        (("groups", 0, "streams", 0, "degenerate"), 99, "counts and widths that agree"),
        (("groups", 0, "streams", 0, "material"), 3, "palette: found 96 bytes"),
        (("groups", 0, "streams", 0, "material_bytes"), 3, "counts and widths that agree"),
        (("groups", 0, "streams", 0, "files", "../../x"), {"bytes": 1, "crc32": 1}, "contradicts"),
        (("groups", 0, "streams", 0, "files"), [], "files: found [], expected an object"),
        (("groups", 0, "outliers"), [9, 8], "outliers in ascending order"),
        (("groups", 0, "outliers"), [object_id(2, 99)], "expected an object of group 0"),
        (("groups", 0, "outliers"), [object_id(7, 0)], "expected an object of group 0"),
        (("groups", 0, "grid_bounds"), None, "a grid that does not fit them"),
        (("groups", 0, "streams", 1, "levels"), [], "levels where boxes are quantised"),
        (("groups", 0, "streams", 1, "quantised"), False, "the header contradicts its own counts"),
        (("groups",), [], "groups: found none"),
        (("groups",), {}, "groups: found {}, expected a list"),
        (("bounds",), [[1, 1, 1], [0, 2, 2]], "a lower and a higher corner"),
        (("bounds",), [[0, 0], [1, 1]], "expected a list of 3"),
        (("origin", 0), "0", "origin: found '0', expected a finite number"),
        (("origin", 0), 10**400, "expected a number that fits float64"),
        (("camera", "angle"), 180.0, "camera: found angle 180"),
        (("camera", "up"), [0, 0, 0], "does not span a view"),
        (("camera", "resolution"), [0, 5], "resolution (0, 5)"),
        (("camera", "resolution"), [5], "resolution: found [5], expected a list of 2"),
        (("lights", 0), [], "lights: found [], expected a list of 2"),
        (("palette", "bytes"), 97, "palette: found 97 bytes"),
        (("more",), 1, "expected an object with magic, version, origin"),
        (("version",), 5.0, "version: found 5.0, expected a whole number"),
    ],
)
def test_a_malformed_field_is_named(path, way, value, message):
    def change(header):
        part = header
        for key in way[:-1]:
            part = part[key]
        part[way[-1]] = value

    rewrite(path, change)
    with pytest.raises(StoreError) as caught:
        open_store(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_what_is_whole_is_not_refused(path):
    rewrite(path, lambda header: copy.deepcopy(header))
    used(open_store(path))


# --- what verify finds ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*NAMES, "0/marks", "scene.json"])
def test_a_flipped_bit_anywhere(path, name):
    scene = bfrt.open(path)
    scene.verify()
    file = path / name
    whole = file.read_bytes()
    for at in range(len(whole)):
        broken = bytearray(whole)
        broken[at] ^= 1 << (at * 5 + 3) % 8
        file.write_bytes(broken)
        with pytest.raises(StoreError) as caught:
            scene.verify()
        assert str(path) in str(caught.value)
    file.write_bytes(whole)
    scene.verify()


def test_records_in_another_order(path):
    file = path / "0" / "cone" / "boxes"
    data = file.read_bytes()
    file.write_bytes(data[24:] + data[:24])
    with pytest.raises(StoreError, match="boxes: the contents differ from what was written"):
        open_store(path).verify()


def test_materials_are_checked_as_they_are_read(path):
    store = open_store(path)
    assert store.materials()["kd"].tolist() == [0, 0.125, 0.25]
    data = bytearray((path / "palette").read_bytes())
    data[5] ^= 1
    (path / "palette").write_bytes(data)
    with pytest.raises(StoreError, match="palette: the contents differ"):
        store.materials()
    (path / "palette").unlink()
    with pytest.raises(StoreError, match="palette: the file is missing"):
        store.materials()


def test_a_file_that_went_away_after_opening(path):
    store = open_store(path)
    shutil.rmtree(path)
    with pytest.raises(StoreError, match="the store was removed while it was open"):
        store.verify()
