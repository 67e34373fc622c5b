"""Bringing a complete stream into spatial order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.store.extent import Bounds
from bfrt.store.ordering.files import OrderedFiles, replace_folder
from bfrt.store.ordering.given import GivenFiles
from bfrt.store.ordering.parts import Means, Source, as_they_come, by_place
from bfrt.store.ordering.windows import ordered
from bfrt.workers import usable_threads

Places = NDArray[np.int64]


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
    local : bool
        Whether objects that follow each other are near each other as they are.
    durable : bool

    Attributes
    ----------
    places : (k,) int64
        The new places, once all is done.
    """

    def __init__(
        self, given: GivenFiles, around: Bounds, asked: Places, *, local: bool, durable: bool
    ) -> None:
        self.places = np.full(len(asked), -1, np.int64)
        self._asked = asked
        self._given = given
        self._local = local
        self._source = Source(given.layout, given.blocks, around)
        folder = given.folder.with_name(f"{given.folder.name}.ordered")
        self._files = OrderedFiles(folder, given.layout, given.objects, durable)
        self.folder = folder

    def boxes(self) -> Iterator[NDArray[np.float32]]:
        """Write all objects in their order, and yield the boxes of each window as it is written."""
        layout = self._given.layout
        means = Means(self._given.folder.parent, usable_threads())
        windows = (
            as_they_come(self._source, means) if self._local else by_place(self._source, means)
        )
        done = 0
        for window in ordered(windows, layout, means.threads):
            self._look(window.objects.ids, done)
            self._files.append(window)
            done += window.objects.number
            yield window.boxes

    def _look(self, ids: NDArray[np.uint64], first: int) -> None:
        """See which of some objects, whose places begin at `first`, are asked for."""
        if not len(self._asked):
            return
        _, those, at = np.intersect1d(
            ids, self._asked.astype(np.uint64), assume_unique=True, return_indices=True
        )
        self.places[at] = first + those

    def close(self) -> dict[str, Any]:
        """Complete the files, in place of the given ones; return what the header says of them."""
        header = self._files.close()
        replace_folder(self._given.folder, self.folder)
        return header

    def abandon(self) -> None:
        """Give the files up."""
        self._files.abandon()
