"""Offers each name to type checkers; the package imports it when it is first used."""

from bfrt.cluster.asked import Asked
from bfrt.cluster.blocks import Local, ask_in_blocks
from bfrt.cluster.engine import client_of, is_lazy
from bfrt.cluster.place import Place
from bfrt.cluster.point_blocks import ask_about_points
from bfrt.cluster.shared_frame import render as render_shared

__all__ = [
    "Asked",
    "Local",
    "Place",
    "ask_about_points",
    "ask_in_blocks",
    "client_of",
    "is_lazy",
    "render_shared",
]
