"""A store that changes while it is open: its own picture, or one sentence, and never a mixture."""

from __future__ import annotations

import copy
import errno
import multiprocessing
import os
import pickle
import shutil
import threading

import numpy as np
import pytest
from meshes import open_files

import bfrt
from bfrt.errors import StoreError, StreamError

SMALL = {"memory": "96MiB", "threads": 2}

#: How objects are found, and the order that a store has for it.
WAYS = {"base": "given", "sg": "given", "sgb": "given", "tree": "spatial"}


def build(path, seed, order, count=3000):
    """A store of spheres and triangles: the same counts for each seed, and other objects."""
    rng = np.random.default_rng(seed)
    with bfrt.SceneWriter(path, order=order) as writer:
        writer.camera(bfrt.Camera((5, 5, 20), (5, 5, 5), (0, 1, 0), resolution=(48, 32)))
        writer.light(bfrt.Light((5, 20, 20)))
        shiny = writer.material(bfrt.Material((0.2 * seed, 0.5, 0.5), ks=0.5))
        places = rng.uniform(0, 10, (count, 3))
        writer.spheres(places, 0.1 + 0.1 * seed, shiny)
        writer.triangles(places[:, None] + rng.uniform(-0.3, 0.3, (count, 3, 3)))
    return path


@pytest.fixture(params=WAYS)
def way(request):
    return request.param


@pytest.fixture
def path(tmp_path, way):
    return build(tmp_path / "a.bfrt", 1, WAYS[way])


@pytest.fixture
def shown(path, way):
    """The picture and its facts, from a store that stays."""
    copied = shutil.copytree(path, path.with_name("copy") / path.name)
    return picture(copied, way)


def picture(scene, way, **asked):
    made = bfrt.render(scene, refine=way, **SMALL, **asked)
    return made.channels, made.metadata


def assert_same(found, expected):
    assert found[1] == expected[1]
    assert found[0].keys() == expected[0].keys()
    for name, pixels in found[0].items():
        np.testing.assert_array_equal(pixels, expected[0][name])


def sentence(path):
    return f"{path}: the store was replaced while it was open; open it again"


def in_place(path):
    """Copy another store's files over a store's, which keep their names and sizes."""
    other = build(path.with_name("other.bfrt"), 2, "given")
    for file in sorted(p for p in other.rglob("*") if p.is_file()):
        with (path / file.relative_to(other)).open("r+b") as old:
            old.write(file.read_bytes())
            old.truncate()


# --- between open and render ---------------------------------------------------------------------


def test_one_that_is_replaced_before_the_render(path, way):
    scene = bfrt.open(path)
    build(path, 2, WAYS[way])
    with pytest.raises(StoreError) as caught:
        picture(scene, way)
    assert str(caught.value) == sentence(path)
    for ask in (scene.verify, scene.materials, lambda: scene.cast_rays([[5, 5, 20]], [[0, 0, -1]])):
        with pytest.raises(StoreError) as caught:
            ask()
        assert str(caught.value) == sentence(path)


def test_one_that_is_removed_before_the_render(path, way):
    scene = bfrt.open(path)
    shutil.rmtree(path)
    with pytest.raises(StoreError) as caught:
        picture(scene, way)
    assert str(caught.value) == f"{path}: the store was removed while it was open"


def test_one_that_has_another_name_by_now(path, way, shown):
    """It is read where it is, and its marks are not written into the store that has its name."""
    scene = bfrt.open(path)
    path.rename(path.with_name("old.bfrt"))
    build(path, 2, WAYS[way])
    assert_same(picture(scene, way), shown)
    assert not list(path.rglob("marks"))
    other = bfrt.render(path, refine=way, **SMALL)
    assert other.metadata["checksum"] != shown[1]["checksum"]


def test_one_that_is_truncated_is_told_as_that(path, way):
    scene = bfrt.open(path)
    file = path / "0/sphere/geometry"
    os.truncate(file, file.stat().st_size - 5)
    with pytest.raises(StoreError, match=r"geometry: found .* bytes, expected .* truncated"):
        picture(scene, way)


@pytest.mark.parametrize("way", ["sgb"])
def test_one_whose_files_are_written_over(path, way):
    scene = bfrt.open(path)
    in_place(path)
    with pytest.raises(StoreError) as caught:
        picture(scene, way)
    assert str(caught.value) == sentence(path)


# --- between two depths --------------------------------------------------------------------------


class Once:
    """A progress callback that does something once."""

    def __init__(self, action, when=1):
        self.action, self.left = action, when

    def __call__(self, progress):
        self.left -= 1
        if self.left == 0:
            self.action()


@pytest.mark.parametrize("when", [1, 2, 3, 5])
def test_one_that_is_replaced_during_the_render(path, way, shown, when):
    replaced = Once(lambda: build(path, 2, WAYS[way]), when)
    try:
        found = picture(bfrt.open(path), way, progress=replaced)
    except StoreError as error:
        assert str(error) == sentence(path)
    else:
        assert_same(found, shown)
    assert replaced.left <= 0


@pytest.mark.parametrize("when", [1, 3])
def test_one_that_is_removed_during_the_render(path, way, shown, when):
    removed = Once(lambda: shutil.rmtree(path), when)
    try:
        found = picture(bfrt.open(path), way, progress=removed)
    except StoreError as error:
        assert str(error) == f"{path}: the store was removed while it was open"
    else:
        assert_same(found, shown)
    assert removed.left <= 0


@pytest.mark.parametrize("way", ["sgb"])
def test_one_whose_files_are_written_over_during_the_render(path, way):
    with pytest.raises(StoreError) as caught:
        picture(bfrt.open(path), way, progress=Once(lambda: in_place(path)))
    assert str(caught.value) == sentence(path)


def test_one_that_is_replaced_again_and_again(path, way, shown):
    """Each render is that of one store; none finds one that is truncated or damaged."""
    second = picture(build(path.with_name("second") / path.name, 2, WAYS[way]), way)
    by_checksum = {facts["checksum"]: (pixels, facts) for pixels, facts in (shown, second)}
    over = threading.Event()

    def replace():
        for number in range(12):
            build(path, 2 - number % 2, WAYS[way])
        over.set()

    thread = threading.Thread(target=replace)
    thread.start()
    done = 0
    while not over.is_set() or not done:
        try:
            found = picture(path, way)
        except StoreError as error:
            assert str(error) in (sentence(path), gone(path))
        else:
            assert_same(found, by_checksum[found[1]["checksum"]])
            done += 1
    thread.join()


def gone(path):
    """What is said between the two renames of a replacement."""
    return f"{path}: not a scene store: expected a directory with scene.json"


# --- other processes -----------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["sgb", "tree"])
@pytest.mark.parametrize("sent", [copy.copy, lambda scene: pickle.loads(pickle.dumps(scene))])
def test_what_is_copied_is_the_same_store(path, way, shown, sent):
    assert_same(picture(sent(bfrt.open(path)), way), shown)


@pytest.mark.parametrize("way", ["sgb"])
def test_what_is_pickled_is_no_other_store(path, way):
    scene = bfrt.open(path)
    pickled = pickle.dumps(scene)
    assert len(pickled) < 300  # path and checksum; the other process reads the header itself
    build(path, 2, WAYS[way])
    found = bfrt.open(path).store.checksum
    with pytest.raises(StoreError) as caught:
        pickle.loads(pickled)
    assert str(caught.value) == (
        f"{path}: found the store {found:08x}, expected {scene.store.checksum:08x}, which was "
        "opened under this name"
    )
    shutil.rmtree(path)
    with pytest.raises(StoreError, match="not a scene store"):
        pickle.loads(pickled)


@pytest.mark.parametrize("way", ["sgb", "tree"])
def test_a_forked_process_reads_the_store_that_was_opened(path, way, shown):
    scene = bfrt.open(path)
    path.rename(path.with_name("old.bfrt"))
    build(path, 2, WAYS[way])
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    child = context.Process(target=lambda: theirs.send(picture(scene, way)))
    child.start()
    assert ours.poll(60)
    assert_same(ours.recv(), shown)
    child.join()
    assert child.exitcode == 0


@pytest.mark.parametrize("way", ["sgb"])
def test_a_folder_that_the_system_refuses_to_look_at_is_not_one_that_moved(path, monkeypatch):
    """Its marks would lie elsewhere."""

    def refusing(*_):
        raise OSError(errno.EIO, "refused")

    with bfrt.open(path) as scene:
        monkeypatch.setattr(os.path, "samestat", refusing)
        with pytest.raises(StreamError, match=f"^{path}: examining at byte 0"):
            assert scene.store.folder.in_place


def test_closed_scenes_give_their_folder_back(path, way):
    before = open_files()
    for _ in range(20):
        bfrt.open(path)
    assert open_files() == before
