"""Stores whose bytes were changed anywhere: an error or a picture, and both soon.

The header is signed again, and the marks get its checksum, so that no checksum stands in the way.
"""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import random_objects
from signing import sign_store

import bfrt
from bfrt.errors import BfrtError, StoreError
from bfrt.records import Kind

#: How objects are found, and the order of the store.
WAYS = [
    ("base", "given"), ("sg", "given"), ("sgb", "given"), ("tree", "spatial"), ("sgb", "spatial"),
]  # fmt: skip

#: Stores that are changed for each way, and the seconds that all of them may take.
EACH, SECONDS = 60, 300

NUMBERS = [0, 1, -1, 255, 2**31 - 1, 2**40, 2.5, 1e18, 1e38, 3.4e38, 1e300, -1e300, 1e-300]
WORDS = [
    np.float32(number).tobytes() for number in (0, 1e38, -1e38, 1e-40, 1000, "inf", "-inf", "nan")
] + [b"\xff" * 4, b"\1\0\0\0", b"\0\0\1\0"]  # fmt: skip


def build(path, order):
    objects = random_objects(np.random.default_rng(1), 40)
    with bfrt.SceneWriter(path, order=order, dtype="float32") as writer:
        eye = bfrt.Camera((0.0, 0.0, 15.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), resolution=(12, 12))
        writer.camera(eye)
        writer.light(bfrt.Light((1.0, 2.0, 30.0)))
        shiny = writer.material(bfrt.Material(ks=0.5, transmittance=0.3))
        writer.append(Kind.SPHERE, objects.spheres, shiny)
        writer.append(Kind.CONE, objects.cones)
        writer.append(Kind.TRIANGLE, objects.triangles)
        writer.append(Kind.PATCH, objects.patches)
        writer.append_polygons(objects.vertices, objects.counts)
    return path


def numbers_in(part, way=()):
    """The places of all numbers in a header."""
    if isinstance(part, (dict, list)):
        for key, inner in part.items() if isinstance(part, dict) else enumerate(part):
            yield from numbers_in(inner, (*way, key))
    elif isinstance(part, (int, float)) and way[0] not in ("version", "checksum"):
        yield way


def change(path, chance):
    """Change a number of the header, or a few bytes of a file."""
    header = json.loads((path / "scene.json").read_text())
    files = sorted(file for file in path.rglob("*") if file.is_file() and file.stat().st_size)
    file = chance.choice([each for each in files if each.suffix != ".json"])
    if chance.random() < 0.4:
        *way, last = chance.choice(list(numbers_in(header)))
        part = header
        for key in way:
            part = part[key]
        part[last] = type(part[last])(min(chance.choice(NUMBERS), 1e18 if part[last] else 1e300))
    else:
        data = bytearray(file.read_bytes())
        for _ in range(chance.choice([1, 1, 3, 20])):
            at = chance.randrange(len(data)) // 4 * 4
            word = chance.choice(WORDS)[: len(data) - at]
            data[at : at + len(word)] = word
        file.write_bytes(data)
    sign_store(path, header)


def render_changed(folder, refine, order):
    """Change a store many times, and render each; return what came of them."""
    whole = build(folder / "whole.bfrt", order)
    if refine != "tree":
        bfrt.render(whole, refine=refine, memory="96MiB", threads=1)
    outcomes = set()
    for seed in range(EACH):
        path = folder / "changed.bfrt"
        shutil.rmtree(path, ignore_errors=True)
        shutil.copytree(whole, path)
        change(path, random.Random(seed))
        try:
            bfrt.render(path, refine=refine, memory="96MiB", threads=1)
            outcomes.add("picture")
        except BfrtError as error:
            outcomes.add(type(error).__name__)
    return outcomes


@pytest.mark.parametrize(("refine", "order"), WAYS)
def test_a_changed_store_is_an_error_or_a_picture(tmp_path, refine, order):
    """In a process of its own, which is ended where it goes on for ever."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); "
        f"sys.path.insert(0, {str(Path(__file__).parents[1])!r}); "
        "import numpy as np; np.seterr(all='ignore'); "
        "from pathlib import Path; from test_mutated import render_changed; "
        f"print(*sorted(render_changed(Path.cwd(), {refine!r}, {order!r})))"
    )
    work = [sys.executable, "-c", code]
    ended = subprocess.run(
        work, cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert {"picture", "StoreError"} <= set(ended.stdout.split())


@pytest.mark.parametrize("field", ["bounds", "grid_bounds"])
def test_bounds_that_no_boxes_have(tmp_path, field):
    """A grid of so large a volume would be sought for ever."""
    path = build(tmp_path / "a.bfrt", "given")
    header = json.loads((path / "scene.json").read_text())
    part = header if field == "bounds" else header["groups"][0]
    part[field] = [[-1e300] * 3, [1e300] * 3]
    sign_store(path, header)
    with pytest.raises(StoreError, match=r"bounds.*coordinates that float32 has, up to 3.4e\+38"):
        bfrt.open(path)
