"""Bringing a complete stream into spatial order."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.progress import Passes
from bfrt.store.extent import Bounds
from bfrt.store.ordering._loops import give_back
from bfrt.store.ordering.files import OrderedFiles, ordered_folder
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.memory import Pace
from bfrt.store.ordering.objects import Objects
from bfrt.store.ordering.parts import WINDOW, Means, Source, as_they_come, by_place
from bfrt.store.ordering.windows import ordered

Places = NDArray[np.int64]


class Keeping(NamedTuple):
    """Says how files in order are kept while they are made.

    Attributes
    ----------
    durable : bool
        Whether they outlive a loss of power.
    saved : dict, optional
        What `Ordering.saved` has returned, to go on from.
    between : callable
        Called when a window is written, and what it was made of counted.
    pace : Pace
        How many windows are in memory while they are made.
    """

    durable: bool
    saved: dict[str, Any] | None
    between: Callable[[], object]
    pace: Pace


class Ordering:
    """Orders one stream.

    Parameters
    ----------
    given : GivenFiles
        Its files, which are complete.
    around : Bounds
        A box around most of its objects.
    asked : (k,) int64
        Objects by their places as given, ascending, whose new places are wanted.
    passes : Passes
        Counts objects as they go through.
    local : bool
        Whether objects that follow each other are near each other as they are.
    keeping : Keeping

    Attributes
    ----------
    places : (k,) int64
        The new places, once all is done.
    """

    def __init__(
        self, given: GivenFiles, around: Bounds, asked: Places, passes: Passes, *, local: bool,
        keeping: Keeping,
    ) -> None:  # fmt: skip
        self.places = np.full(len(asked), -1, np.int64)
        saved = keeping.saved
        if saved is not None:
            self.places[:] = saved["places"]
        self._between = keeping.between
        self._pace = keeping.pace
        self._asked = asked
        self._given = given
        self._passes = passes
        self._parted = not local and given.amount(local).weight > WINDOW
        self._source = Source(given.layout, self._blocks, around)
        folder = ordered_folder(given.folder)
        self._files = OrderedFiles(
            folder, given.layout, given.objects, keeping.durable, saved and saved["files"]
        )
        self.folder = folder

    def boxes(self) -> Generator[NDArray[np.float32], None, None]:
        """Write all objects in their order, and yield the boxes of each window as it is written."""
        layout, passes = self._given.layout, self._passes
        # All are read to be written; those that are parted are counted before.
        passes.begin(self._given.objects, 3 if self._parted else 2)
        pace = self._pace
        give_back()  # what was taken while objects came
        means = Means(self._given.folder.parent, pace.threads, WINDOW, pace.waiting)
        way = by_place if self._parted else as_they_come
        if self._files.done:
            yield from self._files.boxes()
        passes.add(self._files.done)
        with (
            closing(way(self._source, means, self._files.done)) as windows,
            closing(ordered(windows, layout, means)) as made,
        ):
            for window in made:
                self._look(window.objects.ids, self._files.done)
                self._files.append(window)
                passes.add(window.objects.number)
                yield window.boxes
                self._between()
                del window
                if not pace.waiting:
                    self._files.wait()
        passes.end()

    def _blocks(self) -> Iterator[Objects]:
        """Yield the given objects, counted."""
        for block in self._given.blocks():
            yield block
            self._passes.add(block.number)
            del block  # before the next is read

    def _look(self, ids: NDArray[np.uint64], first: int) -> None:
        """See which of some objects, whose places begin at `first`, are asked for."""
        if not len(self._asked):
            return
        asked = self._asked.astype(np.uint64)
        at = np.minimum(np.searchsorted(asked, ids), len(asked) - 1)
        those = np.flatnonzero(asked[at] == ids)
        self.places[at[those]] = first + those

    def saved(self) -> dict[str, Any]:
        """Have all windows so far on the disk; return what brings the ordering back to here."""
        return {"places": self.places.tolist(), "files": self._files.saved()}

    def close(self) -> dict[str, Any]:
        """Complete the files, beside the given ones; return what the header says of them."""
        return self._files.close()

    def abandon(self) -> None:
        """Give the files up."""
        self._files.abandon()
