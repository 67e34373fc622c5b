"""Marks are read back as they were saved, for their store and grid only, and damage is found."""

from __future__ import annotations

import contextlib
import os
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import ShortReadError, StoreError, StreamError
from bfrt.grid._coding import MOST_CODED, decode, encode
from bfrt.grid.bricks import BRICK_BYTES
from bfrt.grid.marks import open_marks, verify_marks, writing_marks
from bfrt.grid.marks_home import marks_path
from bfrt.grid.marks_layout import HEADER, Layout
from bfrt.store.writer import StoreWriter
from bfrt.streams.reader import Reader, SharedFile

#: 3 layers of 1 row of 2 bricks.
LAYOUT = Layout((13, 5, 20), 2)


@pytest.fixture
def store(tmp_path):
    writer = StoreWriter(tmp_path / "a.bfrt")
    writer.spheres(np.zeros((2, 3), np.float32), 1.0)
    return writer.complete()


def layers(layout=LAYOUT, seed=1, kept=None):
    """Bricks of each layer, and which they are."""
    rng = np.random.default_rng(seed)
    count, rows, row = layout.bricks
    for _ in range(count):
        occupied = (rng.random((rows, row)) < 0.6).astype(np.uint8)
        yield alike(rng, int(occupied.sum())), occupied


def alike(rng, n):
    """Bricks, of each of which some voxels are alike."""
    bricks = rng.integers(0, 256, (n, BRICK_BYTES)).astype(np.uint8)
    common = rng.integers(0, 256, (n, 1)).astype(np.uint8)
    return np.where(rng.random(bricks.shape) < rng.random((n, 1)), common, bricks)


def save(path, store, layout=LAYOUT, seed=1):
    with writing_marks(path, store, layout) as writer:
        for bricks, occupied in layers(layout, seed):
            writer.add(bricks, occupied)
    for number, (bricks, _) in enumerate(layers(layout, seed)):  # open, wherever the name leads
        found = np.empty_like(bricks)
        writer.marks.read(number, found)
        np.testing.assert_array_equal(found, bricks)
    writer.marks.close()
    return writer.bytes


def read(path, store, layout=LAYOUT):
    """All bricks, or None where there are no marks of this layout."""
    marks = open_marks(path, store, layout)
    if marks is None:
        return None
    try:
        parts = []
        for number, n in enumerate(np.diff(marks.first)):
            parts.append(np.empty((n, BRICK_BYTES), np.uint8))
            marks.read(number, parts[-1])
        return marks.occupied, np.concatenate(parts)
    finally:
        marks.close()


def expected(layout=LAYOUT, seed=1):
    parts = list(layers(layout, seed))
    return np.stack([o for _, o in parts]), np.concatenate([b for b, _ in parts])


def test_round_trip(store, tmp_path):
    path = marks_path(store, store.groups[0], tmp_path)
    assert path == store.path / "0" / "marks"
    assert LAYOUT.bricks == (3, 1, 2)
    assert save(path, store) == path.stat().st_size <= LAYOUT.most_bytes(6)
    for found, saved in zip(read(path, store), expected(), strict=True):
        np.testing.assert_array_equal(found, saved)
    verify_marks(store, store.groups[0])


@given(seed=st.integers(0, 2**32), n=st.integers(0, 40))
def test_coded_bricks_are_read_back(tmp_path_factory, seed, n):
    rng = np.random.default_rng(seed)
    bricks = alike(rng, n)
    coded = np.zeros(n * MOST_CODED, np.uint8)
    size = encode(bricks, coded)
    others = [BRICK_BYTES - np.bincount(brick).max() for brick in bricks]
    assert size == sum(65 + k for k in others) and not coded[size:].any()
    path = tmp_path_factory.mktemp("coding") / "bricks"
    path.write_bytes(coded[:size].tobytes())
    reader = Reader(SharedFile(path), 1)  # one page, which most bricks cross
    reader.window(0, size)
    found = np.empty_like(bricks)
    decode(reader, found)
    np.testing.assert_array_equal(found, bricks)
    if size:
        reader = Reader(SharedFile(path), 1)
        reader.window(0, size - 1)
        with pytest.raises(ShortReadError):
            decode(reader, found)


@given(shape=st.tuples(*[st.integers(1, 40)] * 3), axis=st.integers(0, 2), seed=st.integers(0, 99))
def test_any_layout(tmp_path_factory, shape, axis, seed):
    folder = tmp_path_factory.mktemp("marks")
    store = StoreWriter(folder / "a.bfrt").complete()
    layout = Layout(shape, axis, seed * 0x01020304)
    save(folder / "marks", store, layout, seed)
    both = zip(read(folder / "marks", store, layout), expected(layout, seed), strict=True)
    for found, saved in both:
        np.testing.assert_array_equal(found, saved)


def test_there_are_none(store, tmp_path):
    assert open_marks(tmp_path / "none", store, LAYOUT) is None
    verify_marks(store, store.groups[0])


@pytest.mark.parametrize(
    "layout", [Layout((20, 5, 13), 2), Layout((13, 5, 20), 0), Layout((13, 5, 20), 2, 1)]
)
def test_those_of_another_grid_or_other_boxes_are_not_taken(store, tmp_path, layout):
    save(tmp_path / "marks", store)
    assert open_marks(tmp_path / "marks", store, layout) is None


def test_those_of_another_store_are_not_taken(store, tmp_path):
    writer = StoreWriter(tmp_path / "b.bfrt")
    writer.spheres(np.ones((2, 3), np.float32), 1.0)
    other = writer.complete()
    save(tmp_path / "marks", store)
    assert open_marks(tmp_path / "marks", other, LAYOUT) is None


def test_new_marks_replace_old_ones(store, tmp_path):
    path = tmp_path / "marks"
    save(path, store, Layout((60, 1, 1), 0))
    save(path, store, seed=2)
    np.testing.assert_array_equal(read(path, store)[1], expected(seed=2)[1])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bfrt", "marks", "store"]


def test_marks_that_are_not_finished_leave_the_old_ones(store, tmp_path):
    path = tmp_path / "marks"
    save(path, store)
    with pytest.raises(KeyError), writing_marks(path, store, LAYOUT):
        raise KeyError
    np.testing.assert_array_equal(read(path, store)[1], expected()[1])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bfrt", "marks", "store"]


@pytest.mark.parametrize("size", [0, 10, HEADER.size - 1, HEADER.size, HEADER.size + 9, -1])
def test_a_truncated_file(store, size):
    path = store.path / "0" / "marks"
    whole = save(path, store)
    os.truncate(path, size % whole)
    with pytest.raises(StoreError, match="marks are damaged") as caught:
        read(path, store)
    assert str(caught.value).startswith(f"{path}: ")
    with pytest.raises(StoreError):
        verify_marks(store, store.groups[0])


def test_a_file_that_shrinks_while_it_is_open(store):
    path = store.path / "0" / "marks"
    whole = save(path, store)
    marks = open_marks(path, store, LAYOUT)
    os.truncate(path, whole - 1)
    bricks = np.empty((int(np.diff(marks.first)[-1]), BRICK_BYTES), np.uint8)
    with pytest.raises(StoreError, match="marks are damaged"):
        marks.read(2, bricks)
    marks.close()


def test_more_than_was_written(store):
    path = store.path / "0" / "marks"
    save(path, store)
    with path.open("ab") as file:
        file.write(b"x")
    with pytest.raises(StoreError, match="damaged"):
        read(path, store)
    with pytest.raises(StoreError, match="damaged"):
        verify_marks(store, store.groups[0])


def test_a_flipped_bit_is_never_taken(store):
    path = store.path / "0" / "marks"
    save(path, store)
    whole = path.read_bytes()
    for at in (*range(HEADER.size + 30), *range(HEADER.size + 30, len(whole), 37)):
        broken = bytearray(whole)
        broken[at] ^= 1 << at % 8
        path.write_bytes(broken)
        with contextlib.suppress(StoreError):
            assert read(path, store) is None
        with pytest.raises(StoreError):
            verify_marks(store, store.groups[0])


def test_those_of_another_version_are_made_again(store):
    path = store.path / "0" / "marks"
    save(path, store)
    whole = bytearray(path.read_bytes())
    whole[8] = 3
    whole[HEADER.size : HEADER.size + 4] = zlib.crc32(whole[: HEADER.size]).to_bytes(4, "little")
    path.write_bytes(whole)
    assert read(path, store) is None
    with pytest.raises(StoreError, match="found marks of version 3, expected 5: the next render"):
        verify_marks(store, store.groups[0])


def test_a_folder_in_their_place(store):
    (store.path / "0" / "marks").mkdir()
    with pytest.raises(StreamError, match="marks: reading"):
        open_marks(store.path / "0" / "marks", store, LAYOUT)
    with pytest.raises(StreamError, match="marks: reading"):
        verify_marks(store, store.groups[0])


def test_an_empty_store_has_a_place_for_marks(tmp_path):
    store = StoreWriter(tmp_path / "empty.bfrt").complete()
    path = marks_path(store, store.groups[0], tmp_path)
    save(path, store, Layout((1, 1, 1), 2))
    assert path.parent.parent == store.path
    verify_marks(store, store.groups[0])
