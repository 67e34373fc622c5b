"""Progress of a render or a query: reported to a caller, or shown as a bar."""

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


def tell(report: Report, progress: Progress) -> None:
    """Report progress.

    Raises
    ------
    Cancelled
        If the report returns False.
    """
    goes_on = report(progress)
    if isinstance(goes_on, (bool, np.bool_)) and not goes_on:
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
    """Shows a tqdm bar for each depth: rays finished, of the depth's rays."""

    def __init__(self) -> None:
        try:
            from tqdm import tqdm
        except ImportError:
            raise SettingError("progress: a bar needs tqdm: install bfrt[progress]") from None
        self._tqdm = tqdm
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
                disable=None,
            )
        self._bar.update(progress.done - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()
