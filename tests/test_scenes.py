"""The scenes and rays of the other tests are what they say."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import EVERY_KIND, hard_scenes, lattice_scene, random_objects, random_rays, twice

from bfrt.reference.independent import nearest

NAMES = sorted(hard_scenes(np.random.default_rng(0)))


@pytest.mark.parametrize("name", NAMES)
def test_rays_are_rays(name):
    rng = np.random.default_rng(1)
    for origins, directions in random_rays(rng, hard_scenes(rng)[name], 31).values():
        assert origins.shape == directions.shape == (31, 3)
        assert np.isfinite(origins).all()
        assert np.isfinite(directions).all()
        assert directions.any(axis=1).all()


def test_the_same_seed_makes_the_same():
    one, two = (
        random_rays(rng, hard_scenes(rng)["overlapping"], 9)
        for rng in (np.random.default_rng(2), np.random.default_rng(2))
    )
    for name, rays in one.items():
        np.testing.assert_array_equal(rays, two[name])


@pytest.mark.parametrize("kind", EVERY_KIND, ids=lambda kind: kind.label)
def test_one_kind_only(kind):
    objects = random_objects(np.random.default_rng(3), 50, [kind])
    tables = (objects.spheres, objects.cones, objects.triangles, objects.patches, objects.counts)
    assert [len(table) for table in tables] == [50 * (kind == other) for other in EVERY_KIND]


def test_zeros_have_both_signs():
    rng = np.random.default_rng(4)
    _, directions = random_rays(rng, random_objects(rng, 5), 50)["along an axis"]
    assert (np.count_nonzero(directions, axis=1) == 1).all()
    assert set(np.signbit(directions[directions == 0])) == {True, False}


def test_the_lattice_fits_float32():
    objects = lattice_scene(np.random.default_rng(5))
    for table in (objects.spheres, objects.cones, objects.triangles, objects.vertices):
        assert len(table)
        np.testing.assert_array_equal(table * 16, np.rint(table * 16))


def test_twice_the_same_ties():
    rng = np.random.default_rng(6)
    objects = random_objects(rng, 40)
    for origins, directions in random_rays(rng, objects, 20).values():
        expected = nearest(objects, origins, directions)
        np.testing.assert_array_equal(nearest(twice(objects), origins, directions), expected)
