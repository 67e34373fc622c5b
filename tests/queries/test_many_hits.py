"""One ray that meets more than memory holds: its hits are parted by t, then by object."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from capped import memory_cap
from hypothesis import given
from hypothesis import strategies as st
from memory_cap import run_in

import bfrt
from bfrt.budget import capacities
from bfrt.queries import answers
from bfrt.queries.answers import halves, ordered, pieces
from bfrt.queries.surfaces import SURFACE
from bfrt.scene import Scene
from bfrt.streams.spool import Spool

T = st.sampled_from([-np.inf, -2.5, -1e-300, -0.0, 0.0, 5e-324, 1.0, 1 + 2**-52, 3.0, np.inf])
KEY = st.sampled_from([0, 1, (1 << 32) - 1, 1 << 32, 5 << 48, (1 << 64) - 2])


@given(st.lists(st.tuples(st.integers(0, 3), T, KEY), max_size=120, unique=True), st.integers(1, 9))
def test_hits_of_few_rays_in_order(hits, room):
    records = np.zeros(len(hits), SURFACE)
    for name, values in zip(("number", "t", "key"), zip(*hits, strict=True), strict=False):
        records[name] = values
    with TemporaryDirectory() as folder:
        spool = Spool(SURFACE, 3, Path(folder))
        spool.append(records)
        found = list(ordered(spool, 4, room))
        spool.close()
    same = {tuple(hit) for part in found for hit in part[["number", "t", "key"]].tolist()}
    assert len(same) == len({(number, t + 0.0, key) for number, t, key in hits})
    together = np.concatenate([np.zeros(0, SURFACE), *found])
    expected = np.lexsort([records["key"], records["t"], records["number"]])
    for name in ("number", "t", "key"):
        np.testing.assert_array_equal(together[name], records[name][expected])
    for part in found:
        assert len(part) <= room or len(set(part["t"] + 0.0)) == len(set(part["key"])) == 1


def test_halves_ascend_as_numbers_do():
    t = np.array([-np.inf, -1e300, -1.0, -5e-324, 0.0, 5e-324, 1.0, 1 + 2**-52, np.inf])
    records = np.zeros(len(t), SURFACE)
    records["t"] = t
    pairs = list(zip(halves("t", True, records), halves("t", False, records), strict=True))
    assert pairs == sorted(set(pairs)) and len(pairs) == len(t)
    records["t"] = -0.0
    assert int(halves("t", True, records)[0]) == pairs[4][0]


def test_pieces_are_all(monkeypatch):
    monkeypatch.setattr(answers, "ROWS", 3)
    blocks = [np.arange(7), np.arange(0), np.arange(7, 9)]
    found = list(pieces(iter(blocks)))
    assert [len(piece) for piece in found] == [3, 3, 1, 2]
    assert np.concatenate(found).tolist() == list(range(9))


@pytest.fixture(scope="module")
def row(tmp_path_factory):
    """Balls in a row, which a ray along it meets all; some twice, in one place."""
    path = tmp_path_factory.mktemp("row") / "row.bfrt"
    places = np.zeros((4000, 3))
    places[:, 0] = np.repeat(np.arange(2000), 2) / 10
    with bfrt.SceneWriter(path) as writer:
        writer.spheres(places, 0.04)
    return path


@pytest.mark.parametrize("refine", ["tree", "sgb"])
def test_a_ray_that_meets_more_than_memory_holds(row, refine, tmp_path, monkeypatch):
    origins = np.array([[-1.0, 0, 0], [-1, 9, 0], [300, 0.01, 0], [50, 0, 0], [0, 9, 0]])
    ways = np.array([[1.0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [1, 0, 0]])
    asked = {"t_min": -10.0, "refine": refine, "memory": "128MiB", "threads": 1}
    expected = bfrt.list_intersections(row, origins, ways, **asked)
    ends = expected["ray_splits"].tolist()
    assert ends[1] == 8000 and ends[2] == 8000 and ends[3] == 16000 and ends[5] == ends[4]
    monkeypatch.setattr(answers, "ROWS", 100)
    monkeypatch.setattr("bfrt.queries.question.FEWEST_HELD", 16)

    def divide(*given):
        return dataclasses.replace(capacities(*given), queue=1, hits=64)

    scene = Scene(bfrt.open(row).store, divide)
    found = scene.list_intersections(origins, ways, out=tmp_path / "answer", **asked)
    assert found.keys() == expected.keys()
    for key, values in expected.items():
        np.testing.assert_array_equal(found[key], values, key)


LISTED = """
import sys
import numpy as np
import bfrt
path, out, rays, memory = sys.argv[1:]
origins = np.tile([[-5.0, 0, 0]], (int(rays), 1))
ways = np.tile([[1.0, 0, 0]], (int(rays), 1))
found = bfrt.list_intersections(path, origins, ways, out=out, memory=int(memory), threads=2)
print(found["ray_splits"].tolist())
"""


@pytest.mark.slow
@pytest.mark.parametrize("memory", [59, 76, 118])
def test_a_million_hits_in_their_budget(tmp_path, memory):
    places = np.zeros((500_000, 3))
    places[:, 0] = np.arange(500_000) / 100
    with bfrt.SceneWriter(tmp_path / "row.bfrt") as writer:
        writer.spheres(places, 0.004)
    with memory_cap(memory << 20) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        work = [
            sys.executable,
            "-c",
            LISTED,
            str(tmp_path / "row.bfrt"),
            str(tmp_path / "out"),
            "2",
        ]
        ended = run_in(group, [*work, str(memory << 20)], tmp_path)
    assert (ended.returncode, ended.stdout) == (0, "[0, 1000000, 2000000]\n"), ended.stderr
