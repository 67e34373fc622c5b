"""Counters and plans of renders and queries by treelets, and the settings that choose them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from injected import dividing
from spd_scenes import spatial
from treelets import FORMS, QUERIES, formed, small_treelets

import bfrt
from bfrt.errors import SettingError
from bfrt.scene import open_scene

TRACING = ("traversal", "intersection", "shading")


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    """Mirrors, three lights, in small treelets; and the same in the order given."""
    folder = tmp_path_factory.mktemp("counters")
    scene = bfrt.spd.rings(5)
    given = scene.write(folder / "given").store
    with small_treelets(32):
        return given, spatial(scene, folder / "ordered").store


@pytest.fixture
def ordered(stores):
    return open_scene(stores[1].path)


def treelets_of(store):
    return sum(stream.treelets for stream in store.streams)


def rays(n, seed=0):
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-6, 6, (n, 3))
    return origins, rng.uniform(-3, 3, (n, 3)) - origins


# --- counters ------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_a_render_counts_what_it_does(ordered, form):
    view = replace(ordered.camera, resolution=(60, 50))
    stats = formed(ordered, form).render(camera=view, refine="tree", threads=2).stats
    total, number = stats.total, treelets_of(ordered.store)
    resident = form.startswith("resident")
    assert stats.settings["refine"] == "tree"
    assert stats.tree == {"treelets": number, "resident": resident}
    assert stats.grids == [] and not stats.marks_reused
    assert stats.hierarchy_seconds == 0.0
    assert (total.boxes_read, total.box_tests, total.voxel_steps) == (0, 0, 0)
    assert total.node_tests > total.rays.eye
    assert total.rays.eye_hits < total.object_tests
    assert total.phases.preprocess.bytes_read == 0
    assert total.phases.intersection.bytes_read > 0
    if resident:
        # Those that few rays came to are read once more where all are read.
        assert 0 < total.treelets_read < 2 * number
    else:
        assert total.treelets_read > number / 2
        assert total.passes > len(stats.depths)
    summed = [
        sum(getattr(depth, name) for depth in stats.depths)
        for name in ("treelets_read", "node_tests", "object_tests", "passes")
    ]
    assert summed == [total.treelets_read, total.node_tests, total.object_tests, total.passes]
    facts = json.loads(json.dumps(stats.as_dict()))
    assert facts["tree"]["treelets"] == number
    assert facts["depths"][0]["node_tests"] > 0
    assert f"{total.object_tests:,}" in stats.table()


def test_few_rays_at_once_take_more_passes(ordered):
    view = replace(ordered.camera, resolution=(40, 30))
    many, few = (
        formed(ordered, form).render(camera=view).stats.total
        for form in ("streamed", "streamed, few rays")
    )
    assert few.passes > 5 * many.passes
    assert few.treelets_read > 2 * many.treelets_read
    assert few.rays == many.rays


def test_a_grid_counts_no_treelets(ordered):
    stats = ordered.render(refine="sgb", camera=replace(ordered.camera, resolution=(20, 20))).stats
    assert stats.tree is None
    assert stats.as_dict()["tree"] is None
    assert (stats.total.treelets_read, stats.total.node_tests) == (0, 0)


def test_what_stays_in_memory_is_read_once(ordered):
    number = treelets_of(ordered.store)
    first = ordered.cast_rays(*rays(3)).stats.total
    assert 0 < first.treelets_read < number / 2
    again = ordered.cast_rays(*rays(3)).stats.total
    assert (again.treelets_read, again.phases.intersection.bytes_read) == (0, 0)
    assert again.node_tests == first.node_tests
    # With so many rays all are read, those that are there already too.
    whole = ordered.occluded(*rays(number)).stats.total
    assert whole.treelets_read >= number - first.treelets_read
    for query in QUERIES:
        assert getattr(ordered, query)(*rays(5000, 1)).stats.total.treelets_read == 0
    ordered.close()
    assert ordered.cast_rays(*rays(3)).stats.total.treelets_read == first.treelets_read


def test_streams_are_read_by_each_query(ordered):
    scene = formed(ordered, "streamed")
    # Of several threads one may find a hit a moment earlier, which spares another nodes.
    stats = [scene.cast_rays(*rays(500), threads=1).stats for _ in range(2)]
    one, two = (each.total for each in stats)
    assert one.treelets_read == two.treelets_read > 0
    assert one.passes == two.passes > 0
    assert one.node_tests == two.node_tests
    assert stats[1].tree["resident"] is False


# --- plans ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["resident", "streamed", "bands"])
@pytest.mark.parametrize("depth", [1, 5])
def test_a_plan_is_what_the_render_does(ordered, form, depth):
    def in_bands(held):
        return replace(held, resident=False, rows=30, frame_on_disk=True)

    scene = dividing(ordered, in_bands) if form == "bands" else formed(ordered, form)
    settings = {"memory": "96MiB", "threads": 2, "depth": depth, "refine": "tree"}
    view = replace(scene.camera, resolution=(100, 80))
    planned = scene.plan(camera=view, **settings)
    image = scene.render(camera=view, **settings)
    stats = image.stats
    assert planned.grids == () and not planned.marks_reused
    assert planned.tree.treelets == stats.tree["treelets"]
    assert planned.tree.resident == stats.tree["resident"]
    assert planned.tree.nodes == sum(stream.nodes for stream in scene.store.streams)
    assert {key: planned.settings[key] for key in stats.settings} == stats.settings
    assert planned.rays.eye == stats.total.rays.eye
    assert planned.bands == (3 if form == "bands" else 1)
    assert planned.frame_on_disk == isinstance(image.channels["R"], np.memmap)
    nothing = planned.preprocess
    assert (nothing.passes, nothing.bytes_read, nothing.bytes_most, nothing.seconds) == (0, 0, 0, 0)
    assert planned.disk.marks == 0
    sent = stats.total.rays
    others = sent.reflection + sent.refraction + sent.shadow
    assert others / 2 <= planned.rays.others <= 2 * others <= 2 * planned.rays.others_most
    tracing = planned.tracing
    read = sum(getattr(stats.total.phases, name).bytes_read for name in TRACING)
    assert tracing.bytes_least <= read <= tracing.bytes_most
    assert tracing.bytes_least <= tracing.bytes_read <= tracing.bytes_most
    assert stats.total.passes / 3 <= tracing.passes <= 3 * stats.total.passes
    assert tracing.seconds > 0


@pytest.mark.parametrize(("form", "where"), [("resident", "in memory"), ("streamed", "streamed")])
def test_a_plan_is_a_table_and_json(ordered, form, where):
    planned = formed(ordered, form).plan(threads=3)
    facts = json.loads(json.dumps(planned.as_dict()))
    assert facts["tree"]["treelets"] == treelets_of(ordered.store)
    assert facts["grids"] == []
    amounts, treelets, phases, assumed = str(planned).split("\n\n")
    for table in (amounts, treelets, phases):
        assert len({len(line) for line in table.splitlines()}) == 1
    assert "3 threads, tree" in amounts
    assert f"{treelets_of(ordered.store):,}" in treelets and where in treelets
    assert "grid" not in treelets and "estimates assume" in assumed


def test_no_objects_have_a_plan(tmp_path):
    with bfrt.SceneWriter(tmp_path / "empty", order="spatial") as writer:
        writer.camera(bfrt.Camera((0, 0, 0), (0, 1, 0), resolution=(8, 4)))
    scene = bfrt.open(tmp_path / "empty")
    planned = scene.plan(refine="tree")
    assert (planned.tree.treelets, planned.tree.bytes) == (0, 0)
    assert planned.tracing.bytes_least == 0
    image = scene.render(refine="tree")
    assert image.stats.total.treelets_read == 0
    assert (image.channels["A"] == 0).all()


# --- settings ------------------------------------------------------------------------------------


def everything(scene):
    """All that takes settings, with the refinement that each used."""
    view = replace(scene.camera, resolution=(8, 8))
    asks = [lambda **s: scene.plan(camera=view, **s).settings["refine"],
            lambda **s: scene.render(camera=view, **s).stats.settings["refine"]]  # fmt: skip
    for query in QUERIES:
        ask = getattr(scene, query)
        asks.append(lambda ask=ask, **s: ask(*rays(3), **s).stats.settings["refine"])
    return asks


def test_the_order_of_a_store_chooses(stores):
    given, ordered = (open_scene(store.path) for store in stores)
    for ask in everything(given):
        assert ask() == "sgb"
        assert ask(grid=4) == "sgb"
    for ask in everything(ordered):
        assert ask() == "tree"
        assert ask(grid=4) == ask(max_grid=9) == ask(fresh_marks=True) == "sgb"
        assert ask(refine="base") == "base"
        assert ask(refine="tree", fresh_marks=False) == "tree"


def test_treelets_of_a_store_in_the_order_given(stores):
    scene = open_scene(stores[0].path)
    for ask in everything(scene):
        with pytest.raises(SettingError) as caught:
            ask(refine="tree")
        assert str(caught.value) == (
            f"refine: found 'tree' for {scene.path}, whose objects are in the order given, "
            "expected base, sg or sgb, or a store made with order='spatial', which takes "
            f"{scene.plan(refine='sgb').ordering.disk} bytes of disk beside them for a while"
        )


@pytest.mark.parametrize(("name", "value"), [("grid", 8), ("max_grid", 8), ("fresh_marks", True)])
def test_treelets_have_no_grid(ordered, name, value):
    for ask in everything(ordered):
        with pytest.raises(SettingError) as caught:
            ask(refine="tree", **{name: value})
        said = f"{name}: found {value} with refine 'tree', which has no grid"
        assert str(caught.value) == said


@pytest.mark.parametrize("name", ["grid", "max_grid"])
def test_a_grid_that_is_none_is_refused_as_ever(ordered, name):
    """It is not for treelets that nobody has asked for."""
    for ask in everything(ordered):
        with pytest.raises(SettingError, match=f"{name}: found 0, expected a whole number of 1"):
            ask(**{name: 0})
