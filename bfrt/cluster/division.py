"""How workers share a frame: bands of rows, one after another, and of each a part for every worker.

::

    band 1   strip ─ part 1        A part has the same number of strips in all of its band, so that
             strip ─ part 2        parts are equally heavy wherever a scene is dense. A strip has
             strip ─ part 1        several rows: what one row sees, the next one sees too, and no
             strip ─ part 2        other worker need read it.
             ...
    band 2   ...

As corners belong to two rows of pixels, rows are those of film elements.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.image.frame import FrameSize
from bfrt.phases.eye import count_eye_rays

#: Bands of a frame at the most, but for more that memory makes.
MOST_BANDS = 4

#: Rows of a strip at the most, and strips of a part at the least.
STRIP = 16
FEWEST_STRIPS = 8


class Division(NamedTuple):
    """Tells how a frame is divided.

    Attributes
    ----------
    rows : int
        Pixel rows of a band: the last one may have less.
    parts : int
        Of each band, a task each.
    """

    rows: int
    parts: int

    @property
    def held(self) -> int:
        """Return the pixel rows that a film has room for which holds a part."""
        return -(-self.rows // self.parts)

    def bands(self, frame: FrameSize) -> list[range]:
        """Return the rows of elements of each band that no band before it has."""
        corners = int(frame.samples == 0)
        return [
            range(first + (corners if first else 0), min(first + self.rows, frame.height) + corners)
            for first in range(0, frame.height, self.rows)
        ]

    def parts_of(self, rows: range) -> list[NDArray[np.uint32]]:
        """Return the parts of a band that have any rows, by the band's rows of elements."""
        strip = max(1, min(STRIP, len(rows) // (FEWEST_STRIPS * self.parts)))
        turn = strip * self.parts
        whole = len(rows) // turn * turn
        every = np.arange(rows.start, rows.stop, dtype=np.uint32)
        strips = every[:whole].reshape(-1, self.parts, strip)
        ends = np.array_split(every[whole:], self.parts)
        parts = [np.append(strips[:, n], end) for n, end in enumerate(ends)]
        return [part for part in parts if len(part)]


#: Of no frame.
UNDIVIDED = Division(0, 1)


def divided(frame: FrameSize, most: int, rays: int, workers: int) -> Division:
    """Return how workers share a frame.

    A part of fewer rays than fit in memory at once only has the objects stream past more often. So
    there are as many parts as the frame fills memory times, up to `MOST_BANDS` for each worker: the
    more there are, the less is done again where a worker ends.

    Parameters
    ----------
    frame : FrameSize
    most : int
        Pixel rows of a band at the most, so that memory holds them: that of each worker its part.
    rays : int
        Rays that the memory of a worker holds at once.
    workers : int
    """
    times = count_eye_rays(frame) / rays
    bands = max(1, min(MOST_BANDS, math.ceil(times / workers)), math.ceil(frame.height / most))
    return Division(-(-frame.height // bands), workers)
