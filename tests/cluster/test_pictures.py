"""Pictures of a cluster are those of one process, bit for bit, however frames are divided."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from cluster_fixtures import (
    MEMORY,
    NEEDED,
    assert_same_picture,
    build,
    cluster_of,
    executing,
    wait_until,
)
from shading import LIT

import bfrt
from bfrt.cluster import shared_frame
from bfrt.cluster.division import Division, divided
from bfrt.image.frame import FrameSize
from bfrt.memory import BASELINE

pytest.importorskip("distributed", reason=NEEDED)

#: A refinement, and the order of a store for it.
WAYS = {"base": "given", "sgb": "given", "tree": "spatial"}


@pytest.fixture(params=WAYS)
def asked(request, paths):
    """A scene, and settings for it."""
    with bfrt.open(paths[WAYS[request.param]]) as scene:
        yield scene, {"refine": request.param, "memory": MEMORY}


@pytest.fixture
def one(paths):
    """A scene, and settings for it, where any way will do."""
    with bfrt.open(paths["spatial"]) as scene:
        yield scene, {"refine": "tree", "memory": MEMORY}


@pytest.mark.parametrize("samples", [None, 2])
def test_two_workers_make_the_picture(shared_client, asked, samples):
    scene, settings = asked
    view = {"samples": samples, "aovs": ("position", "albedo")}
    expected = scene.render(**settings, **view)
    found = scene.render(**settings, **view, client=shared_client)
    assert_same_picture(found, expected)
    rays = found.stats.total.rays
    assert rays.reflection and rays.refraction and rays.shadow
    assert len(found.stats.depths) == len(expected.stats.depths)
    for mine, theirs in zip(found.stats.depths, expected.stats.depths, strict=True):
        assert mine.rays == theirs.rays


@pytest.mark.parametrize("samples", [None, 2])
def test_light_that_is_asked_for(shared_client, asked, samples):
    scene, settings = asked
    view = {"samples": samples, **LIT}
    expected = scene.render(**settings, **view)
    found = scene.render(**settings, **view, client=shared_client)
    assert_same_picture(found, expected)
    assert found.metadata["ao_distance"] == "1.5"


@pytest.mark.parametrize("samples", [None, 2])
def test_two_workers_make_several_views(shared_client, one, samples):
    scene, settings = one
    views = scene.turntable(3)
    expected = scene.render(camera=views, samples=samples, **settings)
    found = scene.render(camera=views, samples=samples, client=shared_client, **settings)
    assert isinstance(found, bfrt.Images) and len(found) == 3
    for number, view in enumerate(views):
        assert_same_picture(found[number], expected[number])
        alone = scene.render(camera=view, samples=samples, **settings)
        assert alone.rgba.tobytes() == found[number].rgba.tobytes()


def test_one_worker_makes_the_picture(asked):
    scene, settings = asked
    expected = scene.render(**settings)
    with cluster_of(1, processes=False, threads=2) as client:
        assert_same_picture(scene.render(**settings, client=client), expected)
        # The function that takes a path, and the current client.
        assert_same_picture(bfrt.render(scene.path, **settings, client=True), expected)


def test_a_frame_that_memory_does_not_hold(shared_client, one):
    """Rows of a band are as many as a worker's memory holds, down to a few."""
    scene, settings = one
    camera = dataclasses.replace(scene.camera, resolution=(700, 160))
    settings = {**settings, "camera": camera, "depth": 1, "memory": "64MiB", "threads": 1}
    expected = scene.render(**settings)
    assert scene.plan(**settings).bands > 8
    assert_same_picture(scene.render(**settings, client=shared_client), expected)


def test_a_frame_of_one_row(shared_client, one):
    scene, settings = one
    camera = dataclasses.replace(scene.camera, resolution=(30, 1))
    expected = scene.render(**settings, camera=camera)
    assert_same_picture(scene.render(**settings, camera=camera, client=shared_client), expected)


def test_a_frame_that_the_client_does_not_hold(shared_client, one, monkeypatch):
    """It puts bands of rows together, one after another, on its disk."""
    scene, settings = one
    camera = dataclasses.replace(scene.camera, resolution=(700, 160))
    settings = {**settings, "camera": camera, "depth": 2, "aovs": ("position",)}
    for samples in (None, 1):
        expected = scene.render(**settings, samples=samples)
        monkeypatch.setattr(shared_frame, "default_memory", lambda: BASELINE + (16 << 20))
        found = scene.render(**settings, samples=samples, client=shared_client)
        monkeypatch.undo()
        assert isinstance(found.channels["R"], np.memmap)
        assert_same_picture(found, expected)


@pytest.mark.parametrize(
    ("height", "most", "rays", "workers", "rows"),
    [
        (100, 100, 10**6, 1, [100]),  # memory for all rays at once
        (100, 100, 10**6, 2, [100]),
        (100, 200, 100 * 50, 2, [100]),  # memory for all of them together
        (100, 100, 100 * 50, 1, [50, 50]),
        (100, 100, 1000, 2, [25, 25, 25, 25]),  # no memory for all rays: four each
        (100, 100, 1, 1, [25, 25, 25, 25]),
        (12, 3, 10**6, 2, [3, 3, 3, 3]),  # no more rows than memory holds
        (13, 3, 10**6, 2, [3, 3, 3, 3, 1]),
        (3, 1, 10**6, 1, [1, 1, 1]),
        (3, 3, 10**6, 64, [3]),
    ],
)
@pytest.mark.parametrize("samples", [0, 1])
def test_how_a_frame_is_divided(height, most, rays, workers, rows, samples):
    frame = FrameSize(100 - (samples == 0), height, samples)
    rays += 100 * (samples == 0)
    division = divided(frame, most, rays, workers)
    bands = division.bands(frame)
    found = [len(band) for band in bands]
    assert [found[0] - (samples == 0), *found[1:]] == rows
    parts = [part for band in bands for part in division.parts_of(band)]
    every = np.sort(np.concatenate(parts))
    np.testing.assert_array_equal(every, np.arange(height + (samples == 0)))
    assert max(map(len, parts)) <= division.held + (samples == 0)


@pytest.mark.parametrize("rows", [1, 5, 31, 32, 100, 257, 641, 2160])
@pytest.mark.parametrize("workers", [1, 2, 3, 8])
def test_parts_are_spread_over_their_band(rows, workers):
    """Alike in size to a row, and over each eighth of a band that is high enough."""
    parts = Division(rows, workers).parts_of(range(7, 7 + rows))
    assert len(parts) == min(rows, workers)
    sizes = [len(part) for part in parts]
    assert sum(sizes) == rows and max(sizes) - min(sizes) <= 1
    if rows >= 16 * workers:
        for part in parts:
            spread = np.histogram(part, 4, (7, 7 + rows))[0] * 4 * workers / rows
            assert spread.min() > 0.5 and spread.max() < 1.6


def test_marks_are_made_by_one_worker(shared_client, tmp_path):
    scene = build(tmp_path / "new.bfrt", "given")
    image = scene.render(refine="sgb", memory=MEMORY, client=shared_client)
    made = [w for w in image.stats.workers.values() if w.total.phases.preprocess.bytes_read]
    assert len(made) == 1 and not image.stats.marks_reused
    again = scene.render(refine="sgb", memory=MEMORY, client=shared_client)
    assert again.stats.marks_reused and not again.stats.total.phases.preprocess.bytes_read
    fresh = scene.render(refine="sgb", memory=MEMORY, fresh_marks=True, client=shared_client)
    made = [w for w in fresh.stats.workers.values() if w.total.phases.preprocess.bytes_read]
    assert len(made) == 1 and not fresh.stats.marks_reused
    assert_same_picture(fresh, image)


def test_counters_are_the_sum_of_all_workers(shared_client, one):
    scene, settings = one
    stats = scene.render(**settings, client=shared_client).stats
    workers = stats.workers.values()
    for name in ("object_tests", "box_tests", "node_tests", "passes", "voxel_steps"):
        assert getattr(stats.total, name) == sum(getattr(w.total, name) for w in workers)
    assert stats.total.rays.eye == sum(w.total.rays.eye for w in workers) == 49 * 41
    assert stats.peak_rss_bytes == max(w.peak_rss_bytes for w in workers) > 0
    told = stats.as_dict()
    assert list(told["workers"]) == list(stats.workers)
    assert told["settings"]["refine"] == settings["refine"] and told["settings"]["depth"] == 5
    assert "peak memory" in stats.table()


def test_progress_is_the_sum_of_all_parts(shared_client, one):
    scene, settings = one
    told = []
    image = scene.render(**settings, client=shared_client, progress=told.append)
    assert {(p.depth, p.band, p.bands) for p in told} == {(1, 1, 1)}
    done = [p.done for p in told]
    assert done == sorted(done)
    rays = image.stats.total.rays
    assert done[-1] == told[-1].total
    assert all(p.total == told[-1].total for p in told if p.done == p.total)
    assert told[-1].total == rays.eye + rays.reflection + rays.refraction + rays.shadow


@pytest.mark.parametrize("answer", [False, np.False_])
def test_a_report_cancels_all_tasks(shared_client, one, answer):
    scene, settings = one
    camera = dataclasses.replace(scene.camera, resolution=(300, 300))
    with pytest.raises(bfrt.Cancelled, match="rays finished"):
        scene.render(**settings, camera=camera, client=shared_client, progress=lambda _: answer)
    wait_until(lambda: not any(shared_client.run(executing).values()))
    wait_until(lambda: not any(shared_client.processing().values()))
    assert not shared_client.futures


def test_an_interrupt_cancels_all_tasks(shared_client, one):
    scene, settings = one

    def interrupt(progress):
        raise KeyboardInterrupt

    camera = dataclasses.replace(scene.camera, resolution=(300, 300))
    with pytest.raises(KeyboardInterrupt):
        scene.render(**settings, camera=camera, client=shared_client, progress=interrupt)
    wait_until(lambda: not any(shared_client.run(executing).values()))
    wait_until(lambda: not any(shared_client.processing().values()))
    expected = scene.render(**settings)
    assert_same_picture(scene.render(**settings, client=shared_client), expected)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2, 4])
def test_all_standard_scenes(tmp_path, workers):
    with cluster_of(workers) as client:
        for name in bfrt.spd.NAMES:
            for order, ways in (("given", ("base", "sgb")), ("spatial", ("tree",))):
                scene = bfrt.spd.scene(name, 3).write(tmp_path / f"{name}.bfrt", order=order)
                camera = dataclasses.replace(scene.camera, resolution=(96, 96))
                for refine in ways:
                    settings = {"refine": refine, "memory": MEMORY, "camera": camera}
                    expected = scene.render(**settings)
                    assert_same_picture(scene.render(**settings, client=client), expected)
