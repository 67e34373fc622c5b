"""The JSON of a report: one version, one machine, and the cases that have ended so far.

::

    {"format": 1, "version": ..., "revision": ..., "machine": {...}, "programs": {...},
     "probes": [{"time": ..., "disk_write": ..., "disk_read": ..., "loop": ..., "loops": ...}],
     "cases": {NAME: {"kind": ..., "time": ..., "seconds": ..., "rows": [{...}]}}}

A case's facts are those of the last probe before its time.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from saved import save

from reporting.kinds import KINDS, Rows

FORMAT = 1


class Record:
    """A report's JSON in memory, and its file.

    Parameters
    ----------
    path : Path
    found : dict
        What the file has, or what a new one is to have.
    """

    def __init__(self, path: Path, found: dict[str, Any]) -> None:
        self.path = path
        self.found = found

    @classmethod
    def read(cls, path: Path) -> Record:
        """Read a report.

        Raises
        ------
        SystemExit
            If the file is of another format.
        """
        found = json.loads(path.read_text())
        if not isinstance(found, dict) or found.get("format") != FORMAT:
            raise SystemExit(
                f"{path}: is no report of format {FORMAT}, expected what report.py wrote"
            )
        return cls(path, found)

    @classmethod
    def begun(cls, path: Path, facts: dict[str, Any]) -> Record:
        """Read a report that goes on, or begin one.

        Raises
        ------
        SystemExit
            If what is there is of another version or machine.
        """
        if not path.exists():
            return cls(path, {"format": FORMAT, **facts, "probes": [], "cases": {}})
        record = cls.read(path)
        for name in ("version", "revision", "machine"):
            if record.found[name] != facts[name]:
                raise SystemExit(
                    f"{path}: is of {name} {record.found[name]}, expected {facts[name]}: a "
                    f"report is of one version on one machine; give another --json"
                )
        record.found["programs"] |= facts["programs"]
        return record

    @property
    def cases(self) -> dict[str, dict[str, Any]]:
        found: dict[str, dict[str, Any]] = self.found["cases"]
        return found

    def add(self, name: str, case: dict[str, Any]) -> None:
        """Save a case that has ended."""
        self.cases[name] = case
        save(self.path, self.found)

    def add_probe(self, probe: dict[str, Any]) -> None:
        self.found["probes"].append(probe)
        save(self.path, self.found)

    def rows(self, kind: str) -> Rows:
        """All rows of a kind, in the order in which they were measured."""
        return [row for case in self.cases.values() if case["kind"] == kind for row in case["rows"]]

    def kinds(self) -> list[str]:
        """The kinds that it has rows of."""
        return [kind for kind in KINDS if self.rows(kind)]

    @property
    def dates(self) -> str:
        """The day of the cases, or the first and the last."""
        days = sorted({case["time"][:10] for case in self.cases.values()})
        return days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}" if days else "no day"
