"""``python -m bfrt`` is the command ``bfrt``, and so is the script of that name."""

import os
import sys

import bfrt

bfrt._take_interrupts()  # from here on an interrupt is one line

from bfrt.process import Interrupts, ending_of, flush_streams, open_missing_streams, say  # noqa: E402

#: The exit status where the command does not begin.
UNLOADED = 1


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
        interrupts.listen(bfrt._interrupted)
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
