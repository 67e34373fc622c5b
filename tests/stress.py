"""Run what is too long for every day, one after another, and sum up what came of it.

::

    python tests/stress.py                  # all of it: many hours
    python tests/stress.py --quick          # the same, with few of each: half an hour
    python tests/stress.py kills fuzz       # some of it

The steps with the sanitizers work on a copy of the sources that is built in ``build/sanitize``;
what is built here stays as it is. Inputs at which something was found are kept in
``build/findings``. The exit status is 0 if all went well.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
SANITIZED = ROOT / "build" / "sanitize"

#: Where inputs are kept at which something was found.
FINDINGS = ROOT / "build" / "findings"

#: Tests of each part, and of what the sanitizers look at: the rooms that have loops in C.
KILLS = ("tests/test_killed.py", "tests/checkpoint")
CONCURRENCY = (
    "tests/store/test_several.py",
    "tests/store/test_replaced.py",
    "tests/test_threads.py",
)
ROOMS = tuple(
    f"tests/{room}"
    for room in ("checkpoint", "formats", "geometry", "grid", "image", "phases", "queries",
                 "reference", "scan", "spd", "store", "streams", "tree")
)  # fmt: skip

#: Inputs of each harness, and places of each fault; 0 is all.
MANY, FEW = 10_000, 100
EVERY, SOME = 0, 1

#: Libraries that are loaded before Python. AddressSanitizer looks for what throws C++'s exceptions
#: as it begins, and ends the process at the first one, as of GDAL, where it has found none.
LOADED_BEFORE = ("libasan.so", "libstdc++.so")


class Step(NamedTuple):
    """A command, what it tells in a few words, and whether it runs on the sanitizer build."""

    command: list[str]
    told: Callable[[str, Path], str]
    sanitized: bool = False


def tests_told(_: str, folder: Path) -> str:
    """What pytest counted."""
    counts: Counter[str] = Counter()
    for suite in ElementTree.parse(folder / "tests.xml").iter("testsuite"):
        counts.update({key: int(suite.get(key, 0)) for key in ("tests", "failures", "errors")})
    return f"{counts['tests']} tests, {counts['failures'] + counts['errors']} failed"


def faults_told(said: str, _: Path) -> str:
    """What was counted of calls that failed: see tests/faults/count.py."""
    rows = [line.split(", ")[1:] for line in said.splitlines()[1:]]
    faults, refused, succeeded, wrong = (
        sum(map(int, column)) for column in zip(*rows, strict=True)
    )
    return f"{faults} faults: {refused} refused, {succeeded} succeeded, {wrong} wrong"


def inputs_told(said: str, _: Path) -> str:
    """What was counted of inputs: see tests/fuzz/fuzz.py."""
    told = [json.loads(line) for line in said.splitlines()]
    each = ", ".join(f"{one['harness']} {one['inputs']}" for one in told)
    findings = sum(len(one["findings"]) for one in told)
    return f"{sum(one['inputs'] for one in told)} inputs ({each}), {findings} found"


def testing(*files: str, quick: bool, sanitized: bool = False) -> Step:
    chosen = [] if quick or sanitized else ["-m", "slow or not slow"]
    command = ["-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen, *files]
    return Step(command, tests_told, sanitized)


def steps(quick: bool, seed: int) -> dict[str, Step]:
    """All there is to do."""
    inputs = str(FEW if quick else MANY)
    fuzz = ["tests/fuzz/fuzz.py", "all", "--engine", "own", "--inputs", inputs,
            "--seed", str(seed), "--keep", str(FINDINGS)]  # fmt: skip
    return {
        "kills": testing(*KILLS, quick=quick),
        "faults": Step(["tests/faults/count.py", str(SOME if quick else EVERY)], faults_told),
        "concurrency": testing(*CONCURRENCY, quick=quick),
        "fuzz": Step(fuzz, inputs_told),
        "sanitized-fuzz": Step(fuzz, inputs_told, sanitized=True),
        "sanitized-tests": testing(*ROOMS, quick=quick, sanitized=True),
    }


def build_sanitized() -> None:
    """Build a copy of the sources with the sanitizers; what is there and is the same stays."""
    for part in ("bfrt", "tests", "bench", "docs"):
        ignored = shutil.ignore_patterns("*.so", "__pycache__", "_build")
        shutil.copytree(ROOT / part, SANITIZED / part, dirs_exist_ok=True, ignore=ignored)
    for name in ("setup.py", "pyproject.toml", "README.md"):
        shutil.copy2(ROOT / name, SANITIZED / name)
    subprocess.run(
        [sys.executable, "setup.py", "-q", "build_ext", "--inplace"],
        cwd=SANITIZED, env={**os.environ, "BFRT_BUILD": "sanitize"}, check=True,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip


def library(name: str) -> str:
    """The path of a library of the compiler's."""
    asked = ["gcc", f"-print-file-name={name}"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()


def environment(home: Path, *, sanitized: bool) -> dict[str, str]:
    """The environment in which a step has the modules of a folder."""
    made = {**os.environ, "PYTHONPATH": str(home)}
    if sanitized:
        made |= {
            "LD_PRELOAD": " ".join(map(library, LOADED_BEFORE)),
            "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1:quarantine_size_mb=16",
            "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1",
            "PYTHONMALLOC": "malloc",
        }
    return made


def done(name: str, step: Step) -> bool:
    """Do a step, and print what came of it; tell whether all went well."""
    begin = time.monotonic()
    home = SANITIZED if step.sanitized else ROOT
    with tempfile.TemporaryDirectory() as folder:
        files = [str(home / word) if word.startswith("tests/") else word for word in step.command]
        if step.told is tests_told:
            files += [f"--junitxml={folder}/tests.xml", f"--rootdir={home}",
                      f"--config-file={home / 'pyproject.toml'}"]  # fmt: skip
        ended = subprocess.run(
            [sys.executable, *files], cwd=folder, stdout=subprocess.PIPE, text=True, check=False,
            env=environment(home, sanitized=step.sanitized),
        )  # fmt: skip
        try:
            told = step.told(ended.stdout, Path(folder))
        except (OSError, ValueError) as error:
            told = f"told nothing: {error}"
    well = ended.returncode == 0
    if not well:
        print(ended.stdout, file=sys.stderr)
    seconds = time.monotonic() - begin
    print(f"{name:16} {'ok' if well else 'FAILED':8} {told}, {seconds:.0f} s", flush=True)
    return well


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="STEP", help=", ".join(steps(True, 0)))
    parser.add_argument("--quick", action="store_true", help="few of each")
    parser.add_argument("--seed", type=int, default=1, help="of inputs that are made up")
    asked = parser.parse_args()
    there = steps(asked.quick, asked.seed)
    if unknown := set(asked.names) - set(there):
        parser.error(f"found {', '.join(unknown)}, expected some of {', '.join(there)}")
    chosen = {name: there[name] for name in asked.names or there}
    if any(step.sanitized for step in chosen.values()):
        build_sanitized()
    well = [done(name, step) for name, step in chosen.items()]
    return 0 if all(well) else 1


if __name__ == "__main__":
    sys.exit(main())
