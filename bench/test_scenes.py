"""Standard scenes, from a cold store to a picture, inside 256 MiB."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from capped import CAP
from profiles import SIZES
from stores import ORDERS

import bfrt

NAMES = tuple(SIZES["large"])

Case = Callable[..., dict[str, Any]]


@pytest.mark.benchmark(group="making a store")
@pytest.mark.parametrize("name", NAMES)
def test_make(case: Case, folder: Path, profile: str, name: str) -> None:
    if name not in SIZES[profile]:
        pytest.skip(f"no {name} in profile {profile}")
    target = folder / "made.bfrt"
    case("spd", [], name=name, size=SIZES[profile][name], target=str(target))
    shutil.rmtree(target)  # a huge one leaves no room for another


@pytest.mark.benchmark(group="rendering")
@pytest.mark.parametrize("refine", ["tree", "sgb", "sg", "base"])
@pytest.mark.parametrize("name", NAMES)
def test_render(
    case: Case, standard: Callable[..., Path], profile: str, name: str, refine: str
) -> None:
    """With marks made afresh. Base of what is huge takes hours: it is left out."""
    if refine == "base" and profile == "huge":
        pytest.skip("base of a huge scene takes hours")
    store = standard(name, ORDERS[refine])
    fresh = refine != "tree"
    case("render", [store], store=str(store), memory=CAP, refine=refine, fresh_marks=fresh)


@pytest.mark.benchmark(group="rendering again")
@pytest.mark.parametrize("name", NAMES)
def test_render_again(case: Case, standard: Callable[..., Path], name: str) -> None:
    """With the marks of a render before."""
    store = standard(name)
    bfrt.render(store, memory=CAP)  # makes them, if nobody has
    found = case("render", [store], store=str(store), memory=CAP)
    assert found["marks_reused"]


@pytest.mark.benchmark(group="ray queries")
@pytest.mark.parametrize("what", ["cast_rays", "occluded", "count_intersections"])
@pytest.mark.parametrize("refine", ["tree", "sgb"])
@pytest.mark.parametrize("name", ["rings", "mount"])
def test_query(
    case: Case, standard: Callable[..., Path], name: str, refine: str, what: str
) -> None:
    """A hundred thousand rays between random points."""
    store = standard(name, ORDERS[refine])
    case("cast", [store], store=str(store), rays=100_000, query=what, memory=CAP, refine=refine)
