"""Compare two runs of the suite: exit status 1 where the second is slower beyond the noise.

::

    pytest bench --benchmark-json old.json      # and later, or elsewhere
    pytest bench --benchmark-json new.json
    python bench/compare.py old.json new.json

Slower beyond the noise is a case whose fastest round takes longer than the slowest round of the
first run, and whose median is longer by more than --tolerance. An answer that differs is always a
failure, and so is a case that is gone.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any


def cases(path: Path) -> dict[str, dict[str, Any]]:
    """A run's cases by their names."""
    return {case["fullname"]: case for case in json.loads(path.read_text())["benchmarks"]}


def verdict(old: dict[str, Any], new: dict[str, Any], tolerance: float) -> str:
    """What is wrong with a case, or nothing."""
    before, after = old["extra_info"].get("digest"), new["extra_info"].get("digest")
    if before != after:
        return f"another answer: {after}, not {before}"
    apart = new["stats"]["min"] > old["stats"]["max"]
    if apart and new["stats"]["median"] > old["stats"]["median"] * (1 + tolerance):
        return "slower"
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--tolerance", type=float, default=0.1, help="of a median (0.1)")
    arguments = parser.parse_args()
    old, new = cases(arguments.old), cases(arguments.new)
    wrong = 0
    for name, case in old.items():
        if name not in new:
            print(f"{'gone':>33}  {name}")
            wrong += 1
            continue
        found = verdict(case, new[name], arguments.tolerance)
        wrong += bool(found)
        before, after = case["stats"]["median"], new[name]["stats"]["median"]
        print(f"{before:10.4g} s {after:10.4g} s {after / before:6.2f}  {name}  {found}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
