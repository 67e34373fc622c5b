"""The paper's refinements, and the tree, change what is read, never what is seen."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from spd_scenes import spatial

import bfrt
from bfrt.errors import SettingError, StoreError
from bfrt.grid._hierarchy_walk import HierarchyWalk
from bfrt.grid.grid import Grid
from bfrt.grid.voxel_rays import VoxelRays
from bfrt.records import ON_REQUEST, PARENT, Kind
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.store import open_store
from bfrt.workers import Workers

#: Two sizes of each scene that finish soon.
SIZES = {
    "balls": (2, 3), "gears": (1, 2), "mount": (3, 5), "rings": (2, 4),
    "teapot": (3, 6), "tetra": (3, 5), "tree": (4, 7),
}  # fmt: skip

#: Every channel is compared.
AOVS = tuple(ON_REQUEST)


def pixels(image):
    return {name: channel.tobytes() for name, channel in image.channels.items()}


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_pictures_and_rays_are_the_same(name, tmp_path):
    for size in SIZES[name]:
        scene = bfrt.spd.scene(name, size)
        deep = Hierarchy(s=2.0, n=4, l=4, t=0.3)
        store = scene.write(tmp_path / f"{size}.bfrt", hierarchy=deep)
        camera = bfrt.Camera(
            scene.camera.eye, scene.camera.at, scene.camera.up, resolution=(64, 64)
        )
        images = {
            r: bfrt.render(store, memory="256MiB", camera=camera, refine=r, aovs=AOVS)
            for r in fast.OF_GRIDS
        }
        ordered = spatial(scene, tmp_path / f"{size}.ordered.bfrt")
        images["tree"] = bfrt.render(
            ordered, memory="256MiB", camera=camera, refine="tree", aovs=AOVS
        )
        base = images["base"]
        for image in images.values():
            assert pixels(image) == pixels(base)
            assert image.stats.total.rays == base.stats.total.rays


@pytest.mark.parametrize("memory", ["72MiB", "256MiB"])
@pytest.mark.parametrize("name", ["mount", "rings"])
def test_quantised_boxes_show_the_same(name, memory, tmp_path):
    scene = bfrt.spd.scene(name, {"mount": 7, "rings": 9}[name])
    images = {}
    for bits in (0, 8):
        made = scene.write(tmp_path / f"{bits}.bfrt", hierarchy=Hierarchy(bits=bits))
        camera = replace(scene.camera, resolution=(64, 64))
        images[bits] = bfrt.render(made, memory=memory, camera=camera, aovs=AOVS)
        streams = made.store.streams
        assert all(s.quantised == (bits > 0 and s.kind != Kind.SPHERE) for s in streams)
    assert pixels(images[0]) == pixels(images[8])
    totals = [image.stats.total for image in images.values()]
    assert totals[0].rays == totals[1].rays
    # They are what was read.
    exact, rough = (total.phases.intersection.bytes_read / total.passes for total in totals)
    assert rough < exact


def test_less_is_read(tmp_path):
    """Two clouds, of which one is looked at: the other's geometry is never read."""
    rng = np.random.default_rng(1)
    centers = rng.uniform(-1, 1, (200_000, 3)).astype(np.float32)
    cells = np.floor(centers * 8)
    centers = centers[np.lexsort(cells.T)]  # cell by cell, as most models come in some order
    centers[np.arange(200_000) % 40_000 < 20_000, 0] += 100
    corners = centers[:, None] + rng.normal(0, 0.01, (200_000, 3, 3)).astype(np.float32)
    with bfrt.SceneWriter(tmp_path / "a.bfrt", order="given") as writer:
        writer.camera(bfrt.Camera((0, -5, 0), (0, 0, 0), resolution=(64, 64)))
        writer.light(bfrt.Light((0, -50, 0)))
        writer.triangles(corners)
    totals = {}
    for refine in fast.OF_GRIDS:
        stats = bfrt.render(
            tmp_path / "a.bfrt", memory="256MiB", refine=refine, fresh_marks=True
        ).stats
        total = totals[refine] = stats.total
        assert stats.settings["refine"] == refine
        assert (stats.hierarchy_seconds > 0) == (refine == "sgb")
        assert total.phases.intersection.seeks > 0
    read = {r: sum(p.bytes_read for p in vars(t.phases).values()) for r, t in totals.items()}
    assert read["sgb"] < read["sg"] < read["base"]
    assert totals["sgb"].boxes_read < totals["sg"].boxes_read < totals["base"].boxes_read
    assert totals["sg"].geometry_read < totals["base"].geometry_read / 10
    # A quantised box is a little larger, so that more rays meet it.
    assert totals["sg"].geometry_read == pytest.approx(totals["sgb"].geometry_read, rel=0.4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size"),
    [("balls", 7), ("gears", 20), ("mount", 10), ("rings", 37), ("teapot", 126), ("tetra", 10),
     ("tree", 19)],
)  # fmt: skip
def test_less_is_read_of_every_scene_of_a_million(name, size, tmp_path):
    store = bfrt.spd.scene(name, size).write(tmp_path / "a.bfrt")
    read, images = {}, {}
    for refine in fast.OF_GRIDS:
        image = images[refine] = bfrt.render(
            store, memory="256MiB", refine=refine, fresh_marks=True
        )
        phases = vars(image.stats.total.phases).values()
        read[refine] = sum(phase.bytes_read for phase in phases)
        assert sum(phase.seeks for phase in phases) > 0
        assert pixels(image) == pixels(images["base"])
        assert image.stats.total.rays == images["base"].stats.total.rays
    assert read["sgb"] < read["sg"] < read["base"]


def test_a_refinement_that_is_none(tmp_path):
    store = bfrt.spd.tetra(2).write(tmp_path / "a.bfrt")
    with pytest.raises(SettingError, match="refine: found 'fast', expected one of base"):
        bfrt.render(store, refine="fast")


def occupied(shape, voxels):
    """Voxel rays with one candidate in each of some voxels."""
    rays = VoxelRays(shape)
    rays.sort(np.sort(voxels).astype(np.uint64) << np.uint64(24), len(voxels), Workers(1))
    return rays


@given(
    seed=st.integers(0, 2**32),
    n=st.integers(1, 400),
    room=st.sampled_from([1, 3, 1000]),
    most=st.sampled_from([1, 50, 1000]),
)
def test_selection_finds_every_object_near_a_ray(tmp_path_factory, seed, n, room, most):
    """What is left out is in no occupied voxel, by brute force."""
    rng = np.random.default_rng(seed)
    folder = tmp_path_factory.mktemp("selection")
    centers = np.clip(np.cumsum(rng.normal(0, 0.5, (n, 3)), axis=0), -9, 9).astype(np.float32)
    settings = Hierarchy(s=rng.uniform(1, 4), n=3, l=int(rng.integers(1, 5)), t=rng.random())
    with bfrt.SceneWriter(folder / "a.bfrt", hierarchy=settings, order="given") as writer:
        writer.spheres(centers, np.float32(0.2))
    (stream,) = open_store(folder / "a.bfrt").streams
    shape = tuple(int(k) for k in rng.integers(1, 40, 3))
    grid = Grid((-10.0,) * 3, (10.0,) * 3, shape, 1e-6)
    voxels = np.unique(rng.integers(0, np.prod(shape), rng.integers(0, 6)))
    walk, ranges, found = HierarchyWalk(stream, 4096), np.empty((room, 2), np.int64), []
    walk.begin(grid, occupied(shape, voxels))
    while k := walk.choose(ranges, most):
        found.extend(range(a, b) for a, b in ranges[:k].tolist())
    chosen = [i for part in found for i in part]
    assert chosen == sorted(set(chosen)) and set(chosen) <= set(range(n))
    z, y, x = np.unravel_index(voxels, shape[::-1])
    for i in set(range(n)) - set(chosen):
        box = np.concatenate([centers[i] - np.float32(0.2), centers[i] + np.float32(0.2)])
        lo, hi = grid.range_of(box.astype(np.float32))
        inside = [(lo[k] <= at) & (at <= hi[k]) for k, at in enumerate((x, y, z))]
        assert not np.logical_and.reduce(inside).any()


def test_a_hierarchy_that_lies_is_refused(tmp_path):
    """Its sizes are right, its contents are not: a sentence, no crash."""
    bfrt.spd.rings(2).write(tmp_path / "a.bfrt", hierarchy=Hierarchy(s=1.0, n=2, l=3))
    rng = np.random.default_rng(2)
    refused = 0
    for stream in open_store(tmp_path / "a.bfrt").streams:
        for number in range(1, len(stream.levels) + 1):
            path = stream.path(f"level{number}")
            whole = np.fromfile(path, PARENT)
            for end in (-1, 0, 1 << 60, int(rng.integers(1 << 40))):
                broken = whole.copy()
                broken["end"][rng.integers(len(whole))] = end
                broken.tofile(path)
                try:
                    bfrt.render(tmp_path / "a.bfrt", memory="256MiB")
                except StoreError as error:
                    assert "found a box whose children end at" in str(error)
                    refused += 1
            whole.tofile(path)
    assert refused > 5
    open_store(tmp_path / "a.bfrt").verify()


def test_polygons_whose_ends_descend_are_refused(tmp_path):
    (stream,) = bfrt.spd.gears(1).write(tmp_path / "a.bfrt").store.streams
    ends = np.fromfile(stream.path("offsets"), "<u4")
    for refine in fast.OF_GRIDS:
        broken = ends.copy()
        broken[20:60] = ends[20:60][::-1]
        broken.tofile(stream.path("offsets"))
        with pytest.raises(StoreError, match=r"offsets: polygon \d+ and on: found vertices"):
            bfrt.render(tmp_path / "a.bfrt", memory="256MiB", refine=refine)


@pytest.mark.parametrize("refine", fast.OF_GRIDS)
def test_damaged_ends_of_polygons_are_told_as_such(tmp_path, refine):
    """Whatever an end is, the file that is wrong is the one that is told."""
    scene = bfrt.spd.gears(1).write(tmp_path / "a.bfrt")
    (stream,) = scene.store.streams
    ends = np.fromfile(stream.path("offsets"), "<u4")
    rng = np.random.default_rng(11)
    rays = rng.normal(size=(2, 400, 3))
    wrong = [0, 1, stream.vertices, stream.vertices + 1, 1 << 31, (1 << 32) - 1]
    refused = 0
    for end in (*wrong, *rng.integers(0, stream.vertices, 6)):
        broken = ends.copy()
        broken[rng.integers(len(ends) - 1) if end else -1] = end
        broken.tofile(stream.path("offsets"))
        for ask in (
            lambda: bfrt.render(scene.path, memory="256MiB", refine=refine),
            lambda: bfrt.cast_rays(scene.path, *rays, refine=refine),
        ):
            try:
                ask()
            except StoreError as error:
                assert "offsets: polygon" in str(error)
                refused += 1
    assert refused >= 12


def test_seven_levels_of_everything(tmp_path):
    """A chain in which each level has one box less is walked to its end."""
    centers = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])
    chain = Hierarchy(s=1e-6, n=1, l=8, t=0.0)
    with bfrt.SceneWriter(tmp_path / "a.bfrt", hierarchy=chain, order="given") as w:
        w.spheres(centers, 0.4)
    store = open_store(tmp_path / "a.bfrt")
    assert store.streams[0].levels == (9,) * 8
    ways = np.tile([0.0, 0.0, 1.0], (9, 1))
    origins = centers - np.array(store.origin) - [0, 0, 5]
    found = fast.nearest(store, origins, ways, tmp_path)
    np.testing.assert_allclose(found.t, 4.6)
