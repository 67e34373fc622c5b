"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.planning.estimate import plan_of
from bfrt.planning.ordering import ordering_of
from bfrt.planning.planned import Plan

__all__ = ["Plan", "ordering_of", "plan_of"]
