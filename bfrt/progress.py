"""Progress of a render, a query or a conversion: reported to a caller, or shown as a bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from bfrt.errors import Cancelled, SettingError


class Progress(NamedTuple):
    """Tells how far a render or a query is.

    A frame that memory does not hold is rendered in bands of rows, each from its first depth on.

    Attributes
    ----------
    depth : int
        The depth of the rays that are being traced, from 1.
    done : int
        Rays of this depth, and of this band, that are finished: their nearest hit, or that they
        have none, is known. Hits are shaded when all rays of the depth are finished.
    total : int
        All rays of this depth and band. A query that gets its rays in blocks counts the rays that
        it has taken so far, so that the number grows.
    band, bands : int
        The band of rows that is rendered, from 1, and the number of bands.
    """

    depth: int
    done: int
    total: int
    band: int = 1
    bands: int = 1


#: Called as often as a pass ends; returning False cancels.
Report = Callable[[Progress], object]


class Done(int):
    """Tells how far a conversion is: a number, of the stage that it is at.

    Parameters
    ----------
    count : int
        What is done.
    stage : {"reading", "writing", "ordering"}
        Bytes of files are read, objects of a standard scene are written; then, of a store in
        spatial order, objects are brought into order.
    total : int, optional
        The whole stage, as far as that is known.

    Attributes
    ----------
    stage, total
        As given.
    """

    stage: str
    total: int | None

    def __new__(cls, count: int, stage: str, total: int | None = None) -> Done:
        made = super().__new__(cls, count)
        made.stage, made.total = stage, total
        return made


#: Called as a conversion goes on; returning False cancels.
DoneReport = Callable[[Done], object]


def is_no(answer: object) -> bool:
    """Tell whether a report returned False, Python's or NumPy's."""
    return isinstance(answer, (bool, np.bool_)) and not answer


def staged(
    report: Callable[[Any], object] | None, stage: str, total: int | None
) -> Callable[[int], None] | None:
    """Return what takes the counts of one stage, and raises `Cancelled` where a report says so."""
    if report is None:
        return None

    def tell_count(count: int) -> None:
        if is_no(report(Done(count, stage, total))):
            of = "" if total is None else f" of {total}"
            what = "bytes" if stage == "reading" else "objects"
            raise Cancelled(f"cancelled while {stage}, with {count}{of} {what} done")

    return tell_count


class Passes:
    """Counts objects that go through several passes each, stream after stream.

    An object that has been through one of three passes counts as a third.

    Parameters
    ----------
    report : callable, optional
        Takes the number of objects that are through.
    """

    def __init__(self, report: Callable[[int], object] | None = None) -> None:
        self._report = report
        self._before = self._count = self._gone = 0
        self._passes = 1

    def begin(self, count: int, passes: int) -> None:
        """Begin a stream of `count` objects."""
        self._count, self._passes, self._gone = count, passes, 0
        self.add(0)

    def add(self, objects: int) -> None:
        """Count objects that have been through another pass."""
        self._gone += objects
        if self._report is not None:
            self._report(self._before + min(self._count, self._gone // self._passes))

    def end(self) -> None:
        """Count the stream as through."""
        self._before += self._count
        self._count = self._gone = 0
        self.add(0)


def tell(report: Report, progress: Progress) -> None:
    """Report progress.

    Raises
    ------
    Cancelled
        If the report returns False.
    """
    if is_no(report(progress)):
        raise Cancelled(
            f"cancelled at depth {progress.depth}, with {progress.done} of {progress.total} rays "
            "finished"
        )


def check_report(report: object) -> None:
    """Refuse what is neither a function nor None, before the work that would be told to it.

    Raises
    ------
    SettingError
        If it is.
    """
    if report is not None and not callable(report):
        raise SettingError(f"progress: found {report!r:.80}, expected a function or None")


@contextmanager
def reporting(progress: bool | Report) -> Iterator[Report]:
    """Yield the function that takes reports: one that ignores them, the caller's, or a bar."""
    if progress is False:
        yield lambda _: None
    elif progress is not True:
        if not callable(progress):
            raise SettingError(
                f"progress: found {progress!r:.80}, expected True, False or a function"
            )
        yield progress
    else:
        with Bar() as bar:
            yield bar.show


class Bar:
    """Shows a tqdm bar for each depth: rays finished, of the depth's rays.

    It is that of a notebook in one, and of a terminal elsewhere.
    """

    def __init__(self) -> None:
        try:
            from tqdm.auto import tqdm
            from tqdm.notebook import tqdm_notebook
        except ImportError:
            raise SettingError("progress: a bar needs tqdm: install bfrt[progress]") from None
        self._tqdm = tqdm
        # A terminal's bar is none where there is no terminal; a notebook has none, and shows it.
        self._disable = False if issubclass(tqdm, tqdm_notebook) else None
        self._bar: Any = None
        self._where = (0, 0)

    def show(self, progress: Progress) -> None:
        if (progress.band, progress.depth) != self._where:
            self._close()
            self._where = (progress.band, progress.depth)
            band = f"band {progress.band} of {progress.bands}, " if progress.bands > 1 else ""
            self._bar = self._tqdm(
                total=progress.total,
                desc=f"{band}depth {progress.depth}",
                unit=" rays",
                unit_scale=True,
                disable=self._disable,
            )
        self._bar.total = progress.total  # which may grow
        self._bar.update(progress.done - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()
