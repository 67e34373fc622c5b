"""Runs the cases that a report does not have yet, one after the other, each as a process."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from reporting.cases import WITH_PEERS, Case
from reporting.flat import rows_of
from reporting.machine import HOUR, now, probe
from reporting.record import Record

BENCH = Path(__file__).resolve().parents[1]


def command_of(case: Case, others: Sequence[str], folder: Path, out: Path) -> list[str]:
    """The command of a case, with where it works and what it writes."""
    script, *words = case.words
    command = [sys.executable, str(BENCH / script), *words, "--folder", str(folder)]
    if case.kind in WITH_PEERS and others:
        command += ["--python", *others]
    if case.kind == "loaded" and others:
        command += ["--peer", others[0]]
    return [*command, "--json", str(out)]


def probed(record: Record, folder: Path) -> None:
    """Probe disk and processor, if the last probe is more than an hour old."""
    probes = record.found["probes"]
    if probes:
        old = datetime.fromisoformat(now()) - datetime.fromisoformat(probes[-1]["time"])
        if old.total_seconds() < HOUR:
            return
    record.add_probe(probe(folder))


def run(record: Record, case: Case, others: Sequence[str], folder: Path) -> str:
    """Run a case and save its rows; return what went wrong, or nothing."""
    probed(record, folder)
    began, start = now(), time.perf_counter()
    with tempfile.TemporaryDirectory(dir=folder) as name:
        out = Path(name) / "rows.json"
        command = command_of(case, others, Path(name), out)
        status = subprocess.run(command, check=False, cwd=name).returncode
        if status:
            return f"{case.name}: exit status {status}"
        rows = rows_of(case.kind, json.loads(out.read_text()))
    took = time.perf_counter() - start
    if case.kind == "cluster":
        rows = [{**scene_of(case), **row} for row in rows]
    if not rows:
        return f"{case.name}: measured nothing"
    record.add(case.name, {"kind": case.kind, "time": began, "seconds": took, "rows": rows})
    return ""


def scene_of(case: Case) -> dict[str, str | int]:
    """The scene of a case whose rows do not name it; the script's own without one."""
    words = case.words
    wanted = words[words.index("--scene") + 1] if "--scene" in words else "rings:94"
    name, size = wanted.split(":")
    return {"scene": name, "size": int(size)}


def run_all(
    record: Record, cases: Sequence[Case], others: Sequence[str], folder: Path
) -> list[str]:
    """Run those that are not there; one that fails does not keep the others from being run."""
    wrong = []
    missing = [case for case in cases if case.name not in record.cases]
    print(f"{len(cases)} cases, {len(cases) - len(missing)} of them in {record.path}", flush=True)
    for number, case in enumerate(missing, 1):
        print(f"[{number} of {len(missing)}] {case.name}", flush=True)
        if said := run(record, case, others, folder):
            print(said, flush=True)
            wrong.append(said)
    if missing:
        record.add_probe(probe(folder))
    return wrong
