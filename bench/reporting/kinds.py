"""What is measured: the kinds of rows, what tells the rows of one apart, and their numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

Row = dict[str, Any]
Rows = list[Row]


class Kind(NamedTuple):
    """Names a kind's script in bench/, the columns that tell its rows apart, and its number.

    Attributes
    ----------
    script : str
        What measures it, with its subcommand.
    keys : tuple of str
    number : str
        The column that is followed from version to version.
    unit : str
    """

    script: str
    keys: tuple[str, ...]
    number: str
    unit: str


_SCENE = ("scene", "size")

KINDS = {
    "peers": Kind("peers.py", ("millions", "cap", "name"), "seconds", "s"),
    "particles": Kind("particles.py", ("millions", "cap", "name"), "seconds", "s"),
    "renderers": Kind("renderers.py", (*_SCENE, "name"), "seconds", "s"),
    "steady": Kind("peers.py --steady", ("rays", "name"), "rate", "rays/s"),
    "loaded": Kind("tree.py rays", ("triangles", "rays", "name"), "rate", "rays/s"),
    "refinements": Kind("refinements.py", (*_SCENE, "disk", "refine"), "seconds", "s"),
    "tree": Kind("tree.py scenes", (*_SCENE, "refine"), "tracing", "s"),
    "random": Kind("tree.py random", ("spheres", "refine"), "seconds", "s"),
    "ordering": Kind("ordering.py", ("kind", "shape", "objects", "order"), "closing", "s"),
    "levels": Kind("partitions.py levels", (*_SCENE, "lower"), "seconds", "s"),
    "growth": Kind("partitions.py growth", (*_SCENE, "grid"), "seconds", "s"),
    "tracing": Kind("partitions.py tracing", _SCENE, "seconds", "s"),
    "stadium": Kind("partitions.py stadium", ("size", "refine", "groups"), "seconds", "s"),
    "budgets": Kind("budgets.py", (*_SCENE, "threads", "budget"), "seconds", "s"),
    "billion": Kind("billion.py", ("scene", "label"), "whole", "s"),
    "points": Kind("points.py", ("format", "points", "cap"), "seconds", "s"),
    "terrain": Kind("terrain.py", ("side", "work", "name", "cap"), "seconds", "s"),
    "checkpoints": Kind("checkpoints.py", (*_SCENE, "refine", "every"), "seconds", "s"),
    "cluster": Kind("cluster.py", (*_SCENE, "refine", "work", "workers"), "seconds", "s"),
}


def key_of(kind: str, row: Row) -> tuple[Any, ...]:
    """What tells a row apart from the others of its kind."""
    return tuple(row.get(name) for name in KINDS[kind].keys)
