"""One input: success, or one error of ours; soon, in little memory, and nothing left."""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import os
import resource
import shutil
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from fuzz.mutator import FilesMutator, Mutator
from meshes import open_files

from bfrt.errors import BfrtError, ResourceError

#: Seconds after which an input is one that hangs: the process ends, and tells where it was.
PATIENCE = 60

#: Bytes by which the process may grow while it tries inputs.
MOST_GROWTH = 1 << 30

#: Inputs after which the C library has to give back what it keeps of memory that was freed: after
#: some 10,000 of one reader that was half a gigabyte.
GIVEN_BACK = 500

#: A file that holds the input that is tried, while it is.
CURRENT = "current"

PARTS = ("in", "out", "tmp")

Run = Callable[[bytes, Path], None]


class Harness(NamedTuple):
    """What is fuzzed: inputs that are right, what makes others, and what is done with an input.

    `run` gets an input, and a folder with `PARTS`: what is read comes into ``in``, what is made
    into ``out``.
    """

    seeds: list[bytes]
    mutator: Mutator
    run: Run


def of_bytes(seeds: list[bytes], tokens: tuple[bytes, ...], run: Run) -> Harness:
    """A harness whose inputs are one file."""
    return Harness(seeds, Mutator(seeds, tokens), run)


def of_files(
    seeds: list[bytes], tokens: tuple[bytes, ...], run: Run, names: Sequence[str], head: int = 0
) -> Harness:
    """A harness whose inputs are several files, behind some bytes."""
    return Harness(seeds, FilesMutator(seeds, tokens, names, head), run)


class Finding(Exception):
    """Tells what is wrong with what came of an input."""


class Trials:
    """Tries inputs, and counts what comes of them.

    Parameters
    ----------
    harness : Harness
    folder : Path
        A folder of its own.

    Attributes
    ----------
    folder : Path
    outcomes : Counter
        How often inputs ended in success, or in each of our errors.
    slowest : float
        Seconds.
    """

    def __init__(self, harness: Harness, folder: Path) -> None:
        self._run = harness.run
        self.folder = folder
        self._most = peak() + MOST_GROWTH
        self._open = open_files()
        self.outcomes: Counter[str] = Counter()
        self.slowest = 0.0

    def try_one(self, data: bytes) -> None:
        """Do what the harness does with an input.

        Raises
        ------
        Finding
            If something is wrong with what comes of it; other exceptions are findings, too.
        """
        (self.folder / CURRENT).write_bytes(data)
        work = self.folder / f"{zlib.crc32(data):08x}"
        work.mkdir()
        for part in PARTS:
            os.mkdir(f"{work}/{part}")  # noqa: PTH102
        start = time.perf_counter()
        try:
            with bounded():
                outcome = self._outcome(data, work)
        finally:
            shutil.rmtree(work)
        self.slowest = max(self.slowest, time.perf_counter() - start)
        self.outcomes[outcome] += 1
        if sum(self.outcomes.values()) % GIVEN_BACK == 0:
            give_back()
        if peak() > self._most:
            raise Finding(f"the process grew to {peak() >> 20} MiB")
        (self.folder / CURRENT).unlink()

    def _outcome(self, data: bytes, work: Path) -> str:
        before = self._open
        outcome = "success"
        try:
            self._run(data, work)
        except BfrtError as error:
            outcome = type(error).__name__
            check_sentence(error)
        check_nothing_left(work, done=outcome == "success")
        found = open_files()
        if found != before:
            gc.collect()  # an error's frames may refer to one another
            found = open_files()
        if found != before:
            self._open = found
            raise Finding(f"found open files {found}, expected {before}")
        return outcome


@contextmanager
def bounded() -> Iterator[None]:
    """End the process where a block takes too long, also where it does not come back to Python."""
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


def check_sentence(error: BfrtError) -> None:
    """Refuse an error that is no sentence, or that tells of memory that nothing needs."""
    text = str(error)
    if not text or not text.isprintable() or len(text) > 2000:
        raise Finding(f"found {text!r:.200}, expected a sentence") from error
    if isinstance(error, ResourceError):
        raise Finding(f"asked for too much: {text}") from error


def check_nothing_left(work: Path, *, done: bool) -> None:
    """Refuse temporary files, and what is made of an input that was refused."""
    emptied = ("tmp",) if done else ("tmp", "out")
    left = [f"{part}/{name}" for part in emptied for name in os.listdir(work / part)]  # noqa: PTH208
    for folder, parts, names in os.walk(work / "in"):
        begun = [name for name in (*parts, *names) if name.startswith(".")]
        left += [os.path.relpath(f"{folder}/{name}", work) for name in begun]
    if left:
        raise Finding(f"left: {left}")


def give_back() -> None:
    """Have the C library return memory that nobody has, where it can be told to."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def peak() -> int:
    """The most bytes that the process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
