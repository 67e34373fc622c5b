"""Conversions, orderings and preprocesses, killed at random moments and started again."""

from __future__ import annotations

import shutil
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from kills import kills

import bfrt

#: Of each piece of work, the rows of each file of points.
POINTS = {"convert": [60_000] * 6, "order": [300_000], "preprocess": [40_000]}

#: A grid of so many voxels an axis takes several subspaces with this memory.
GRID, MEMORY = "320", "72MiB"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    rng = np.random.default_rng(6)
    for what, rows in POINTS.items():
        for number, n in enumerate(rows):
            np.save(folder / f"{what}{number}.npy", rng.uniform(-1, 1, (n, 3)))
    bfrt.convert(folder / "preprocess0.npy", folder / "a.bfrt", radius=0.004, order="given")
    return folder


def work_of(files, what, folder):
    """The command that does a piece of work, and what it makes."""
    kept = ["--checkpoint", str(folder / "kept"), "--every", "0"]
    bfrt_of = [sys.executable, "-m", "bfrt"]
    if what == "preprocess":
        store = folder / "a.bfrt"
        if not store.exists():
            shutil.copytree(files / "a.bfrt", store)
        return [
            *bfrt_of, "render", str(store), "-o", str(folder / "a.npy"), "--resolution", "20x20",
            "--grid", GRID, "--memory", MEMORY, "--threads", "1", "--refine", "sgb", *kept,
            "--from", "0.3", "-7", "1.5", "--at", "0", "0", "0",
        ], store / "0" / "marks"  # fmt: skip
    names = [str(files / f"{what}{number}.npy") for number in range(len(POINTS[what]))]
    order = "spatial" if what == "order" else "given"
    target = folder / "x.bfrt"
    made = ["-o", str(target), "--radius", "0.004", "--order", order]
    return [*bfrt_of, "convert", *names, *made, *kept], target


def anew(folder):
    """Remove what work has made, if it has."""
    shutil.rmtree(folder / "x.bfrt", ignore_errors=True)
    (folder / "a.bfrt" / "0" / "marks").unlink(missing_ok=True)


def killed(files, what, folder, count):
    rng = np.random.default_rng(len(what))
    return kills(partial(work_of, files, what), folder / "work", count, rng, anew)


@pytest.mark.parametrize("what", POINTS)
def test_three_kills(files, tmp_path, what):
    killed(files, what, tmp_path, 3)


@pytest.mark.slow
@pytest.mark.parametrize("what", POINTS)
def test_a_hundred_kills(files, tmp_path, what):
    found = killed(files, what, tmp_path, 100)
    print(f"{what}: {found}")
    assert found.went_on > 10


def test_the_command_says_that_it_goes_on(files, tmp_path, monkeypatch):
    """After an error in a later file, too: those before it are kept."""
    bad = tmp_path / "bad.nff"
    bad.write_text("s 0 0 0 nan\n")
    names = [str(files / f"convert{number}.npy") for number in range(3)]
    command = [sys.executable, "-m", "bfrt", "convert", *names, str(bad), "-o", "x.bfrt"]
    command += ["--radius", "0.01", "--checkpoint", "kept", "--every", "0"]
    said = [
        subprocess.run(command, cwd=tmp_path, capture_output=True, text=True).stderr
        for _ in range(2)
    ]
    assert "nan" in said[0] and "goes on" not in said[0]
    assert "bfrt: kept: goes on where it was left: 3 of 4 sources are complete\n" in said[1]
    bad.write_text("s 0 0 0 1\n")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.nff", "x.bfrt"]


def test_every_without_a_checkpoint_is_refused(files, tmp_path):
    command = [sys.executable, "-m", "bfrt", "convert", str(files / "order0.npy"), "-o", "x.bfrt"]
    done = subprocess.run(
        [*command, "--radius", "1", "--every", "5"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr == "bfrt: --every: found 5 without --checkpoint, which it is of\n"
