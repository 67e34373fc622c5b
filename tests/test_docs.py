"""The pages name what the code has: constants, counters, names and options."""

from __future__ import annotations

import argparse
import re
from importlib import import_module
from pathlib import Path

import pytest

import bfrt
from bfrt import records
from bfrt.cli import parser
from bfrt.cluster.counters import ClusterStats

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


def keys(counts):
    """All keys of the counters, nested ones too."""
    for key, value in counts.items():
        yield key
        if isinstance(value, dict):
            yield from keys(value)


def test_every_counter_is_on_the_page():
    counted = ClusterStats(objects=0, scene_bytes=0, settings={}).as_dict()
    text = page("counters")
    assert [key for key in keys(counted) if f"``{key}``" not in text] == []


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


@pytest.mark.parametrize("file", sorted(DOCS.glob("*.rst")), ids=lambda file: file.stem)
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
