"""Several groups: the nearest hit is over all of them, whatever group an object is in."""

from __future__ import annotations

from dataclasses import replace

import fast
import numpy as np
import pytest
from scenes import random_objects, units

import bfrt
from bfrt.errors import SettingError
from bfrt.records import INDEX_BITS, KIND_BITS, Kind
from bfrt.reference import exhaustive
from bfrt.store.store import open_store

TIGHT = fast.limited(
    replace(fast.ROOMY, rays=53, candidates=120, hits=7, queue=5, blocks=2, subspace=4000),
    voxels=16**3,
    slab=2048,
    single=8**3,
)


def split(path, rng, groups):
    """Random objects, each in a group by chance; no two in one place."""
    objects = fast.stored(random_objects(rng, 300, spread=4.0, size=0.7))
    with bfrt.SceneWriter(path, origin=(0, 0, 0), hierarchy=fast.DEEP, order="given") as writer:
        tables = (
            (Kind.SPHERE, objects.spheres), (Kind.CONE, objects.cones),
            (Kind.TRIANGLE, objects.triangles), (Kind.PATCH, objects.patches),
        )  # fmt: skip
        for group in range(groups):
            for kind, table in tables:
                writer.append(kind, table[group::groups], group=group)
    return open_store(path)


@pytest.mark.parametrize("capacities", [fast.ROOMY, TIGHT], ids=["roomy", "tight"])
@pytest.mark.parametrize("groups", [1, 2, 3, 5])
def test_nearest_and_occluded_are_the_references(tmp_path, groups, capacities):
    rng = np.random.default_rng(groups)
    store = split(tmp_path / "a.bfrt", rng, groups)
    assert len(store.groups) == groups and len({s.number for s in store.streams}) == 4 * groups
    lo, hi = store.bounds
    origins = rng.uniform(lo - 1, hi + 1, (400, 3))
    directions = units(rng, 400) * 10.0
    directions[7] = np.nan
    directions[8] = 0.0
    for several in (store, fast.gridded(store)):
        found = fast.nearest(several, origins, directions, tmp_path, capacities)
        t, ids = exhaustive.nearest(several, origins, directions)
        np.testing.assert_array_equal(found.t, t)
        np.testing.assert_array_equal(found.ids, ids)
        seen = np.unique(ids[np.isfinite(t)] >> np.uint64(INDEX_BITS)) >> np.uint64(KIND_BITS)
        assert set(seen.tolist()) == set(range(groups))
        dark = fast.occluded(several, origins, directions, tmp_path, capacities)
        np.testing.assert_array_equal(dark, t < fast.SHADOW_END)


@pytest.mark.parametrize("refine", ["base", "sg", "sgb"])
def test_the_picture_is_that_of_one_group(tmp_path, refine):
    rng = np.random.default_rng(1)
    spheres = np.column_stack([rng.random((400, 3)), rng.uniform(0.01, 0.05, 400)])
    glass = bfrt.Material(kd=0.3, ks=0.4, transmittance=0.5, ior=1.3, shine=20.0)
    images = []
    for groups in (1, 3):
        with bfrt.SceneWriter(tmp_path / f"{groups}") as writer:
            writer.camera(bfrt.Camera((2.5, 1.5, 2), (0.5, 0.5, 0.5), resolution=(48, 48)))
            writer.light(bfrt.Light((5, 5, 5)))
            writer.background((0.1, 0.2, 0.3))
            numbers = np.arange(400) % 2
            writer.material(bfrt.Material()), writer.material(glass)
            for g in range(groups):
                part = spheres[g::groups].astype(np.float32)
                writer.spheres(part[:, :3], part[:, 3], numbers[g::groups], group=g)
        images.append(
            bfrt.render(tmp_path / f"{groups}", memory="256MiB", refine=refine, aovs=("position",))
        )
    one, three = images
    for name in ("R", "G", "B", "A", "Z", "N.X", "P.X", "P.Y", "P.Z"):
        np.testing.assert_array_equal(one.channels[name], three.channels[name])
    assert one.stats.total.rays == three.stats.total.rays
    assert len(three.stats.grids) == 3 and one.stats.total.rays.refraction > 0


def test_a_teapot_in_a_stadium(tmp_path):
    """One small dense group in a large sparse one: in one grid, the teapot is in one voxel."""
    scene = bfrt.spd.teapot(12)
    ends = np.array(
        [[x, y, -50.0] for x in range(-3000, 3001, 120) for y in range(-3000, 3001, 120)]
    )
    tests = {}
    for groups in (1, 2):
        with bfrt.SceneWriter(
            tmp_path / f"{groups}", dtype=np.float32, origin=(0, 0, 0), order="given"
        ) as writer:
            scene.feed(writer)
            seats = np.array([[0, 0, 0], [60, 0, 0], [0, 60, 10.0]])
            corners = (ends[:, None] + seats).astype(np.float32)
            writer.triangles(corners, np.zeros(len(ends), np.uint32), group=groups - 1)
        camera = replace(scene.camera, resolution=(64, 64))
        image = bfrt.render(tmp_path / f"{groups}", memory="256MiB", camera=camera)
        tests[groups] = image.stats.total.box_tests
    assert tests[2] * 10 < tests[1]


def test_groups_are_numbered_as_they_come(tmp_path):
    for wrong in (2, -1, True):
        with (
            pytest.raises(SettingError, match=r"group: found .*, expected 0 to 1"),
            bfrt.SceneWriter(tmp_path / "a") as writer,
        ):
            writer.spheres(np.zeros((1, 3)), 1.0, group=wrong)


def test_one_file_one_group(tmp_path):
    head = "v\nfrom 0 0 9\nat 0 0 0\nup 0 1 0\nangle 40\nhither 1\nresolution 32 32\nl 1 2 9\n"
    (tmp_path / "a.nff").write_text("b 0 0 1\n" + head + "f 1 0 0 1 0 0 0 0\ns 0 0 0 1\n")
    (tmp_path / "b.nff").write_text("b 1 1 1\n" + head.replace("9", "8") + "s 2 0 0 1\ns 3 0 0 1\n")
    scene = bfrt.convert([tmp_path / "a.nff", tmp_path / "b.nff"], tmp_path / "s.bfrt")
    assert [[s.count for s in g.streams] for g in scene.store.groups] == [[1], [2]]
    # The view and its colors are the first file's.
    assert scene.camera.eye == (0, 0, 9) and scene.background == (0, 0, 1)
    assert len(scene.lights) == 1
    scene.verify()
