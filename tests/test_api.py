"""``import bfrt`` imports what it offers when that is first used, and all of it is there."""

import ast
import importlib
import pkgutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import bfrt


def fresh(code):
    """Run code in a process of its own, away from the source tree; return what it prints."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tempfile.gettempdir())
    assert done.stderr == ""
    return done.stdout.strip()


def offered_to_type_checkers(package):
    """What the stub imports, by its name: ``module:name``."""
    stub = ast.parse(Path(package.__file__).with_suffix(".pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {
        name.asname or name.name: f"{node.module}:{name.name}"
        for node in imports
        for name in node.names
    }


def test_all_is_offered():
    told = offered_to_type_checkers(bfrt) | {"spd": "bfrt.spd"}
    assert told == bfrt.OFFERED
    assert bfrt.__all__ == sorted(bfrt.OFFERED)
    for name in bfrt.__all__:
        home, _, inside = bfrt.OFFERED[name].partition(":")
        module = importlib.import_module(home)
        assert getattr(bfrt, name) is (getattr(module, inside) if inside else module)
    assert set(bfrt.__all__) < set(dir(bfrt))
    rooms = {one.name for one in pkgutil.iter_modules(bfrt.__path__)}
    assert bfrt.OFFERED.keys() & rooms == {"spd"}  # which is offered


@pytest.mark.parametrize("room", ["cluster", "planning", "queries", "wavefront"])
def test_all_that_a_room_offers_is_there(room):
    package = importlib.import_module(f"bfrt.{room}")
    assert offered_to_type_checkers(package) == package.OFFERED
    for name in package.OFFERED:
        assert getattr(package, name) is not None
        assert name in vars(package)  # kept for the next time
    # A module that is imported becomes an attribute of its package.
    assert not package.OFFERED.keys() & {one.name for one in pkgutil.iter_modules(package.__path__)}


@pytest.mark.parametrize("name", ["nothing", "__nothing__"])
def test_nothing_else_is(name):
    with pytest.raises(AttributeError, match=f"module 'bfrt' has no attribute '{name}'"):
        getattr(bfrt, name)


def test_the_first_use_imports():
    asked = "print('numpy' in sys.modules)"
    assert fresh(f"import bfrt, sys; {asked}; bfrt.render; {asked}") == "False\nTrue"


@pytest.mark.parametrize(
    "room",
    ["cluster.shared_frame", "conversion", "formats", "planning.planned", "queries.question"],
)
def test_a_render_loads_nothing_else(room):
    asked = f"print(any(name.startswith('bfrt.{room}') for name in sys.modules))"
    assert fresh(f"import bfrt, sys; bfrt.render; {asked}") == "False"


@pytest.mark.parametrize(
    "code",
    [
        "from bfrt import *; print(render.__name__)",
        "from bfrt import render; print(render.__name__)",
        "from bfrt import spd; import bfrt; print(bfrt.render.__name__)",
        "import bfrt.scene; print(bfrt.render.__name__)",
        "import bfrt; bfrt.render; print(bfrt.scene.render.__name__)",
        "import bfrt; 'render' in dir(bfrt) and print('render')",
    ],
)
def test_every_way_to_import_it(code):
    assert fresh(code) == "render"


def test_threads_may_use_it_first_at_the_same_time():
    code = """
import threading, bfrt
names = ["render", "convert", "open", "Scene", "spd", "cast_rays"]
found = []
threads = [threading.Thread(target=lambda n=n: found.append(getattr(bfrt, n))) for n in names]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print(len(found))
"""
    assert fresh(code) == "6"
