"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.cluster.asked import Asked
from bfrt.cluster.blocks import Local, lazy_answer
from bfrt.cluster.engine import client_of, is_lazy
from bfrt.cluster.place import Place
from bfrt.cluster.point_blocks import lazy_point_answer
from bfrt.cluster.shared_frame import render as render_shared

__all__ = [
    "Asked",
    "Local",
    "Place",
    "client_of",
    "is_lazy",
    "lazy_answer",
    "lazy_point_answer",
    "render_shared",
]
