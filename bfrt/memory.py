"""Amounts of memory: how people write them, and how much the machine has."""

from __future__ import annotations

import os
import re
import sys
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np

from bfrt.errors import SettingError
from bfrt.refusals import calling

UNITS = {"": 1, "B": 1}
for _power, _letter in enumerate("KMGT", 1):
    UNITS[_letter + "B"] = UNITS[_letter.lower() + "B"] = 1000**_power
    UNITS[_letter + "iB"] = 1024**_power

#: Interpreter, NumPy, OpenEXR, our code and stacks (measured: 44 MiB), and the allocator's slack.
BASELINE = 52 << 20

#: The most bytes that this machine's addresses tell apart: 8 EiB less one where they have 64 bits.
MOST = sys.maxsize

#: Where Linux says which cgroups this process is in, and what their limits are.
OWN_CGROUPS = Path("/proc/self/cgroup")
CGROUPS = Path("/sys/fs/cgroup")


def parse_memory(text: str | int) -> int:
    """Return the bytes of ``"256MiB"``, ``"1.5 GB"`` or a number; MiB is 2^20, MB 10^6.

    Raises
    ------
    SettingError
        If it is not an amount of memory, or is more than any machine of this kind has.
    """
    amount = _bytes_of(text)
    if amount > MOST:
        raise SettingError(
            f"memory: found 2^{amount.bit_length() - 1} bytes or more, expected fewer than "
            f"2^{MOST.bit_length()}, as many as have addresses"
        )
    return amount


def _bytes_of(text: str | int) -> int:
    if isinstance(text, (int, np.integer)) and not isinstance(text, bool):
        return int(text)
    match = isinstance(text, str) and re.fullmatch(
        r"\s*([0-9]{1,999}(?:\.[0-9]{1,999})?)\s*([A-Za-z]*)\s*", text
    )
    if not match or match[2] not in UNITS:
        raise SettingError(
            f"memory: found {text!r:.80}, expected an amount such as 256MiB or 1.5GB"
        )
    return int(Fraction(match[1]) * UNITS[match[2]])


def format_memory(amount: int) -> str:
    """Return an amount as people write it, rounded up to MiB."""
    return f"{-(-amount // (1 << 20))}MiB"


@cache
def machine_memory() -> int:
    """Return the machine's memory, or its cgroup's limit if that is less, bytes.

    Both are asked for once: reading a cgroup's files takes as long as tracing a ray does.
    """
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return min([machine, *cgroup_limits()])


def default_memory() -> int:
    """Return a quarter of what there is, bytes."""
    return machine_memory() // 4


def cgroup_limits() -> list[int]:
    """Return the memory limits of this process's cgroup and of those above it; empty if none."""
    groups = (text_of(OWN_CGROUPS) or "").splitlines()
    limits = []
    for group in groups:
        _, controllers, name = group.split(":", 2)
        if controllers == "":  # version 2
            root, file = CGROUPS, "memory.max"
        elif "memory" in controllers.split(","):
            root, file = CGROUPS / "memory", "memory.limit_in_bytes"
        else:
            continue
        folder = Path(name.lstrip("/"))
        for path in (root / part / file for part in (folder, *folder.parents)):
            if (text := (text_of(path) or "").strip()).isdigit():
                limits.append(int(text))
    return limits


def text_of(path: Path) -> str | None:
    """Return what the system says in a file, or None where there is none.

    Raises
    ------
    StreamError
        As it refuses to say it.
    """
    with calling(path, "reading"):
        try:
            return path.read_text()
        except (FileNotFoundError, NotADirectoryError):
            return None
