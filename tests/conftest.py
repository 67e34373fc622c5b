"""What all tests share: how hypothesis runs them, and in which order they run."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings
from properties import LONG, SHORT

# How long an example takes says more about the machine's other work than about ours.
# Examples of each run; `--hypothesis-profile=long` has as many as hypothesis itself.
settings.register_profile("bfrt", deadline=None, max_examples=SHORT)
settings.register_profile("long", deadline=None, max_examples=LONG)
settings.load_profile("bfrt")

TESTS = Path(__file__).parent

#: Files of few tests that take long each.
FIRST = {
    (TESTS / name).resolve(strict=True)
    for name in (
        "checkpoint/test_convert_kills.py",
        "checkpoint/test_kills.py",
        "faults/test_faults.py",
        "formats/hdf5/test_endless.py",
        "formats/raster/test_memory.py",
        "formats/test_large_faces.py",
        "shards/test_workers_convert.py",
        "spd/test_budget.py",
        "store/test_ordering_memory.py",
        "store/test_several.py",
        "test_capped.py",
        "test_limits.py",
    )
}


@pytest.hookimpl(trylast=True)  # after those that are not to run have left
def pytest_collection_modifyitems(items):
    """Put the longest files first: all workers then end at about the same time."""
    tests = Counter(item.path for item in items)
    items.sort(key=lambda item: (item.path not in FIRST, -tests[item.path]))


@pytest.fixture(autouse=True)
def _levels_of_logging():
    """A command that ran in this process leaves its levels to no other test."""
    yield
    for name, logger in list(logging.root.manager.loggerDict.items()):
        if name.startswith("bfrt.") and isinstance(logger, logging.Logger):
            logger.setLevel(logging.NOTSET)
