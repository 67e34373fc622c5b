"""Removing what is left of work that failed: once more where the system refuses at first."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

#: A disk across a network may refuse once what it does a moment later.
TRIES = 3


def remove_file(path: Path) -> None:
    """Remove a file, if it is there and the system lets us."""
    for _ in range(TRIES):
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
            return


def remove_folder(path: Path) -> OSError | None:
    """Remove a folder with all that is in it; return the system's refusal where it is still there.

    The folder need not be there.
    """
    refusal: OSError | None = None
    for _ in range(TRIES):
        try:
            shutil.rmtree(path)
            return None
        except FileNotFoundError:
            return None
        except OSError as error:
            refusal = error.with_traceback(None)  # which would keep what callers hold
    return refusal
