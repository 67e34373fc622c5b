"""``python -m bfrt`` is the command ``bfrt``, and so is the script of that name."""

from __future__ import annotations

import os
import sys

#: The exit status where the command does not begin.
UNLOADED = 1

try:
    from bfrt.process import (
        Interrupts,
        ending_of,
        flush_streams,
        open_missing_streams,
        say,
    )
except KeyboardInterrupt:  # before there is what takes it
    sys.stderr.write("bfrt: interrupted\n")
    sys.exit(130)


def spare_threads() -> None:
    """Have NumPy's linear algebra, which nothing here asks for, start no threads of its own.

    Where the system refuses them it interrupts the process.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def unloaded(error: BaseException) -> int:
    """Say that the command could not be loaded; return the exit status."""
    said = " ".join(str(error).split()) or "no memory"
    say(f"bfrt: the command could not be loaded: {said:.200}")
    return UNLOADED


def run() -> int:
    """Be the command, from its imports to its exit; return the exit status of the process."""
    interrupts = Interrupts()
    try:
        interrupts.listen()
        open_missing_streams()
        spare_threads()
        try:
            from bfrt.cli import main  # here, where an interrupt is already heard
        except (ImportError, MemoryError, OSError) as error:
            interrupts.end()
            return unloaded(error)
        interrupts.begun = True
        try:
            status = main()
        except SystemExit as asked:  # of the parser
            status = int(asked.code or 0)
        interrupts.end()
    except KeyboardInterrupt as error:
        interrupts.end()
        said, status = ending_of(error)
        say(f"bfrt: {said}")
    flush_streams()
    return status


if __name__ == "__main__":
    sys.exit(run())
