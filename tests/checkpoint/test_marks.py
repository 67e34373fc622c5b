"""Marks that a killed render was making: their layers are taken on, and are the same bytes."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from checkpoints import VIEW, Killed, same_picture, scene_of
from injected import dividing

from bfrt.grid.marks_log import MarksLog
from bfrt.phases.preprocess import Marking
from bfrt.scene import open_scene
from bfrt.scene_writer import SceneWriter

SETTINGS = {"camera": VIEW, "threads": 2, "refine": "sgb"}
GRID = 40  # voxels an axis: five layers of bricks


def subspaced(scene, grid=GRID, layers=1):
    """A scene whose marks are made in subspaces of some layers of bricks."""
    return dividing(scene, lambda held: replace(held, subspace=layers * 8 * grid * grid))


def marks_of(scene):
    files = [scene.path / str(group.number) / "marks" for group in scene.store.groups]
    return [file.read_bytes() for file in files if file.exists()]


class Layers:
    """Kills a run after a number of layers; counts the subspaces that are marked."""

    def __init__(self, monkeypatch):
        self.left, self.marked = -1, 0
        complete, marked = MarksLog.complete, Marking._marked

        def killing(log, crc, occupied):
            complete(log, crc, occupied)
            self.left -= 1
            if self.left == 0:
                raise Killed

        def counting(marking, first, end):
            self.marked += 1
            return marked(marking, first, end)

        monkeypatch.setattr(MarksLog, "complete", killing)
        monkeypatch.setattr(Marking, "_marked", counting)

    def kill_after(self, layers):
        self.left, self.marked = layers, 0


@pytest.fixture
def layers(monkeypatch):
    return Layers(monkeypatch)


@pytest.fixture
def scene(tmp_path):
    return subspaced(scene_of(tmp_path / "a.bfrt", groups=2))


@pytest.fixture
def expected(tmp_path):
    """The picture and the marks of a render that nobody kills, in one subspace."""
    scene = scene_of(tmp_path / "plain" / "a.bfrt", groups=2)
    image = scene.render(grid=GRID, **SETTINGS)
    return image, marks_of(scene)


def broken_off(scene, folder, layers, after):
    layers.kill_after(after)
    with pytest.raises(Killed):
        scene.render(grid=GRID, checkpoint=folder, **SETTINGS)
    layers.kill_after(-1)


def test_a_kill_after_any_layer(tmp_path, layers, expected, caplog):
    caplog.set_level(logging.INFO, "bfrt.checkpoint")
    for after in range(1, 11):
        scene = subspaced(scene_of(tmp_path / str(after) / "a.bfrt", groups=2))
        kept = tmp_path / f"kept{after}"
        broken_off(scene, kept, layers, after)
        image = scene.render(grid=GRID, checkpoint=kept, **SETTINGS)
        same_picture(image, expected[0])
        assert marks_of(scene) == expected[1] and not kept.exists()
        assert layers.marked == 10 - after
        done = (after - 1) % 5 + 1
        assert f"goes on where it was left: marks, {done} of 5 layers are complete" in caplog.text
        caplog.clear()


def test_a_kill_after_every_layer(scene, tmp_path, layers, expected):
    kept, runs = tmp_path / "kept", 0
    while True:
        layers.kill_after(1)
        runs += 1
        try:
            image = scene.render(grid=GRID, checkpoint=kept, fresh_marks=False, **SETTINGS)
        except Killed:
            continue
        break
    same_picture(image, expected[0])
    assert marks_of(scene) == expected[1] and runs == 11 and not kept.exists()


@pytest.mark.parametrize("memory", [1, 2, 100])
def test_memory_may_change(scene, tmp_path, layers, expected, memory):
    broken_off(scene, tmp_path / "kept", layers, 2)
    other = subspaced(scene, layers=memory)
    same_picture(other.render(grid=GRID, checkpoint=tmp_path / "kept", **SETTINGS), expected[0])
    assert marks_of(scene) == expected[1]
    assert layers.marked == {1: 8, 2: 2 + 3, 100: 1 + 1}[memory]


@pytest.mark.parametrize("name", ["layers", "index"])
def test_what_is_torn_or_damaged_is_made_again(tmp_path, layers, expected, name):
    """As a loss of power leaves it: bytes that are missing, or are others, at the end or before."""
    made = subspaced(scene_of(tmp_path / "other" / "a.bfrt", groups=2))
    broken_off(made, tmp_path / "made", layers, 4)
    whole = {path.name: path.read_bytes() for path in (tmp_path / "made").iterdir()}
    data = whole[f"bfrt-marks.0.{name}"]
    assert len(whole) == 2
    scene = subspaced(scene_of(tmp_path / "a.bfrt", groups=2))
    marked = set()
    for number, at in enumerate([0, 20, len(data) // 2, len(data) - 1, None]):
        damages = [b""] if at is None else [data[:at], data[:at] + b"?" + data[at + 1 :]]
        for damaged in damages:
            kept = tmp_path / f"kept{number}"
            kept.mkdir()
            for other, held in whole.items():
                (kept / other).write_bytes(damaged if other.endswith(name) else held)
            layers.kill_after(-1)
            image = scene.render(grid=GRID, checkpoint=kept, fresh_marks=True, **SETTINGS)
            same_picture(image, expected[0])
            assert marks_of(scene) == expected[1] and not kept.exists()
            marked.add(layers.marked)
    assert len(marked) > 2 and min(marked) >= 6 and max(marked) == 10


def test_marks_of_another_grid_or_scene_are_made_anew(scene, tmp_path, layers, expected):
    kept = tmp_path / "kept"
    broken_off(scene, kept, layers, 2)
    other = subspaced(scene, 48)
    other.render(grid=48, checkpoint=kept, **SETTINGS)
    assert layers.marked == 12 and not kept.exists()
    broken_off(subspaced(scene), kept, layers, 2)
    with SceneWriter(tmp_path / "b.bfrt", origin=(0, 0, 0), order="given") as writer:
        writer.spheres(np.random.default_rng(4).uniform(-4, 4, (300, 3)), 0.3)
    layers.kill_after(-1)
    subspaced(open_scene(tmp_path / "b.bfrt")).render(grid=GRID, checkpoint=kept, **SETTINGS)
    assert layers.marked == 5 and not kept.exists()


def test_another_refinement_removes_them(tmp_path, layers):
    scene = subspaced(scene_of(tmp_path / "a.bfrt", groups=1, order="spatial"))
    kept = tmp_path / "kept"
    broken_off(scene, kept, layers, 2)
    scene_of(tmp_path / "b.bfrt", groups=1, order="spatial").render(
        **{**SETTINGS, "refine": "tree"}, checkpoint=kept
    )
    assert not kept.exists()


def test_one_subspace_needs_none(tmp_path, layers):
    scene = scene_of(tmp_path / "a.bfrt", groups=1)
    layers.kill_after(1)
    scene.render(grid=GRID, checkpoint=tmp_path / "kept", **SETTINGS)
    assert layers.marked == 1 and not (tmp_path / "kept").exists()


def test_the_plan_counts_them(scene, tmp_path):
    kept = tmp_path / "kept"
    plans = [
        each.plan(grid=GRID, checkpoint=kept, **SETTINGS)
        for each in (subspaced(scene, layers=100), subspaced(scene))
    ]
    more = plans[1].disk.checkpoint - plans[0].disk.checkpoint
    assert more == max(grid.marks_bytes for grid in plans[1].grids)
