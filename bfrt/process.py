"""The process that is a command: its standard streams, and how a signal to end reaches it."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import time

TYPE_CHECKING = False  # known to type checkers; `typing` takes long to import
if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType
    from typing import TextIO

#: The signals that end a command, and what it says then; its exit status is 128 more.
ENDINGS = {
    getattr(signal, name): said
    for name, said in (("SIGINT", "interrupted"), ("SIGTERM", "terminated"), ("SIGHUP", "hung up"))
    if hasattr(signal, name)
}

#: Modules in which nothing is left to do but to end, once a signal has been raised.
ENDING = ("__main__", "bfrt.__main__", "bfrt.cli.command", "bfrt.process")

#: Seconds in which a further interrupt says nothing new, and would only disturb the clearing up.
IMPATIENCE = 1.0

#: Seconds after which an interrupt tries again that nobody would have heard.
AGAIN = 0.01

#: How the system names the code that imports.
IMPORTING = "<frozen importlib"

#: Where an interrupt leaves a lock locked: it is taken, and the block that gives it back not begun.
BETWEEN = ("__enter__", "__exit__")


class Ended(KeyboardInterrupt):
    """Reports a signal that ends the command as an interrupt does.

    Attributes
    ----------
    number : int
        The signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


def ending_of(error: KeyboardInterrupt) -> tuple[str, int]:
    """Return what a command says that a signal has ended, and its exit status."""
    number = error.number if isinstance(error, Ended) else signal.SIGINT
    return ENDINGS[number], 128 + number


class Interrupts:
    """Raises KeyboardInterrupt for SIGINT, SIGTERM and SIGHUP, where it is heard.

    A module that Cython made has a bare ``except`` around what it registers while it is imported,
    which swallows an interrupt without a word; finalisers swallow it with many words. An interrupt
    that comes there is raised a moment later. Until the command has begun it ends the process at
    once, since there is nothing to clear up. The first signal says how the command ends.

    Attributes
    ----------
    begun : bool
        Whether the command has begun.
    """

    def __init__(self) -> None:
        self.begun = False
        self._raised = -math.inf
        self._first: int | None = None
        self._heard: list[int] = []

    def listen(self, *before: Callable[[int, FrameType | None], object]) -> None:
        """Take signals from here on, but those that the process was started to ignore.

        Parameters
        ----------
        before : callables
            Handlers that have taken them so far.
        """
        for number in ENDINGS:
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler, *before):
                self._heard.append(number)
        if self._heard:
            signal.signal(signal.SIGALRM, self.take)
            sys.unraisablehook = self.take_unraisable
        for number in self._heard:
            signal.signal(number, self.take)

    def take(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: one that ends the command, or the alarm by which it comes again.

        Raises
        ------
        Ended
            Unless nobody would hear it, it follows another at once, or the command ends already.
        """
        first = self._first = self._first or number
        if not self.begun:
            with contextlib.suppress(OSError):
                os.write(2, f"bfrt: {ENDINGS[first]}\n".encode())
            os._exit(128 + first)
        if time.monotonic() - self._raised < IMPATIENCE:
            return
        if unheard(frame):
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        if self._raised > -math.inf and frame is not None and module_of(frame) in ENDING:
            return
        self._raised = time.monotonic()
        raise Ended(first)

    def take_unraisable(self, swallowed: sys.UnraisableHookArgs) -> None:
        """Have an interrupt come again which a finaliser swallowed; show other errors."""
        if issubclass(swallowed.exc_type, KeyboardInterrupt):
            self._first = self._first or signal.SIGINT
            self._raised = -math.inf
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            sys.__unraisablehook__(swallowed)

    def end(self) -> None:
        """Ignore signals from here on: all that is left is to exit."""
        for number in (*self._heard, signal.SIGALRM):
            signal.signal(number, signal.SIG_IGN)


def module_of(frame: FrameType) -> str:
    """Return the name of the module whose code a frame runs."""
    return str(frame.f_globals.get("__name__"))


def unheard(frame: FrameType | None) -> bool:
    """Tell whether an exception raised in a frame might be swallowed, or leave a lock locked."""
    if frame is not None and frame.f_code.co_name in BETWEEN:
        return True
    while frame is not None:
        if frame.f_code.co_filename.startswith(IMPORTING):
            return True
        frame = frame.f_back
    return False


def open_missing_streams() -> None:
    """Open the standard streams that were closed, so that no file gets their numbers.

    They are opened the wrong way round: whoever reads or writes them hears that they are bad. Only
    what is said on standard error goes nowhere.
    """
    ways = (("stdin", os.O_WRONLY, "r"), ("stdout", os.O_RDONLY, "w"), ("stderr", os.O_RDWR, "w"))
    for name, way, mode in ways:
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, way)  # the lowest free number: the stream's
            setattr(sys, name, os.fdopen(descriptor, mode, encoding="utf-8", errors="replace"))


def say(text: str) -> None:
    """Print a line on standard error, if anybody listens."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            print(text, file=sys.stderr)


def flush_streams() -> None:
    """Flush what was printed; where that fails it goes nowhere, and nothing is said at exit."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            try:
                stream.flush()
            except OSError:
                silence(stream)


def silence(stream: TextIO) -> None:
    """Send what a stream still holds, and all that comes, nowhere."""
    with contextlib.suppress(OSError):  # of no file, as a test's
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
