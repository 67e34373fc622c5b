"""The command line as a whole: its parser, the command that it asks for, and how that ends."""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import re
import sys
from collections.abc import Sequence
from typing import Any

import bfrt
from bfrt.cli.clean import add_clean
from bfrt.cli.convert import add_convert
from bfrt.cli.render import add_render
from bfrt.cli.spd import add_spd
from bfrt.cli.store import add_info, add_verify
from bfrt.cli.viewshed import add_viewshed
from bfrt.errors import BfrtError, BudgetError, SettingError, StreamError
from bfrt.process import ending_of, say, silence
from bfrt.refusals import EXPECTED

BAD_INPUT = 1
WRONG_USE = 2
PIPE_CLOSED = 141

#: What is a number and no option.
NEGATIVE = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    try:
        obey(sys.argv[1:] if arguments is None else arguments)
    except BrokenPipeError:  # who read what is printed has seen enough
        silence(sys.stdout)
        return PIPE_CLOSED
    except (BudgetError, SettingError) as error:
        return fail(error, WRONG_USE)
    except (BfrtError, OSError) as error:
        return fail(error, BAD_INPUT)
    except MemoryError as error:
        return fail(f"found no memory for {error or 'one more object'}, {EXPECTED}", BAD_INPUT)
    except KeyboardInterrupt as error:
        return fail(*ending_of(error))
    return 0


def obey(arguments: Sequence[str]) -> None:
    """Do what the arguments ask for, until it is printed."""
    try:
        options = parser().parse_args(resolutions_apart(arguments))
        logging.basicConfig(
            format="bfrt: %(message)s", level=logging.ERROR if options.quiet else logging.WARNING
        )
        options.run(options)
    except SystemExit:  # of the parser, which may have printed help
        flush()
        raise
    flush()


def flush() -> None:
    """Have what was printed written."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError as error:
        silence(sys.stdout)
        if isinstance(error, BrokenPipeError):
            raise
        raise StreamError("<stdout>", 0, error.errno or errno.EIO, "writing") from error


def resolutions_apart(arguments: Sequence[str]) -> list[str]:
    """Split a resolution given as one word, WxH, into the two arguments that the parser expects."""
    apart: list[str] = []
    for argument in arguments:
        option, _, value = argument.rpartition("=")
        asked = option or (apart[-1] if apart else "")
        size = re.fullmatch(r"(\d+)[xX×](\d+)", value)
        if size and len(asked) > 4 and "--resolution".startswith(asked):
            apart += [*filter(None, [option]), *size.groups()]
        else:
            apart.append(argument)
    return apart


def fail(error: object, status: int) -> int:
    """Print an error in one line."""
    say(f"bfrt: {error}")
    return status


class Parser(argparse.ArgumentParser):
    """Hears where help cannot be printed; where an error cannot, its status says it.

    Some versions of its base pass over both, and some over neither. Some take negative numbers with
    an exponent, as -1e3, for options.
    """

    def _parse_optional(self, arg_string: str) -> Any:
        return None if NEGATIVE.fullmatch(arg_string) else super()._parse_optional(arg_string)

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is not None and file is sys.stdout:
            file.write(message)
        else:
            with contextlib.suppress(OSError):
                super()._print_message(message, file)


def parser() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    top = Parser(
        prog="bfrt",
        description="Ray trace scenes larger than memory, out of core, inside a memory budget.",
    )
    top.add_argument("--version", action="version", version=f"bfrt {bfrt.__version__}")
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    add_convert(commands)
    add_render(commands)
    add_spd(commands)
    add_info(commands)
    add_verify(commands)
    add_viewshed(commands)
    add_clean(commands)
    return top
