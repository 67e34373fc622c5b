"""The model of many machines is held to what is counted for few."""

from __future__ import annotations

import numpy as np
import pytest
from cluster_model import (
    Machines,
    bytes_of,
    cells_met,
    counted,
    legs_of,
    model_table,
    scene_of,
    times,
    traffic_table,
)
from waves import render_here, wave_of

import bfrt
from bfrt.records import HIT
from bfrt.wavefront.routing import NOWHERE, Route


@pytest.fixture(scope="module")
def travel(tmp_path_factory):
    """What travels for cubes of 8 and of 27 cells, of 300 spheres each, a carrier each."""
    found = {}
    for cells in (2, 3):
        path = scene_of(tmp_path_factory.mktemp(f"cells{cells}"), 300, cells, 48)
        wave = wave_of(bfrt.open(path), [[n] for n in range(cells**3)], "sgb")
        found[cells] = render_here(wave, depth=3).stats.travel
    return found


@pytest.mark.parametrize("side", [1, 2, 3, 5])
def test_a_line_meets_as_many_cells_as_the_formula_says(side):
    """Lines of all places and directions: chords of a sphere around, those that meet the cube."""
    rng = np.random.default_rng(side)
    rays = np.zeros(40_000, HIT)
    way = rng.normal(size=(len(rays), 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    across = np.linalg.qr(np.stack([way, *rng.normal(size=(2, len(rays), 3))], axis=2))[0]
    radius, angle = np.sqrt(rng.uniform(0, 3, len(rays))), rng.uniform(0, 2 * np.pi, len(rays))
    begin = (
        across[:, :, 1] * (radius * np.cos(angle))[:, None]
        + across[:, :, 2] * (radius * np.sin(angle))[:, None]
        - 4 * way
    )
    for axis, (o, d) in enumerate((("ox", "dx"), ("oy", "dy"), ("oz", "dz"))):
        rays[o], rays[d] = begin[:, axis], way[:, axis]
    rays["t"] = np.inf
    corners = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 1, 3)
    boxes = [np.stack([c[0], c[0] + 1])[None] * 2 / side - 1 for c in corners]
    route, which = Route(rays, boxes), np.arange(len(rays))
    met = np.zeros(len(rays), int)
    for _ in range(3 * side + 2):
        met += route.next(which, rays["t"]) != NOWHERE
    assert met.max() <= 3 * side - 2
    assert met[met > 0].mean() == pytest.approx(cells_met(side), rel=0.02)


@pytest.mark.parametrize("cells", [2, 3])
def test_bytes_are_those_that_were_counted(travel, cells):
    for depth, fact in zip(travel[cells], counted(travel[cells]), strict=True):
        assert bytes_of(fact, depth.rays, fact.legs) == pytest.approx(depth.bytes)


def test_more_cells_have_no_more_legs_than_few_imply(travel):
    """Legs among 27 carriers, from those among 8, at each depth; hits end some rays before."""
    for few, many in zip(*map(counted, travel.values()), strict=True):
        assert 1 < few.legs < many.legs
        most = legs_of(3, few.legs)
        assert 0.7 * most < many.legs < 1.05 * most


def test_what_limits(travel):
    fact = counted(travel[2])[0]
    slow = times(fact, 1e6, Machines(link=1e3))
    assert slow.limit == "client_link" and slow.seconds == slow.bytes / 1e3
    many = times(fact, 1e6, Machines(count=1000, route=1.0))
    assert many.limit == "client_work"
    assert times(fact, 1e6, Machines(sweep=1e4)).limit == "way"
    one = times(fact, 1e9, Machines(count=8, threads=1, ray_rate=1.0), legs=fact.legs)
    assert one.limit == "worker_work" and one.legs == 1e9 * fact.legs


def test_tables_have_a_row_a_depth(travel):
    assert len(traffic_table(travel[2]).splitlines()) == 1 + len(travel[2])
    rows = model_table([times(each, 1e6, Machines()) for each in counted(travel[2])])
    assert rows.endswith(" seconds") and len(rows.splitlines()) == 2 + len(travel[2])
