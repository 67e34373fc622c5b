"""What a script's JSON says, as rows of plain numbers and words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from reporting.kinds import Rows

#: Ways to read less, as the scripts name them.
REFINEMENTS = ("base", "sg", "sgb", "tree")

#: What is kept of a step of a billion objects.
STEP = ("scene", "label", "step", "whole", "peak", "bytes", "objects", "seconds", "bytes_read",
        "passes", "sweeps", "preprocess", "sweep")  # fmt: skip


def refinements(found: list[dict[str, Any]]) -> Rows:
    """A row for each scene and refinement."""
    return [
        {
            "scene": row["scene"],
            "size": row["size"],
            "objects": row["objects"],
            "disk": row["disk"],
            "refine": refine,
            "create": row["create"],
            "seconds": row[refine]["seconds"],
            "bytes": row[refine]["bytes"],
            "passes": row[refine]["passes"],
            "peak": row[refine]["peak"],
            **{f"{name}_seconds": took for name, took in row[refine]["phases"].items()},
        }
        for row in found
        for refine in REFINEMENTS
    ]


def tree(found: list[dict[str, Any]]) -> Rows:
    """A row for each scene and refinement, those of treelets and those without."""
    rows = []
    for row in found:
        name, size = row["scene"].split(":")
        for refine, making in row["making"].items():
            each = row[refine]
            facts = {key: each[key] for key in ("tracing", "preprocess", "bytes", "passes")}
            rows.append({"scene": name, "size": int(size), "refine": refine, **facts})
            rows[-1] |= {"making": making, "store_bytes": row["bytes"][refine]}
    return rows


def at_random(found: list[dict[str, Any]]) -> Rows:
    """A row for each number of spheres and refinement."""
    return [
        {
            "spheres": row["spheres"],
            "refine": refine,
            **{name: row[refine][name] for name in ("seconds", "making", "picture")},
        }
        for row in found
        for refine in ("sgb", "tree")
    ]


def loaded(found: list[dict[str, Any]]) -> Rows:
    """A row for each program and kind of rays."""
    rows = []
    for row in found:
        for named, rate in row["rays a second"].items():
            name, rays = named.split()
            rows.append({"triangles": row["triangles"], "rays": rays, "name": name, "rate": rate})
    return rows


def billion(found: list[dict[str, Any]]) -> Rows:
    """A row for each step; a picture's preprocess is among its phases."""
    rows = []
    for row in found:
        facts = {name: row[name] for name in STEP if name in row}
        if "phases" in row:
            facts["preprocess"] = row["phases"]["preprocess"]
        rows.append(facts)
    return rows


def cluster(found: dict[str, Any]) -> Rows:
    """A row for each refinement, work and number of workers; 0 is this process alone."""
    rows = []
    for refine, who in found.items():
        for workers, works in who.items():
            for work, facts in works.items():
                row = {"refine": refine, "work": work, "seconds": facts["seconds"]}
                row["workers"] = 0 if workers == "local" else int(workers)
                rows.append(row | {"bytes": facts.get("bytes")})
    return rows


#: Those whose JSON is not rows already.
FLAT: dict[str, Callable[[Any], Rows]] = {
    "refinements": refinements,
    "tree": tree,
    "random": at_random,
    "loaded": loaded,
    "billion": billion,
    "cluster": cluster,
}


def rows_of(kind: str, found: Any) -> Rows:
    """The rows of what a kind's script has written."""
    return FLAT[kind](found) if kind in FLAT else list(found)
