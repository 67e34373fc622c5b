"""``python -m bfrt`` is the command ``bfrt``, and so is the script of that name."""

from __future__ import annotations

import sys

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


def run() -> int:
    """Be the command, from its imports to its exit; return the exit status of the process."""
    interrupts = Interrupts()
    try:
        interrupts.listen()
        open_missing_streams()
        from bfrt.cli import main  # here, where an interrupt is already heard

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
