"""Commands that are killed at random moments and started again: what tests of it share."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

#: Files that tell how long work took.
TIMED = ("made.json",)


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


def kills(
    work: Callable[[Path], tuple[Sequence[str], Path]],
    folder: Path,
    count: int,
    rng: np.random.Generator,
    anew: Callable[[Path], object] | None = None,
) -> int:
    """Do work, killed so many times, at moments spread over the time that is left of it.

    Parameters
    ----------
    work : callable
        Returns, for a folder, the command, whose checkpoint is ``kept`` there, and what it makes.
    anew : callable, optional
        Has a folder be as before the work, whenever it is finished.

    Returns
    -------
    int
        How many runs went on where one before was left.
    """
    folder.mkdir()
    (folder / "plain").mkdir()
    command, made = work(folder / "plain")
    start = time.perf_counter()
    assert run(command, folder)[0] == 0
    whole = time.perf_counter() - start
    expected = contents(made)
    killed = went_on = 0
    command, made = work(folder)
    while True:
        last = killed >= count
        status, said = run(command, folder, None if last else rng.uniform(0.2, 1.0) * whole)
        killed += status != 0
        went_on += "goes on where it was left" in said
        if status == 0:
            assert contents(made) == expected
            assert not (folder / "kept").exists()
            if last:
                break
            if anew is not None:
                anew(folder)
    left = [path.name for path in folder.rglob("*") if ".bfrt-" in path.name]
    assert left == []
    return went_on
