"""Pictures by treelets are those by a grid, bit for bit, whatever memory and threads there are."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from injected import dividing
from spd_scenes import spatial
from treelets import FORMS, formed, small_treelets

import bfrt
from bfrt.errors import BudgetError
from bfrt.records import ON_REQUEST

SIZES = {"balls": 3, "gears": 1, "mount": 5, "rings": 3, "teapot": 5, "tetra": 4, "tree": 6}
AOVS = tuple(ON_REQUEST)


@pytest.fixture(scope="module", params=SIZES)
def shown(request, tmp_path_factory):
    """A standard scene in small treelets, a view, and its picture by a grid."""
    folder = tmp_path_factory.mktemp(request.param)
    scene = bfrt.spd.scene(request.param, SIZES[request.param])
    camera = replace(scene.camera, resolution=(40, 31))
    image = bfrt.render(scene.write(folder / "given"), camera=camera, aovs=AOVS)
    with small_treelets(32):
        return spatial(scene, folder / "ordered"), camera, image


def same(image, expected):
    """Hold a picture and its rays to another's, which shows something."""
    assert expected.stats.total.rays.eye_hits > 50
    assert image.channels.keys() == expected.channels.keys()
    for name, channel in expected.channels.items():
        np.testing.assert_array_equal(image.channels[name], channel, err_msg=name)
        assert image.channels[name].tobytes() == channel.tobytes()
    assert image.stats.total.rays == expected.stats.total.rays
    assert image.stats.bad_rays == expected.stats.bad_rays


def least_of(scene, **settings):
    """The least budget, as the refusal of less names it."""
    with pytest.raises(BudgetError) as caught:
        scene.render(memory=1, **settings)
    return re.findall(r"expected (\S+) or more", str(caught.value))[0]


@pytest.mark.parametrize("form", FORMS)
def test_every_form_shows_the_same(shown, form):
    store, camera, expected = shown
    threads = 1 + list(FORMS).index(form) % 3
    image = formed(store, form).render(camera=camera, aovs=AOVS, threads=threads, refine="tree")
    assert image.stats.tree["resident"] == form.startswith("resident")
    same(image, expected)


def test_budgets_show_the_same(shown):
    store, camera, expected = shown
    for threads, memory in ((1, None), (3, None), (2, "96MiB"), (3, "256MiB")):
        settings = {"camera": camera, "aovs": AOVS, "threads": threads}
        memory = memory or least_of(store, **settings)
        same(store.render(memory=memory, **settings), expected)


@pytest.mark.parametrize("resident", [True, False], ids=["resident", "streamed"])
def test_bands_of_rows_show_the_same(shown, resident):
    store, camera, expected = shown

    def in_bands(held):
        return replace(held, resident=resident, rows=7, frame_on_disk=True, rays=200, hits=90)

    told = []
    image = dividing(store, in_bands).render(
        camera=camera, aovs=AOVS, threads=2, progress=told.append
    )
    assert max(progress.bands for progress in told) == 5
    same(image, expected)


def test_a_grid_on_treelets_shows_the_same(shown):
    """The paper's refinements go over a store in spatial order as over another."""
    store, camera, expected = shown
    for refine in ("base", "sgb"):
        image = store.render(camera=camera, aovs=AOVS, refine=refine, threads=2)
        assert image.stats.tree is None
        same(image, expected)


def test_samples_of_a_pixel(shown):
    store, camera, _ = shown
    settings = {"camera": replace(camera, resolution=(16, 12)), "samples": 3, "depth": 3}
    expected = store.render(refine="sgb", **settings)
    for form in FORMS:
        same(formed(store, form).render(refine="tree", **settings), expected)
