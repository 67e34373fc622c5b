"""Compare two runs of the suite, or the reports of many versions.

::

    pytest bench --benchmark-json old.json      # and later, or elsewhere
    pytest bench --benchmark-json new.json
    python bench/compare.py old.json new.json
    python bench/compare.py --history bench/history/*.json --plot history.png

Of two runs the exit status is 1 where the second is slower beyond the noise. Slower beyond the
noise is a case whose fastest round takes longer than the slowest round of the first run, and whose
median is longer by more than --tolerance. An answer that differs is always a failure, and so is a
case that is gone. Of reports (bench/report.py) it tells how each number went that more than one
has, and draws it; there the noise is that of days and machines.
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


def compared(old: dict[str, Any], new: dict[str, Any], tolerance: float) -> int:
    """Print two runs side by side; return how many cases are wrong."""
    wrong = 0
    for name, case in old.items():
        if name not in new:
            print(f"{'gone':>33}  {name}")
            wrong += 1
            continue
        found = verdict(case, new[name], tolerance)
        wrong += bool(found)
        before, after = case["stats"]["median"], new[name]["stats"]["median"]
        print(f"{before:10.4g} s {after:10.4g} s {after / before:6.2f}  {name}  {found}")
    return wrong


def history(paths: list[Path], plot: Path | None) -> int:
    """Print how numbers went, and draw it; return 1 where no two reports have one in common."""
    from reporting.history import courses, draw, told
    from reporting.record import Record

    found = courses([Record.read(path) for path in paths])
    if not found:
        print("no number is in more than one of these reports")
        return 1
    print(*told(found), sep="\n")
    if plot:
        draw(found, plot)
    return 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "runs", type=Path, nargs="*", metavar="RUN", help="an old one and a new one"
    )
    parser.add_argument("--tolerance", type=float, default=0.1, help="of a median (0.1)")
    parser.add_argument("--history", type=Path, nargs="+", metavar="REPORT")
    parser.add_argument("--plot", type=Path, help="where the history is drawn")
    arguments = parser.parse_args()
    if arguments.history:
        return history(arguments.history, arguments.plot)
    if len(arguments.runs) != 2:
        parser.error("expected two runs, or --history")
    old, new = map(cases, arguments.runs)
    return 1 if compared(old, new, arguments.tolerance) else 0


if __name__ == "__main__":
    sys.exit(main())
