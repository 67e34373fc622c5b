"""The process that a library reads a file in: it answers as long as another asks."""

from __future__ import annotations

import contextlib
import io
import os
import resource
import traceback
from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

from bfrt.errors import BfrtError
from bfrt.formats.remote.messages import Channel, Ended

#: Seconds of the processor that an answer may take: more than the largest chunk of a file does, or
#: the names of very many datasets. Libraries go round for ever in some files that are damaged.
SECONDS = 300

#: Words, and the numbers behind them.
Answer = tuple[list[Any], NDArray[Any] | None]

#: What can be asked for, by its name.
Verbs = dict[str, Callable[..., Answer]]

#: Opens a file; returns what is said of it first, and what may be asked of it then.
Begin = Callable[[], tuple[list[Any], Verbs]]


def answer(verbs: Verbs, verb: str, *words: Any) -> Answer:
    """Return the answer to a request, or the error that it makes."""
    try:
        return verbs[verb](*words)
    except (BfrtError, KeyError) as error:
        return said(error), None
    except MemoryError:
        return ["MemoryError"], None


def said(error: BaseException) -> list[Any]:
    """Return an error as words: its kind, and what it is made of."""
    made = error.__reduce__()
    assert isinstance(made, tuple)
    return [type(error).__name__, *made[1]]


def end_after(seconds: int) -> None:
    """Have the system end this process when it has had the processor for so many seconds more."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    soft = int(used.ru_utime + used.ru_stime) + 1 + seconds
    hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
    bounded = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (bounded, hard))


def answer_all(channel: Channel, begin: Begin, seconds: int) -> None:
    """Say what a file has, and answer until nothing is asked any more."""
    end_after(seconds)
    facts, verbs = begin()
    channel.send(["done", *facts])
    while True:
        request, _ = channel.receive()
        end_after(seconds)
        channel.send(*answer(verbs, *request))


def serve(begin: Begin, seconds: int = SECONDS) -> None:
    """Serve by the standard streams, of which nothing else may write into the second.

    Parameters
    ----------
    begin : callable
    seconds : int
        Those of the processor that an answer may take.
    """
    with io.FileIO(0, closefd=False) as source, io.FileIO(os.dup(1), "w") as target:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        channel = Channel(source, target)
        with contextlib.suppress(Ended):
            try:
                answer_all(channel, begin, seconds)
            except BfrtError as error:
                channel.send(said(error))
            except Ended:
                raise
            except Exception:  # ours: the process that asks shows where
                channel.send(["RuntimeError", traceback.format_exc()])
