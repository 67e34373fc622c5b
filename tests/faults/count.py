"""Count what came of calls that fail, for docs/reliability.rst.

::

    python tests/faults/count.py          # every call: an hour
    python tests/faults/count.py 8        # eight of each work and fault
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from faults.run import told_of
from faults.shim import FAMILIES

OUTCOMES = ("refused", "succeeded", "wrong")


def main(sample: str = "0") -> None:
    with tempfile.TemporaryDirectory() as folder:
        told = told_of(Path(folder), int(sample))
    found: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for each in told:
        for fault, outcomes in each["counts"].items():
            found[fault.split()[0]].update(outcomes)
        for line in each["wrong"]:
            print(line, file=sys.stderr)
    print("call,", ", ".join(("faults", *OUTCOMES)))
    for family in FAMILIES:
        numbers = [found[family][outcome] for outcome in OUTCOMES]
        print(f"{family},", ", ".join(map(str, (sum(numbers), *numbers))))


if __name__ == "__main__":
    main(*sys.argv[1:])
