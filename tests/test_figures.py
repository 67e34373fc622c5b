"""The drawings of the pages are what their scripts draw, from numbers that are the code's own."""

from __future__ import annotations

import re
import runpy
from itertools import pairwise
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="the bench extra is not installed")

import bfrt
from bfrt.store.store import open_store

DOCS = Path(__file__).resolve().parents[1] / "docs"
FIGURES = DOCS / "figures"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("figures")
    for script in FIGURES.glob("*.py"):
        runpy.run_path(str(script))["main"](str(folder))
    return folder


def test_a_figure_has_a_script_and_a_page(drawn):
    made = {path.name for path in drawn.iterdir()}
    assert made == {path.name for path in FIGURES.glob("*.png")}
    shown = {
        name
        for page in DOCS.glob("*.rst")
        for name in re.findall(r"figures/(\w+\.png)", page.read_text())
    }
    assert shown == made


def test_the_parts_of_a_budget_are_all_of_it(tmp_path):
    script = runpy.run_path(str(FIGURES / "budget.py"))
    bfrt.spd.scene("rings", 3).write(tmp_path / "a.bfrt")
    large = script["enlarged"](open_store(tmp_path / "a.bfrt"), script["OBJECTS"])
    count = sum(stream.count for stream in large.groups[0].streams)
    assert 0.999 * script["OBJECTS"] < count <= script["OBJECTS"]
    parts, held = script["division"](large)
    # What is left are fractions of a ray, a hit and a queued ray, and a page.
    assert 0 <= held.memory - sum(parts.values()) < 8192
    assert all(size > 0 for size in parts.values())


def test_walks_go_from_voxel_to_neighbor():
    script = runpy.run_path(str(FIGURES / "paper.py"))
    shape = script["SHAPE"]
    for ray in script["RAYS"]:
        voxels = [voxel for voxel, _ in ray.walk(shape)]
        assert len(voxels) > shape[0] - 1
        steps = [abs(a[0] - b[0]) + abs(a[1] - b[1]) for a, b in pairwise(voxels)]
        assert set(steps) == {1}
