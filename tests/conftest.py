"""What all tests share: how hypothesis runs them."""

from __future__ import annotations

from hypothesis import settings

# How long an example takes says more about the machine's other work than about ours.
# Examples of each run; `--hypothesis-profile=long` has as many as hypothesis itself.
settings.register_profile("bfrt", deadline=None, max_examples=40)
settings.register_profile("long", deadline=None)
settings.load_profile("bfrt")
