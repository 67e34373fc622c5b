"""Removing what nobody needs any more: once more where the system refuses at first."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

#: A disk across a network may refuse once what it does a moment later.
TRIES = 3


def insist(call: Callable[[], object]) -> OSError | None:
    """Call something until the system does not refuse it, a few times; return the last refusal.

    What is not there is none.
    """
    refusal: OSError | None = None
    for _ in range(TRIES):
        try:
            call()
            return None
        except FileNotFoundError:
            return None
        except OSError as error:
            refusal = error.with_traceback(None)  # which would keep what callers hold
    return refusal


def remove_file(path: Path) -> None:
    """Remove a file, if it is there and the system lets us."""
    insist(path.unlink)


def remove_folder(path: Path) -> OSError | None:
    """Remove a folder with all that is in it; return the system's refusal where it is still there.

    The folder need not be there.
    """
    return insist(lambda: shutil.rmtree(path))
