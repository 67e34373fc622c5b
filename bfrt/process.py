"""The process that is a command: its standard streams, and how an interrupt reaches it."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import time

TYPE_CHECKING = False  # known to type checkers; `typing` takes long to import
if TYPE_CHECKING:
    from types import FrameType
    from typing import TextIO

INTERRUPTED = 130
INTERRUPTION = "bfrt: interrupted"

#: Seconds in which a further interrupt says nothing new, and would only disturb the clearing up.
IMPATIENCE = 1.0

#: Seconds after which an interrupt tries again that nobody would have heard.
AGAIN = 0.01

#: How the system names the code that imports.
IMPORTING = "<frozen importlib"

#: Where an interrupt leaves a lock locked: it is taken, and the block that gives it back not begun.
BETWEEN = ("__enter__", "__exit__")


class Interrupts:
    """Raises KeyboardInterrupt for SIGINT, where it is heard.

    A module that Cython made has a bare ``except`` around what it registers while it is imported,
    which swallows an interrupt without a word; finalisers swallow it with many words. An interrupt
    that comes there is raised a moment later. Until the command has begun it ends the process at
    once, since there is nothing to clear up.

    Attributes
    ----------
    begun : bool
        Whether the command has begun.
    """

    def __init__(self) -> None:
        self.begun = False
        self._raised = -math.inf

    def listen(self) -> None:
        """Take interrupts from here on, unless the process was started to ignore them."""
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGALRM, self.take)
            signal.signal(signal.SIGINT, self.take)
            sys.unraisablehook = self.take_unraisable

    def take(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: SIGINT, or the alarm by which it comes again.

        Raises
        ------
        KeyboardInterrupt
            Unless nobody would hear it, or it follows another at once.
        """
        if not self.begun:
            with contextlib.suppress(OSError):
                os.write(2, f"{INTERRUPTION}\n".encode())
            os._exit(INTERRUPTED)
        if time.monotonic() - self._raised < IMPATIENCE:
            return
        if unheard(frame):
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
            return
        self._raised = time.monotonic()
        raise KeyboardInterrupt

    def take_unraisable(self, swallowed: sys.UnraisableHookArgs) -> None:
        """Have an interrupt come again which a finaliser swallowed; show other errors."""
        if issubclass(swallowed.exc_type, KeyboardInterrupt):
            self._raised = -math.inf
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            sys.__unraisablehook__(swallowed)

    def end(self) -> None:
        """Ignore interrupts from here on: all that is left is to exit."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGALRM, signal.SIG_IGN)


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
