"""Several at once over one store, each promise of docs/reliability.rst."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading

import numpy as np
import pytest
from small_pictures import SMALL, rgb

import bfrt

ASK = """
import sys
import bfrt
path, refine, out = sys.argv[1:]
sys.stdin.read(1)  # all begin together
bfrt.render(path, refine=refine, memory="96MiB", threads=1).save(out)
"""


@pytest.fixture
def path(tmp_path):
    rng = np.random.default_rng(5)
    with bfrt.SceneWriter(tmp_path / "a.bfrt") as writer:
        writer.camera(bfrt.Camera((5, 5, 20), (5, 5, 5), (0, 1, 0), resolution=(32, 24)))
        writer.light(bfrt.Light((5, 20, 20)))
        writer.spheres(rng.uniform(0, 10, (5000, 3)), 0.1)
    return tmp_path / "a.bfrt"


@pytest.mark.parametrize("refine", ["tree", "base", "sgb"])
def test_many_processes_render_a_fresh_store_at_once(path, tmp_path, refine):
    """There are no marks when they begin, and whole ones when they end."""
    outs = [tmp_path / f"{k}.npy" for k in range(4)]
    work = [sys.executable, "-c", ASK, str(path), refine]
    children = [
        subprocess.Popen([*work, str(out)], cwd=tmp_path, stdin=subprocess.PIPE, stderr=-1)
        for out in outs
    ]
    for child in children:
        child.stdin.write(b"x")
        child.stdin.flush()
    for child in children:
        assert child.communicate(timeout=120)[1] == b""
        assert child.returncode == 0
    bfrt.open(path).verify()
    marks = [file.name for file in (path / "0").iterdir() if file.is_file()]
    assert marks == ([] if refine == "tree" else ["marks"])
    expected = bfrt.render(path, refine=refine, fresh_marks=refine != "tree", **SMALL).rgba
    for out in outs:
        np.testing.assert_array_equal(np.load(out), expected)


def test_threads_share_a_scene(path):
    scene = bfrt.open(path)
    expected = rgb(path, "tree")
    found = []
    threads = [
        threading.Thread(target=lambda refine=refine: found.append(rgb(scene, refine)))
        for refine in ("tree", "sgb", "base", "tree")
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    for each in found:
        np.testing.assert_array_equal(each, expected)


@pytest.mark.parametrize("way", ["fork", "spawn"])
def test_other_processes_take_a_scene(path, way):
    scene = bfrt.open(path)
    scene.cast_rays([[5.0, 5, 20]], [[0.0, 0, -1]], **SMALL)  # a session is kept, with threads
    with multiprocessing.get_context(way).Pool(2) as pool:
        asked = pool.starmap_async(rgb, [(scene, "tree"), (scene, "sgb"), (scene, "tree")])
        found = asked.get(timeout=100)
    for each in found:
        np.testing.assert_array_equal(each, rgb(scene, "tree"))


def test_several_writers_of_one_name(path):
    def write(number):
        try:
            with bfrt.SceneWriter(path) as writer:
                writer.spheres(np.arange(3.0 * (number + 1)).reshape(-1, 3), 1)
        except bfrt.StreamError as error:  # another's rename came between
            assert "renaming to it" in str(error)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    scene = bfrt.open(path)
    scene.verify()
    assert 1 <= scene.objects <= 6
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
