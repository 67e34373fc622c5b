"""What a budget holds of treelets is no more than the budget, and the least that works works."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from injected import dividing
from properties import examples
from treelets import small_treelets

import bfrt
from bfrt.budget import RESIDENT_PART, TreeCapacities, capacities, fixed_bytes
from bfrt.errors import BudgetError
from bfrt.image.frame import FrameSize
from bfrt.memory import parse_memory
from bfrt.phases.traversal import FEWEST_RAYS
from bfrt.records import HIT_BYTES, QUEUED_BYTES, RAY_BITS
from bfrt.settings import Settings
from bfrt.store.store import open_store
from bfrt.store.writer import StoreWriter
from bfrt.tree.forest import TREELET_SHARE, Forest
from bfrt.tree.pieces import PieceReader

MIB = 1 << 20


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    """A small store, one of several streams with a large polygon, and one of more objects."""
    folder = tmp_path_factory.mktemp("memory")
    rng = np.random.default_rng(1)
    with StoreWriter(folder / "small", order="spatial") as writer:
        writer.spheres(rng.random((50, 3), np.float32), 0.1)
    with small_treelets(64), StoreWriter(folder / "several", order="spatial") as writer:
        writer.spheres(rng.random((500, 3), np.float32), 0.1)
        writer.triangles(rng.random((5000, 3, 3), np.float32))
        turn = np.linspace(0, 2 * np.pi, 30_000, endpoint=False)
        outline = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        writer.polygons(outline.astype(np.float32), [len(turn)])
    with StoreWriter(folder / "many", order="spatial") as writer:
        writer.triangles(rng.random((200_000, 3, 3), np.float32))
    return [open_store(folder / name) for name in ("small", "several", "many")]


def divided(store, view, memory):
    """What a budget holds, for a view of (width, height, samples, threads)."""
    width, height, samples, threads = view
    given = Settings.of(memory=memory, threads=threads, refine="tree")
    return capacities(store, given, FrameSize(width, height, samples, ()))


def least_of(store, view):
    """What the refusal of one byte names, in bytes."""
    with pytest.raises(BudgetError) as caught:
        divided(store, view, 1)
    return parse_memory(re.findall(r"expected (\S+) or more", str(caught.value))[0])


VIEW = st.tuples(
    st.integers(1, 4096), st.integers(1, 4096), st.sampled_from([0, 1, 16]), st.integers(1, 64)
)


@given(view=VIEW, which=st.integers(0, 2))
def test_the_least_that_is_named_works_and_less_does_not(stores, view, which):
    least = least_of(stores[which], view)
    held = divided(stores[which], view, least)
    assert isinstance(held, TreeCapacities)
    assert min(held.rays, held.candidates, held.hits, held.queue) > 0
    assert held.rays >= FEWEST_RAYS - 1 or held.resident
    with pytest.raises(BudgetError):
        divided(stores[which], view, least - MIB)


@examples(200)
@given(view=VIEW, which=st.integers(0, 2), more=st.integers(0, 1 << 30) | st.integers(0, 1 << 36))
def test_the_parts_add_up_to_no_more_than_the_budget(stores, view, which, more):
    store = stores[which]
    width, height, samples, threads = view
    memory = least_of(store, view) + more
    held = divided(store, view, memory)
    corners = samples == 0
    pixels = 0 if held.frame_on_disk else width * height * 40
    treelets = Forest.resident_bytes(store)
    parts = {
        "fixed": fixed_bytes(store, Settings.of(memory=memory, threads=threads, refine="tree")),
        "frame": (width + corners) * (held.rows + corners) * 56 + pixels,
        "treelets": treelets if held.resident else held.kept,
        "rays": held.rays * (72 + 24),
        "candidates": held.candidates * 8,
        "hits, waiting and shaded": held.hits * (HIT_BYTES + 2 * HIT_BYTES + 16),
        "two queues": 2 * held.queue * QUEUED_BYTES,
    }
    assert sum(parts.values()) <= memory == held.memory
    assert held.rays <= 1 << RAY_BITS
    assert held.candidates >= held.rays
    left = memory - parts["fixed"] - parts["frame"]
    assert not held.resident or treelets <= RESIDENT_PART * left


def test_the_fixed_part_has_the_tree_above_and_the_largest_treelet_of_each_thread(stores):
    for store in stores:
        one, three = (fixed_bytes(store, Settings.of(threads=k, refine="tree")) for k in (1, 3))
        assert three - one >= 2 * PieceReader.bytes(store)
        assert Forest.bytes(store) == TREELET_SHARE * sum(s.treelets for s in store.streams)
        sizes = [stream.expected_bytes() for stream in store.streams]
        parts = ("nodes", "geometry", "boxes", "offsets", "ids")
        assert Forest.resident_bytes(store) == sum(s.get(part, 0) for s in sizes for part in parts)
    large = PieceReader.bytes(stores[1])
    assert large >= 30_000 * 12


def test_a_treelet_fills_the_memory_of_its_reader(stores):
    """That the header tells is that of the largest treelet."""
    for store in stores:
        for stream in store.streams:
            table = np.fromfile(stream.path("treelets"), bfrt.records.TREELET)
            sizes = table["nodes"] * 80 + table["count"] * stream.stride
            if not stream.kind.counted:
                assert stream.treelet_bytes == sizes.max()


def test_nodes_that_are_kept_are_not_read_again(tmp_path):
    rng = np.random.default_rng(8)
    turn = np.linspace(0, 2 * np.pi, 7, endpoint=False)
    outline = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]) * 0.05
    with small_treelets(), bfrt.SceneWriter(tmp_path / "a", order="spatial") as writer:
        writer.spheres(rng.random((3000, 3)), 0.01)
        corners = rng.random((3000, 1, 3)) + outline
        writer.polygons(corners.reshape(-1, 3), np.full(3000, 7))
    rays = rng.uniform(-1, 2, (2000, 3)), rng.normal(size=(2000, 3))
    read, found = {}, {}
    for kept in (0, 10_000, 1 << 24):
        form = partial(replace, resident=False, kept=kept)
        with dividing(bfrt.open(tmp_path / "a"), form) as scene:
            for _ in range(6):  # once roots are known rays look farther at once
                found[kept] = scene.cast_rays(*rays, refine="tree")
                read[kept] = found[kept].stats.total.treelets_read
        for key, values in found[0].items():
            np.testing.assert_array_equal(values, found[kept][key])
    assert read[0] > read[10_000] > read[1 << 24] == 0


def test_more_memory_makes_them_stay(stores):
    view = (64, 64, 1, 2)
    least = least_of(stores[2], view)
    states = [divided(stores[2], view, least + k * 4 * MIB).resident for k in range(20)]
    assert states == sorted(states)
    assert set(states) == {False, True}


#: Prints the most that was held while the tree above was made, beyond what there was before.
GROWING = """
import sys
import bfrt
from bfrt.stats import peak_rss
from bfrt.tree.forest import Forest

def now():
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) << 10 for line in status if line.startswith("VmRSS"))

store = bfrt.open(sys.argv[1]).store
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")
before = now()
forest = Forest(store, 1e-6, sys.argv[2] == "resident")
print(peak_rss() - before, forest.treelets)
"""


@pytest.mark.parametrize("streams", [1, 2])
@pytest.mark.parametrize("form", ["resident", "streamed"])
def test_a_treelet_s_share_is_what_it_takes(tmp_path, streams, form):
    rng = np.random.default_rng(3)
    with small_treelets(1, 1), StoreWriter(tmp_path / "a", order="spatial") as writer:
        for part in range(streams):
            add = (writer.spheres, writer.triangles)[part]
            n = 240_000 // streams
            add(rng.random((n, 3, 3), np.float32)) if part else add(rng.random((n, 3)), 0.1)
    try:
        Path("/proc/self/clear_refs").open("w").close()
    except OSError:
        pytest.skip("peaks cannot be reset here")
    command = [sys.executable, "-c", GROWING, str(tmp_path / "a"), form]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    peak, treelets = map(int, done.stdout.split())
    assert treelets == 240_000 // streams * streams
    assert peak < TREELET_SHARE * treelets + 3 * MIB


#: Prints the process's peak, whether treelets stayed, and passes.
RENDERING = """
import sys
import bfrt

image = bfrt.render(sys.argv[1], memory=sys.argv[2], threads=2, refine="tree")
print(image.stats.peak_rss_bytes, image.stats.tree["resident"], image.stats.total.passes)
bfrt.open(sys.argv[1]).cast_rays("origins.npy", "ways.npy", memory=sys.argv[2], threads=2)
print(bfrt.stats.peak_rss())
"""

#: Makes a store of four million spheres.
WRITING = """
import sys
import numpy as np
import bfrt

rng = np.random.default_rng(1)
with bfrt.SceneWriter(sys.argv[1], order="spatial") as writer:
    writer.camera(bfrt.Camera((0, -3, 0.5), (0, 0, 0), resolution=(256, 256)))
    writer.light(bfrt.Light((4, -5, 6)))
    mirror = writer.material(bfrt.Material((1, 1, 1), 0.5, 0.4, 30.0))
    for _ in range(4):
        writer.spheres(rng.uniform(-1, 1, (1_000_000, 3)).astype(np.float32), 0.005, mirror)
np.save("origins.npy", rng.uniform(-2, 2, (500_000, 3)))
np.save("ways.npy", rng.normal(size=(500_000, 3)))
"""


@pytest.mark.slow
def test_renders_of_four_million_spheres_stay_in_their_budgets(tmp_path):
    def run(code, *given):
        command = [sys.executable, "-c", code, *given]
        done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    run(WRITING, "a")
    for memory, stays in (("128MiB", "False"), ("512MiB", "True")):
        peak, resident, passes, after = run(RENDERING, "a", memory)
        assert resident == stays
        assert (int(passes) > 5) != (stays == "True")
        assert max(int(peak), int(after)) < parse_memory(memory)
