"""Marks are read back as they were saved, for their store and grid only, and damage is found."""

from __future__ import annotations

import contextlib
import os

import numpy as np
import pytest

from bfrt.errors import StoreError, StreamError
from bfrt.scene.marks import HEADER, load_marks, marks_path, save_marks
from bfrt.scene.writer import SceneWriter

SHAPE = (3, 4, 5)


@pytest.fixture
def store(tmp_path):
    writer = SceneWriter(tmp_path / "a.bfrt")
    writer.spheres(np.zeros((2, 3), np.float32), 1.0)
    return writer.close()


@pytest.fixture
def marks():
    return np.random.default_rng(1).integers(0, 256, 60).astype(np.uint8)


def test_round_trip(store, marks, tmp_path):
    path = marks_path(store, store.groups[0], tmp_path)
    assert path == store.path / "0" / "marks"
    assert save_marks(path, store, SHAPE, marks) == path.stat().st_size == HEADER.size + 60
    into = np.empty(60, np.uint8)
    assert load_marks(path, store, SHAPE, into)
    np.testing.assert_array_equal(into, marks)
    store.verify()


def test_there_are_none(store, tmp_path):
    into = np.full(60, 7, np.uint8)
    assert not load_marks(tmp_path / "none", store, SHAPE, into)
    assert (into == 7).all()
    store.verify()


def test_those_of_another_grid_are_not_taken(store, marks, tmp_path):
    save_marks(tmp_path / "marks", store, SHAPE, marks)
    assert not load_marks(tmp_path / "marks", store, (5, 4, 3), np.empty(60, np.uint8))


def test_those_of_another_store_are_not_taken(store, marks, tmp_path):
    writer = SceneWriter(tmp_path / "b.bfrt")
    writer.spheres(np.ones((2, 3), np.float32), 1.0)
    other = writer.close()
    save_marks(tmp_path / "marks", store, SHAPE, marks)
    assert not load_marks(tmp_path / "marks", other, SHAPE, np.empty(60, np.uint8))


def test_new_marks_replace_old_ones(store, marks, tmp_path):
    path = tmp_path / "marks"
    save_marks(path, store, (60, 1, 1), marks[::-1].copy())
    save_marks(path, store, SHAPE, marks)
    into = np.empty(60, np.uint8)
    assert load_marks(path, store, SHAPE, into)
    np.testing.assert_array_equal(into, marks)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.bfrt", "marks"]


@pytest.mark.parametrize("size", [0, 10, HEADER.size - 1, HEADER.size, HEADER.size + 59])
def test_a_truncated_file(store, marks, tmp_path, size):
    path = store.path / "0" / "marks"
    save_marks(path, store, SHAPE, marks)
    os.truncate(path, size)
    with pytest.raises(StoreError, match="marks are damaged") as caught:
        load_marks(path, store, SHAPE, np.empty(60, np.uint8))
    assert str(caught.value).startswith(f"{path}: ")
    with pytest.raises(StoreError):
        store.verify()


def test_more_than_was_written(store, marks):
    path = store.path / "0" / "marks"
    save_marks(path, store, SHAPE, marks)
    with path.open("ab") as file:
        file.write(b"x")
    with pytest.raises(StoreError, match="damaged"):
        load_marks(path, store, SHAPE, np.empty(60, np.uint8))
    with pytest.raises(StoreError, match="damaged"):
        store.verify()


def test_a_flipped_bit_is_never_taken(store, marks):
    path = store.path / "0" / "marks"
    save_marks(path, store, SHAPE, marks)
    whole = path.read_bytes()
    for at in range(len(whole)):
        broken = bytearray(whole)
        broken[at] ^= 1 << at % 8
        path.write_bytes(broken)
        with contextlib.suppress(StoreError):
            assert not load_marks(path, store, SHAPE, np.empty(60, np.uint8))
        with pytest.raises(StoreError):
            store.verify()


def test_a_folder_in_their_place(store):
    (store.path / "0" / "marks").mkdir()
    with pytest.raises(StreamError, match="marks: reading"):
        load_marks(store.path / "0" / "marks", store, SHAPE, np.empty(60, np.uint8))
    with pytest.raises(StreamError, match="marks: reading"):
        store.verify()


def test_a_read_only_store_has_its_marks_in_scratch(store, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    path = marks_path(store, store.groups[0], tmp_path)
    assert path == tmp_path / f"a.bfrt-{store.checksum:08x}-0.marks"


def test_an_empty_store_has_a_place_for_marks(tmp_path):
    store = SceneWriter(tmp_path / "empty.bfrt").close()
    path = marks_path(store, store.groups[0], tmp_path)
    save_marks(path, store, (1, 1, 1), np.zeros(1, np.uint8))
    assert path.parent.parent == store.path
    store.verify()
