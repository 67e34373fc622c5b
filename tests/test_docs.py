"""The pages name what the code has: constants, counters, names and options."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import bfrt
from bfrt import records
from bfrt.cli import parser
from bfrt.cluster.counters import ClusterStats
from bfrt.records import NODE_BYTES, PARENT_BYTES, TREELET_BYTES, Kind
from bfrt.store.hierarchy import LEAST_CHILDREN
from bfrt.store.ordering.memory import SLOWEST, Pace, memory_of
from bfrt.store.ordering.objects import Layout, id_bytes_of
from bfrt.store.ordering.room import (
    NODES,
    NODES_OBJECTS,
    OBJECTS_A_TREELET,
    USUAL_TREE_BYTES,
    WEIGHT_A_WINDOW,
    Amount,
    room_beside,
    room_of,
)
from bfrt.wavefront.travel import RenderStats, TravelStats
from bfrt.workers import WAITING

DOCS = Path(__file__).resolve().parents[1] / "docs"
SUFFIXES = {".py", ".pyi", ".pyx", ".pxd"}


def page(name):
    return (DOCS / f"{name}.rst").read_text()


#: Name, value, and the file that it is in; records' are all in one.
CONSTANTS = re.findall(
    r"\* - ``([A-Z_]+)``\n\s+- ([\d.]+)\n(?:\s+- ``bfrt/([\w/]+)\.pyx?``\n)?", page("memory")
)


def test_the_page_names_constants():
    owners = {file for _, _, file in CONSTANTS}
    assert len(CONSTANTS) > 35 and len(owners) > 8


@pytest.mark.parametrize(("name", "value", "file"), CONSTANTS)
def test_a_constant_is_what_the_page_says(name, value, file):
    owner = import_module(f"bfrt.{(file or 'records').replace('/', '.')}")
    assert getattr(owner, name) == float(value)


def test_every_size_of_a_record_is_on_the_page():
    # Those of a store's files are on its own page.
    sizes = {name for name in vars(records) if name.endswith("_BYTES")}
    of_files = {"BOX_BYTES", "OFFSET_BYTES", "TREELET_BYTES", "NODE_BYTES"}
    assert sizes - of_files <= {name for name, _, _ in CONSTANTS}


COSTS = re.findall(r"^(sphere|cone|triangle|patch|polygon) +(\d.*)$", page("tree"), re.MULTILINE)


@pytest.mark.parametrize(("label", "numbers"), COSTS)
def test_what_an_object_costs_in_spatial_order(label, numbers):
    n, kind = 10**6, next(kind for kind in Kind if kind.label == label)
    geometry, ids, nodes, treelets, levels, near, other, most, least = map(float, numbers.split())
    corners = 4 if kind.counted else 1
    layout = Layout(kind, False, (0.0, 0.0, 0.0), id_bytes_of(n), 0)
    assert (geometry, ids) == (corners * layout.stride, layout.id_bytes)
    assert nodes + treelets < 22.9 and levels < 4.6
    assert 0.7 * USUAL_TREE_BYTES < nodes + treelets + levels < 1.3 * USUAL_TREE_BYTES
    for disk, local in ((near, True), (other, False)):
        room = room_of(layout, Amount(n, corners * n, local))
        assert disk == round(room_beside([room]) / n, 1)
    amount = Amount(n, corners * n, False, corners)
    for memory, pace in ((most, Pace(2, WAITING)), (least, SLOWEST)):
        assert memory == round(memory_of(layout, amount, pace) / 2**20)


def test_costs_are_of_all_kinds_and_at_most_as_said():
    assert [label for label, _ in COSTS] == [kind.label for kind in Kind]
    treelets = 1 / OBJECTS_A_TREELET + 2 / WEIGHT_A_WINDOW
    most = (NODES / NODES_OBJECTS + treelets) * NODE_BYTES + treelets * TREELET_BYTES
    text = page("tree")
    assert f"eight nodes for {NODES_OBJECTS} and a treelet for {OBJECTS_A_TREELET}" in text
    assert f": {most:.1f} bytes an object" in " ".join(text.split())
    assert f"{PARENT_BYTES / (LEAST_CHILDREN - 1):.1f}, since" in text
    assert (NODES, LEAST_CHILDREN) == (8, 8)
    assert f"A node is {NODE_BYTES} bytes and a treelet {TREELET_BYTES}." in text


def keys(counts):
    """All keys of the counters, nested ones too."""
    for key, value in counts.items():
        yield key
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, dict):
                yield from keys(each)


@pytest.mark.parametrize("made", [ClusterStats, TravelStats, RenderStats])
def test_every_counter_is_on_the_page(made):
    counted = made(objects=0, scene_bytes=0, settings={})
    if made is RenderStats:
        counted.travel_of(1)
    text = page("counters")
    assert [key for key in keys(counted.as_dict()) if f"``{key}``" not in text] == []


def test_every_public_name_is_on_the_page():
    text = page("api")
    names = [f"bfrt.{name}" for name in bfrt.__all__ if name != "spd"]
    names += [f"bfrt.spd.{name}" for name in bfrt.spd.__all__]
    documented = re.findall(r"^\.\. auto\w+:: ([\w.]+)$", text, re.MULTILINE)
    assert sorted(set(names) - set(documented)) == []


def commands():
    (action,) = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    return action.choices


@pytest.mark.parametrize("name", commands())
def test_every_option_is_on_the_page(name):
    text = page("quickstart")
    assert f"``bfrt {name} " in text
    long = [
        option
        for action in commands()[name]._actions
        for option in action.option_strings
        if option.startswith("--") and option not in ("--help", "--output")
    ]
    assert "--quiet" in long
    assert [option for option in long if not re.search(rf"{option}\b", text)] == []


@pytest.mark.parametrize("file", sorted(DOCS.rglob("*.rst")), ids=lambda file: file.stem)
def test_a_file_that_a_page_names_is_there(file):
    named = re.findall(r"``(bfrt/[\w./]+|docs/[\w./]+|setup\.py)``", file.read_text())
    root = DOCS.parent
    assert [name for name in named if name != "docs/_build" and not (root / name).exists()] == []


SOURCES = [path for path in (DOCS.parent / "bfrt").rglob("*") if path.suffix in SUFFIXES]


@pytest.mark.parametrize(
    "file", sorted(SOURCES), ids=lambda file: f"{file.parent.stem}/{file.name}"
)
def test_a_file_that_a_comment_names_is_there(file):
    """By its way from the repository, or by its name alone; of `x.py` any phase is meant."""
    root, known = DOCS.parent, {path.name for path in SOURCES} | {"x.py", "_x.pyx"}
    named = re.findall(r"[\w/]+\.(?:py|pyi|pyx|pxd)\b", file.read_text())
    assert [n for n in named if n not in known and not (root / n).exists()] == []


FUNCTIONS = re.findall(r"``(\w+\.(?:pyx|pxd|py))``: ``([\w.]+)``", page("algorithm"))


def test_the_page_names_functions():
    assert len(FUNCTIONS) > 15


@pytest.mark.parametrize(("file", "name"), FUNCTIONS)
def test_a_function_is_in_the_file_that_the_page_names(file, name):
    texts = [path.read_text() for path in (DOCS.parent / "bfrt").rglob(file)]
    last = name.split(".")[-1]
    assert any(re.search(rf"(def|class|cdef [\w *]+) {last}\b", text) for text in texts)


def test_the_pages_build_without_a_warning(tmp_path):
    pytest.importorskip("furo", reason="the docs extra is not installed")
    pytest.importorskip("numpydoc", reason="the docs extra is not installed")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(DOCS), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "search.html").exists()
    assert "Written by bench/report.py" not in (tmp_path / "performance.html").read_text()
