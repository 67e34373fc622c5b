"""A process that runs trials in its children, so that each has all modules at once.

::

    LD_PRELOAD=shim.so python server.py SHIM FOLDER SAMPLE [WORK ...]

For each work and fault the n-th call fails for n = 1, 2, ..., or for SAMPLE of these where it is
not 0. It prints a line of JSON for each work.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from faults.shim import FAULTS, Fault, Shim
from faults.trial import Expected, Trials
from faults.works import BEYOND, WORKS

#: Calls that may come beyond those that were counted: threads take turns as they like.
SLACK = 3


def numbers(count: int, sample: int, shift: int) -> Iterator[int]:
    """Which calls fail: all, and beyond; or some, spread evenly, each work's its own."""
    if not sample:
        yield from range(1, count + SLACK + 1)
    elif count:
        step = max(1, -(-count // sample))
        yield from range(1 + shift % step, count + 1, step)


def load(modules: list[str]) -> None:
    """Import what a work imports on its way."""
    for name in modules:
        if name not in sys.modules:
            with contextlib.suppress(ImportError):
                importlib.import_module(name)


def sweep(trials: Trials, name: str, fault: Fault, expected: Expected, sample: int):
    """Try a fault at all its places; return counts of outcomes, and what went wrong."""
    outcomes: Counter[str] = Counter()
    wrong = []
    shift = sum(map(ord, name + str(fault)))
    for n in numbers(expected.counts[fault.family], sample, shift):
        outcome = trials.run(name, fault, n, expected)
        if not outcome.was_hit(fault, n):
            break
        kind = "wrong" if outcome.wrong else "refused" if outcome.error else "succeeded"
        outcomes[kind] += 1
        if outcome.wrong:
            wrong.append(f"{name}: {fault} {n}: {outcome.wrong} [{outcome.error[:200]}]")
    return outcomes, wrong


def main(shim: str, folder: str, sample: str, *names: str) -> None:
    trials = Trials(Shim(Path(shim)), Path(folder))
    for name in names or WORKS:
        expected = trials.prepare(name)
        load(expected.modules)
        expected = trials.prepare(name)
        gc.collect()
        gc.freeze()  # each child collects what is its own: a fifth of the time
        counts, wrong = {}, []
        for fault in FAULTS:
            if str(fault) in BEYOND.get(name, ()):
                continue
            outcomes, found = sweep(trials, name, fault, expected, int(sample))
            counts[str(fault)] = dict(outcomes)
            wrong += found
        print(json.dumps({"work": name, "counts": counts, "wrong": wrong}), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
