"""What all tests share: how hypothesis runs them."""

from __future__ import annotations

from hypothesis import settings

# How long an example takes says more about the machine's other work than about ours.
settings.register_profile("bfrt", deadline=None)
settings.load_profile("bfrt")
