"""Commands that are killed at random moments and started again: what tests of it share."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

#: Files that tell how long work took.
TIMED = ("made.json",)

#: A complete state in a checkpoint's folder.
STATE = re.compile(r"state\.[0-9]+")


def run(command: Sequence[str], folder: Path, seconds: float | None = None) -> tuple[int, str]:
    """Run a command in a folder of its own; kill it after some seconds.

    Returns
    -------
    status : int
    said : str
        What it wrote to standard error.
    """
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        if seconds is not None:
            time.sleep(seconds)
            process.send_signal(signal.SIGKILL)
        _, said = process.communicate()
    assert process.returncode in (0, -signal.SIGKILL), said
    return process.returncode, said


def contents(path: Path) -> dict[str, bytes]:
    """Return all files of a folder, or one file, by their names."""
    files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
    return {
        str(file.relative_to(path.parent)): file.read_bytes()
        for file in files
        if file.name not in TIMED
    }


class Kills(NamedTuple):
    """Counts kills, and of the runs after them those that found a state and went on from it."""

    killed: int
    went_on: int

    def __str__(self) -> str:
        return f"{self.killed} kills, each followed by the same bytes; {self.went_on} runs went on"


def kills(
    work: Callable[[Path], tuple[Sequence[str], Path]],
    folder: Path,
    count: int,
    rng: np.random.Generator,
    anew: Callable[[Path], object] | None = None,
) -> Kills:
    """Do work, killed so many times, at moments spread over the time that is left of it.

    After each kill it is done to its end, and then from there again as the kill had left it, so
    that a run may be killed several times on its way.

    Parameters
    ----------
    work : callable
        Returns, for a folder, the command, whose checkpoint is ``kept`` there, and what it makes.
    anew : callable, optional
        Has a folder be as before the work, whenever it is finished.
    """
    folder.mkdir()
    (folder / "plain").mkdir()
    command, made = work(folder / "plain")
    start = time.perf_counter()
    assert run(command, folder)[0] == 0
    whole = time.perf_counter() - start
    expected, there = contents(made), names(folder / "plain")
    place, aside = folder / "killed", folder / "aside"
    place.mkdir()
    killed = went_on = 0
    command, made = work(place)
    while killed < count:
        status, _ = run(command, place, rng.uniform(0.2, 1.0) * whole)
        if status:
            killed += 1
            shutil.copytree(place, aside, symlinks=True)
            saved = [name for name in names(place / "kept") if STATE.fullmatch(name)]
            status, said = run(command, place)
            assert ("goes on where it was left" in said) >= bool(saved)
            went_on += "goes on where it was left" in said
            check_done(place, there, made, expected)
            shutil.rmtree(place)
            aside.rename(place)
        else:
            check_done(place, there, made, expected)
            if anew is not None:
                anew(place)
    return Kills(killed, went_on)


def check_done(place: Path, there: set[str], made: Path, expected: dict[str, bytes]) -> None:
    """Hold what work has made to what it makes unkilled, where `there` is all that there is."""
    assert contents(made) == expected
    assert names(place) == there
    assert litter(place) == []


def names(folder: Path) -> set[str]:
    """Return the names in a folder, which need not be there."""
    return {path.name for path in folder.iterdir()} if folder.exists() else set()


def litter(folder: Path) -> list[str]:
    """Return the names of all temporary things in a folder, and below."""
    return [path.name for path in folder.rglob("*") if ".bfrt-" in path.name]
