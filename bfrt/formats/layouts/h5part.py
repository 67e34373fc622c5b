"""H5Part: a group ``Step#N`` for each step, with datasets x, y, z and others of as many rows."""

from __future__ import annotations

import re

from bfrt.formats.layouts.steps import Layout, numbered
from bfrt.formats.table import Arrays

STEP = re.compile(r"(Step#(\d{1,18}))/")


def h5part_in(arrays: Arrays) -> Layout | None:
    """Return the layout of an H5Part file, or None."""
    found = {int(match[2]): match[1] for key in arrays if (match := STEP.match(key))}
    return Layout("H5Part", numbered(found), arrays) if found else None
