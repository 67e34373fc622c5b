"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.queries.answers import Out
from bfrt.queries.casting import ANY_HIT, COUNT, LIST, nearest
from bfrt.queries.containment import CONTAINS
from bfrt.queries.extras import Extras
from bfrt.queries.given import Given, Points
from bfrt.queries.points import PointQuestion
from bfrt.queries.question import Answer, Question, RaysGiven
from bfrt.queries.visibility import visibility as visibility_of

__all__ = [
    "ANY_HIT",
    "CONTAINS",
    "COUNT",
    "LIST",
    "Answer",
    "Extras",
    "Given",
    "Out",
    "PointQuestion",
    "Points",
    "Question",
    "RaysGiven",
    "nearest",
    "visibility_of",
]
