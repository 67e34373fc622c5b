"""The command, killed at random moments and started again: the same files, and nothing is left."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from checkpoints import mostly_slow, scene_of
from kills import kills, run

import bfrt

#: Has a query write its answer to a folder, as a caller's script would.
QUERY = """
import logging, sys, bfrt
logging.basicConfig(level=logging.INFO)
store, rays, out, kept, refine = sys.argv[1:]
bfrt.cast_rays(store, rays + "/o.npy", rays + "/d.npy", out=out, checkpoint=kept, every=0,
               refine=refine, memory="72MiB", threads=1)
"""


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stores")
    scene_of(folder / "given.bfrt", groups=2, count=600)
    scene_of(folder / "ordered.bfrt", groups=1, order="spatial", count=600)
    rng = np.random.default_rng(3)
    np.save(folder / "o.npy", rng.uniform(-4, 4, (60_000, 3)))
    np.save(folder / "d.npy", rng.normal(size=(60_000, 3)))
    return folder


def work_of(stores, what, folder):
    """The command that does a piece of work, and the path that it makes."""
    kind, refine = what.split()
    store = str(stores / ("ordered.bfrt" if refine == "tree" else "given.bfrt"))
    kept = str(folder / "kept")
    if kind == "query":
        out = folder / "out"
        return [sys.executable, "-c", QUERY, store, str(stores), str(out), kept, refine], out
    out = folder / "a.npy"
    return [
        sys.executable, "-m", "bfrt", "render", store, "-o", str(out), "--resolution", "100x100",
        "--memory", "72MiB", "--threads", "1", "--refine", refine, "--checkpoint", kept,
        "--every", "0", "--from", "0.3", "-7", "1.5", "--at", "0", "0", "0",
    ], out  # fmt: skip


WORK = ("render sgb", "render tree", "query sgb")


@pytest.mark.parametrize("what", mostly_slow(WORK, ["render tree", "query sgb"]))
def test_three_kills(stores, tmp_path, what):
    kills(partial(work_of, stores, what), tmp_path / "work", 3, np.random.default_rng(len(what)))


@pytest.mark.slow
@pytest.mark.parametrize("what", ["render base", "render sg", *WORK, "query base", "query tree"])
def test_a_hundred_kills(stores, tmp_path, what):
    found = kills(
        partial(work_of, stores, what), tmp_path / "work", 100, np.random.default_rng(len(what))
    )
    print(f"{what}: {found}")
    assert found.went_on > 10


def test_the_command_says_that_it_goes_on(stores, tmp_path):
    command, made = work_of(stores, "render tree", tmp_path)
    view = bfrt.Camera((0.3, -7.0, 1.5), (0.0, 0.0, 0.0), resolution=(100, 100))
    calls = []

    def report(_):
        calls.append(1)
        return len(calls) < 4

    with pytest.raises(bfrt.Cancelled):
        bfrt.render(
            stores / "ordered.bfrt", camera=view, memory="72MiB", threads=1, refine="tree",
            checkpoint=tmp_path / "kept", progress=report,
        )  # fmt: skip
    status, said = run([*command], tmp_path)
    assert status == 0
    assert f"bfrt: {tmp_path}{os.sep}kept: goes on where it was left: band 1 of " in said
    assert made.exists() and not (tmp_path / "kept").exists()


def test_a_checkpoint_is_no_output(stores, tmp_path):
    command = [sys.executable, "-m", "bfrt", "render", str(stores / "given.bfrt")]
    done = subprocess.run(
        [*command, "-o", "a.npy", "--checkpoint", "a.npy"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("bfrt: a.npy: found it twice")
    assert list(tmp_path.iterdir()) == []


def test_every_without_a_checkpoint_is_refused(stores, tmp_path):
    command = [sys.executable, "-m", "bfrt", "render", str(stores / "given.bfrt")]
    done = subprocess.run(
        [*command, "-o", "a.npy", "--every", "5"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr == "bfrt: --every: found 5 without --checkpoint, which it is of\n"
