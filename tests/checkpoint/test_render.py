"""A render that is broken off goes on from its checkpoint: the same picture, the same rays."""

from __future__ import annotations

import contextlib
import logging
from dataclasses import replace

import pytest
from checkpoints import (
    AOVS,
    VIEW,
    Killed,
    Stop,
    mostly_slow,
    same_picture,
    spied,
    tight,
)  # fmt: skip
from shading import LIT

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.state import SavedState
from bfrt.errors import Cancelled, DiskFullError, SettingError

REFINEMENTS = ("base", "sg", "sgb", "tree")
SETTINGS = {"camera": VIEW, "aovs": AOVS, "threads": 2}

#: Bytes of nodes, with which first nodes are kept too.
FIRST_NODES = 1 << 15

#: Of each form the refinement, and how the memory is divided.
FORMS = {
    "base": ("base", tight()),
    "sg": ("sg", tight()),
    "sgb": ("sgb", tight()),
    "sgb, bands": ("sgb", tight(rows=10)),
    "streamed": ("tree", tight(resident=False)),
    "streamed, kept": ("tree", tight(resident=False, kept=FIRST_NODES, cached=False)),
    "streamed, bands": ("tree", tight(resident=False, rows=10)),
    "resident": ("tree", tight(resident=True)),
}


#: Those that are run each time where a test takes long.
QUICK = ("sgb, bands", "streamed", "streamed, kept", "resident")


@pytest.fixture(scope="module")
def expected(scenes):
    return {name: scene.render(**SETTINGS) for name, scene in scenes.items()}


def opened(scenes, form):
    """A scene as a form has it, its refinement, and which of the scenes it is."""
    refine, divided = FORMS[form]
    name = "tree" if refine == "tree" else "given"
    return divided(scenes[name]), refine, name


@pytest.mark.parametrize("form", mostly_slow(FORMS, QUICK))
def test_a_kill_after_every_pass(scenes, expected, tmp_path, form):
    """Each run goes on for one pass, and is killed."""
    scene, refine, name = opened(scenes, form)
    settings = {**SETTINGS, "refine": refine, "scratch": tmp_path}
    whole = Stop()
    same_picture(scene.render(progress=whole, **settings), expected[name])
    folder = tmp_path / "kept"
    runs = 0
    while True:
        try:
            image = scene.render(
                progress=Stop(1), checkpoint=folder, every=0, **settings
            )  # the first report is of the pass before
            break
        except Killed:
            runs += 1
            assert [path.name for path in folder.iterdir()] != []
    assert runs >= whole.calls - 2 > 4
    same_picture(image, expected[name])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", ["sgb, bands", "streamed", "resident"])
def test_light_that_is_asked_for_goes_on(scenes, tmp_path, form):
    """Killed at every fifth pass: rays of ambient occlusion wait in the same spools as others."""
    scene, refine, name = opened(scenes, form)
    settings = {**SETTINGS, **LIT, "refine": refine, "scratch": tmp_path}
    expected = scenes[name].render(**SETTINGS, **LIT)
    runs = 0
    while True:
        try:
            image = scene.render(
                progress=Stop(5), checkpoint=tmp_path / "kept", every=0, **settings
            )
            break
        except Killed:
            runs += 1
    assert runs > 2
    same_picture(image, expected)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("form", FORMS)
def test_a_kill_after_every_save(scenes, expected, tmp_path, form, monkeypatch):
    """Between loads of hits that are shaded, too."""
    scene, refine, name = opened(scenes, form)
    kept, saves = Checkpoint.save, []
    shading = []

    def killing(checkpoint, write):
        kept(checkpoint, write)
        saves.append(1)
        if len(saves) == 2:
            state = SavedState(next(checkpoint.folder.iterdir()))
            shading.append(state.facts["shading"])
            raise Killed

    monkeypatch.setattr(Checkpoint, "save", killing)
    settings = {**SETTINGS, "refine": refine, "checkpoint": tmp_path / "kept", "every": 0}
    image = None
    while image is None:
        saves.clear()
        with contextlib.suppress(Killed):
            image = scene.render(**settings)
    assert sum(shading) > 2 and not all(shading)
    same_picture(image, expected[name])


@pytest.mark.parametrize("form", mostly_slow(FORMS, QUICK))
def test_other_memory_and_threads(scenes, expected, tmp_path, form, monkeypatch):
    scene, refine, name = opened(scenes, form)
    rows = 10 if "bands" in form else 19
    again = spied(monkeypatch)
    others = [
        tight(rows, rays=100, candidates=100, hits=31, queue=20, voxels=4**3),
        tight(rows, rays=5000, candidates=20000, hits=4000, queue=4000, voxels=16**3),
    ]
    if refine == "tree":
        resident = form != "resident"
        kept = 0 if "kept" in form else FIRST_NODES
        others = [
            tight(rows, resident=resident),
            tight(rows, resident=False, kept=kept, rays=70, candidates=70, hits=31),
        ]
    settings = {**SETTINGS, "refine": refine}
    whole = Stop()
    scene.render(progress=whole, **settings)
    for number, at in enumerate(range(1, whole.calls, max(1, whole.calls // 7))):
        folder = tmp_path / str(at)
        with pytest.raises(Killed):
            scene.render(progress=Stop(at), checkpoint=folder, every=0, **settings)
        other = others[number % 2](scenes[name])
        image = other.render(checkpoint=folder, **{**settings, "threads": 1 + number % 3})
        same_picture(image, expected[name])
        assert not folder.exists()
    assert any(again) == (form != "resident") and not all(again)


def test_kills_again_and_again_with_other_memory(scenes, expected, tmp_path):
    """Rays that begin again are traced anew each time, until a run gets beyond them."""
    forms = [tight(rows=10), tight(rows=10, voxels=4**3, rays=90, candidates=90)]
    for number in range(1000):
        try:
            image = forms[number % 2](scenes["given"]).render(
                refine="sgb",
                progress=Stop(9),
                checkpoint=tmp_path / "kept",
                every=0,
                **SETTINGS,
            )
            break
        except Killed:
            pass
    assert number > 3
    same_picture(image, expected["given"])


def test_a_run_that_goes_on_says_so(scenes, expected, tmp_path, caplog):
    scene, folder = tight()(scenes["given"]), tmp_path / "kept"
    with pytest.raises(Killed):
        scene.render(progress=Stop(25), checkpoint=folder, every=0, **SETTINGS)
    told = []
    with caplog.at_level(logging.INFO, "bfrt"):
        scene.render(progress=told.append, checkpoint=folder, **SETTINGS)
    said = [record.getMessage() for record in caplog.records]
    assert any(f"{folder}: goes on where it was left: band 1 of 1, depth" in text for text in said)
    assert told[0].done > 0


@pytest.mark.parametrize("name", ["given", "tree"])
def test_the_plan_counts_its_bytes(scenes, tmp_path, name):
    """Of two states: the one that is written, and the one before."""
    scene, folder = scenes[name], tmp_path / "kept"
    settings = {"camera": replace(VIEW, resolution=(90, 70)), "memory": "96MiB", "aovs": AOVS}
    assert scene.plan(**settings).disk.checkpoint == 0
    assert "checkpoint" not in str(scene.plan(**settings))
    planned = scene.plan(checkpoint=folder, **settings)
    assert not folder.exists()
    assert "at most, checkpoint" in str(planned)
    sizes = []

    def report(_):
        sizes.append(sum(file.stat().st_size for file in folder.glob("state.*/*")))

    scene.render(checkpoint=folder, every=0, progress=report, **settings)
    assert planned.disk.checkpoint / 60 < 2 * max(sizes) <= planned.disk.checkpoint


def test_nothing_is_saved_before_it_is_due(scenes, tmp_path):
    seen = []

    def report(_):
        seen.append(sorted(path.name for path in (tmp_path / "kept").iterdir()))

    scenes["given"].render(progress=report, checkpoint=tmp_path / "kept", every=3600, **SETTINGS)
    assert seen and not any(seen)
    assert not (tmp_path / "kept").exists()


@pytest.mark.parametrize("way", [Cancelled, KeyboardInterrupt])
def test_what_is_cancelled_saves_its_state(scenes, expected, tmp_path, way):
    """Before anything is due: no pass is lost."""
    scene, folder = tight()(scenes["given"]), tmp_path / "kept"
    told = []

    def report(progress):
        told.append(progress)
        if len(told) < 9:
            return True
        if way is Cancelled:
            return False
        raise way

    with pytest.raises(way):
        scene.render(progress=report, checkpoint=folder, **SETTINGS)
    again = []
    image = scene.render(progress=again.append, checkpoint=folder, **SETTINGS)
    assert again[0] == told[-1]
    same_picture(image, expected["given"])


def test_a_smaller_budget_that_cannot_hold_the_band(scenes, tmp_path):
    """The message names the least with which the render goes on."""
    camera = replace(VIEW, resolution=(700, 700))
    scene, folder = scenes["given"], tmp_path / "kept"
    with pytest.raises(Killed):
        scene.render(camera=camera, memory="512MiB", progress=Stop(1), checkpoint=folder, every=0)
    with pytest.raises(MemoryError, match=r"expected \d+MiB or more for 700 x 700 pixels, begun in "
                                          "bands of 700 rows,"):  # fmt: skip
        scene.render(camera=camera, memory="64MiB", checkpoint=folder)
    assert folder.exists()
    first = scene.render(camera=camera, memory="100MiB", threads=1, checkpoint=folder)
    same_picture(first, scene.render(camera=camera))


def test_a_last_save_that_fails_leaves_the_reason(scenes, tmp_path, monkeypatch, caplog):
    def failing(*_):
        raise DiskFullError("there", 0, 28, "writing")

    monkeypatch.setattr(Checkpoint, "save", failing)
    with pytest.raises(Killed):
        scenes["given"].render(progress=Stop(3), checkpoint=tmp_path / "kept", **SETTINGS)
    assert "the last state could not be saved: there: writing at byte 0" in caplog.text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("every", [-1, float("nan"), float("inf"), True, "60", None])
def test_every_is_a_number_of_seconds(scenes, tmp_path, every):
    with pytest.raises(SettingError, match=r"^every: found .*, expected seconds, 0 or more$"):
        scenes["given"].render(checkpoint=tmp_path / "kept", every=every)
    assert not (tmp_path / "kept").exists()
