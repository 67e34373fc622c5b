"""What a task gives back: its result, or an error of ours, which nothing on the way is told of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from bfrt.errors import BfrtError


class Failed(NamedTuple):
    """Holds an error that a task has raised, as it travels.

    Attributes
    ----------
    error : BfrtError
    notes : tuple of str
        Which errors lose as they are pickled.
    """

    error: BfrtError
    notes: tuple[str, ...]

    def again(self) -> BfrtError:
        """Return the error, with its notes, to be raised."""
        for note in self.notes:
            if note not in getattr(self.error, "__notes__", ()):  # within one process it has them
                self.error.add_note(note)
        return self.error


@dataclass(frozen=True)
class Quiet:
    """Does a task, and gives errors of ours back in place of raising them.

    What is raised Dask logs, on the worker, with a traceback: noise, where the client raises a
    sentence that names the worker.

    Attributes
    ----------
    task : callable
    """

    task: Callable[..., Any]

    def __call__(self, *given: Any) -> Any:
        try:
            return self.task(*given)
        except BfrtError as error:
            return Failed(error, tuple(getattr(error, "__notes__", ())))
