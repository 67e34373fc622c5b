"""What all tests share: how hypothesis runs them."""

from __future__ import annotations

import logging

import pytest
from hypothesis import settings

# How long an example takes says more about the machine's other work than about ours.
# Examples of each run; `--hypothesis-profile=long` has as many as hypothesis itself.
settings.register_profile("bfrt", deadline=None, max_examples=20)
settings.register_profile("long", deadline=None)
settings.load_profile("bfrt")


@pytest.fixture(autouse=True)
def _levels_of_logging():
    """A command that ran in this process leaves its levels to no other test."""
    yield
    for name, logger in list(logging.root.manager.loggerDict.items()):
        if name.startswith("bfrt.") and isinstance(logger, logging.Logger):
            logger.setLevel(logging.NOTSET)
