"""``contains``: which points are inside of closed surfaces, by how often rays cross them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.queries.answers import Fields
from bfrt.queries.points import Look, PointQuestion, Records, RowPerPoint, is_bad
from bfrt.queries.question import Answer, Sessions
from bfrt.records import RayKind
from bfrt.settings import Settings
from bfrt.store.store import Store

log = logging.getLogger(__name__)

INSIDE: Fields = {"inside": (np.int8, ())}

#: What a point has whose rays disagree.
UNSURE = -1

#: Two ways that are almost opposite, so that both seldom leave through one hole, and along no
#: plane that things are built in.
WAYS = np.array([[0.4395064455, 0.617598629942, 0.652231566745],
                 [-0.4613907113, -0.5870145107, -0.6652837201]])  # fmt: skip

#: The answer by the sum of the values of both rays: the first counts 1, the second 2, where it
#: crosses surfaces an odd number of times.
ANSWERS = np.array([0, UNSURE, UNSURE, 1], np.int8)


def _look(_: Store) -> Look:
    def look(_: int, points: Records, __: Any) -> tuple[Records, Records]:
        places = points.astype(np.float64)
        return np.repeat(places, len(WAYS), axis=0), np.tile(WAYS, (len(places), 1))

    return look


def _parity(rays: Records) -> NDArray[np.uint32]:
    """Return 1 and 2 for first and second rays that are inside; bad ones of a point disagree."""
    second = (rays["number"] & np.uint64(1)).astype(np.uint32)
    odd = np.where(is_bad(rays), 1 - second, rays["count"] & np.uint32(1))
    return odd << second


class Containment:
    """Answers `bfrt.contains`, and tells how many points are unsure."""

    fields = INSIDE

    def answer(self, sessions: Sessions, question: PointQuestion, settings: Settings) -> Answer:
        """Answer a question."""
        return self.answered(lambda parities: parities.answer(sessions, question, settings))

    def answered(self, way: Callable[[RowPerPoint], Answer]) -> Answer:
        """Return the answer of one who has rays traced in some way."""
        unsure = 0

        def row(sums: NDArray[np.int64]) -> NDArray[np.int8]:
            nonlocal unsure
            rows: NDArray[np.int8] = ANSWERS[sums]
            unsure += int(np.count_nonzero(rows == UNSURE))
            return rows

        parities = RowPerPoint(RayKind.EYE, len(WAYS), np.inf, _look, _parity, INSIDE, row)
        answer = way(parities)
        answer.stats.unsure_points = unsure
        if unsure:
            log.warning(
                "of %d points two rays disagree: what they cross is open there, or they are no "
                "numbers",
                unsure,
            )
        return answer


CONTAINS = Containment()
