"""Start the server and read what it prints."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from faults.shim import built

TESTS = Path(__file__).parent.parent


def told_of(folder: Path, sample: int, works: Iterable[str] = ()) -> list[dict]:
    """What came of works, a dict each: its name, outcomes by fault, and what went wrong."""
    library = built(folder)
    work = folder / "work"
    work.mkdir()
    paths = [*filter(None, [os.environ.get("PYTHONPATH")]), str(TESTS)]
    environment = {
        **os.environ,
        "LD_PRELOAD": str(library),
        "PYTHONPATH": os.pathsep.join(paths),
        "OPENBLAS_NUM_THREADS": "1",  # a process that forks has one thread
    }
    asked = [str(library), str(work), str(sample), *works]
    ended = subprocess.run(
        [sys.executable, Path(__file__).with_name("server.py"), *asked],
        env=environment, cwd=work, capture_output=True, text=True,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    return [json.loads(line) for line in ended.stdout.splitlines()]
