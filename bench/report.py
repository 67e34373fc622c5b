"""The page of numbers makes itself: runs what docs/performance.rst tells, and writes its tables.

::

    python bench/report.py --size quick --folder /data        run, save, and write the page
    python bench/report.py --size large --only peers tracing  some kinds of cases
    python bench/report.py --from bench/history/FILE.json     the page anew, without running
    python bench/report.py --size huge --list                 what would be run

All cases are of one version, on one machine; each is a process of its own, cold and in a memory
cgroup (root makes it). A case is saved when it ends, so that the same command goes on where another
has ended. A larger size has all cases of a smaller one. Peers that this Python does not have are
looked for in those that ``--python`` names; those that nobody has are left out. quick takes less
than ten minutes, large about an hour; huge needs 41 GB of disk.
"""

from __future__ import annotations

import argparse
import datetime
import sys
import tempfile
from pathlib import Path

from reporting.cases import SIZES, cases_of
from reporting.kinds import KINDS
from reporting.machine import ROOT, machine, programs, version
from reporting.page import write_page
from reporting.record import Record
from reporting.running import run_all

HISTORY = ROOT / "bench" / "history"


def begun(path: Path | None, others: list[str]) -> Record:
    """The report of this version: the one of a path, or of the version's name in the history."""
    facts = {**version(), "machine": machine(), "programs": programs(others)}
    if path is None:
        revision = facts["revision"] or str(datetime.datetime.now(datetime.timezone.utc).date())
        path = HISTORY / f"{facts['version']}-{revision.replace('+', '-changed')}.json"
    return Record.begun(path, facts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", choices=SIZES, default="quick")
    parser.add_argument("--only", nargs="*", default=[], choices=KINDS, help="kinds of cases")
    parser.add_argument("--folder", type=Path, help="where files and stores are made")
    parser.add_argument("--python", nargs="*", default=[], help="others, that have the peers")
    parser.add_argument("--json", type=Path, help="what is written, and gone on with")
    parser.add_argument("--from", type=Path, dest="source", help="make the page of this JSON")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "performance")
    parser.add_argument("--list", action="store_true", help="name the cases, and run none")
    given = parser.parse_args()
    if given.source:
        write_page(Record.read(given.source), given.page)
        return 0
    cases = cases_of(given.size, given.only)
    if given.list:
        print(*(f"{case.size:6} {case.name}" for case in cases), sep="\n")
        return 0
    record = begun(given.json, given.python)
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        wrong = run_all(record, cases, given.python, Path(folder))
    write_page(record, given.page)
    print(f"{record.path}; the page's parts are in {given.page}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
