"""Progress bars, where a terminal shows them and tqdm is installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

from bfrt.progress import Done, DoneReport


def wants_bar(quiet: bool) -> bool:
    """Tell whether to show a progress bar: on a terminal, where tqdm is installed."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        return False
    try:
        import tqdm  # noqa: F401
    except ImportError:
        return False
    return True


@contextmanager
def bars(what: str, quiet: bool) -> Iterator[DoneReport | None]:
    """Yield a reporter that shows a bar for each stage, or None where no bar is wanted."""
    if not wants_bar(quiet):
        yield None
        return
    with closing(StageBars(what)) as shown:
        yield shown.show


class StageBars:
    """Shows a tqdm bar for each stage of a conversion.

    Parameters
    ----------
    what : str
        What the stages but the ordering are called.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._stage = ""
        self._bar: Any = None

    def show(self, done: Done) -> None:
        from tqdm import tqdm

        if done.stage != self._stage:
            self.close()
            self._stage = done.stage
            self._bar = tqdm(
                total=done.total,
                desc="order" if done.stage == "ordering" else self._what,
                unit="B" if done.stage == "reading" else " objects",
                unit_scale=True,
            )
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()
