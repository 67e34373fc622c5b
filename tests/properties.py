"""How many examples a property is tried with."""

from __future__ import annotations

from hypothesis import settings

#: Of a property that says nothing of its own, by the two profiles of ``conftest.py``.
SHORT, LONG = 20, 100


def examples(most: int) -> settings:
    """Return settings of `most` examples in the long profile, and of its share of them else."""
    share = most * settings().max_examples // LONG
    return settings(max_examples=max(min(most, SHORT), share))
