"""``python -m bfrt`` is the command ``bfrt``, and so is the script of that name."""

# From the first line on an interrupt is one line. All these are there when Python has begun.
import _signal  # type: ignore[import-not-found]  # what `signal` is made of
import os
import sys


def interrupted(number: int, _: object) -> None:
    """End at once, as long as nothing has begun that could be cleared up."""
    try:
        os.write(2, b"bfrt: interrupted\n")
    finally:
        os._exit(128 + number)


if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
    _signal.signal(_signal.SIGINT, interrupted)

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
        interrupts.listen(interrupted)
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
