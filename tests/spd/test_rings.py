"""The rings are the SPD package's, in its order."""

from __future__ import annotations

import math

import numpy as np
import pytest
from spd_scenes import Recorder, text_of

import bfrt.spd
from bfrt.records import Kind
from bfrt.spd.blocks import BLOCK_OBJECTS


def fed(size):
    recorder = Recorder()
    bfrt.spd.rings(size).feed(recorder)
    return recorder


def text(size):
    return text_of(bfrt.spd.rings(size))


def test_text_of_one_element():
    lines = text(1).splitlines()
    assert lines[0] == "b 0.078 0.361 0.753"
    assert lines[11:13] == ["f 1 1 1 1 0 100000 0 0", "p 4"]
    assert lines[17] == "f 1 0 0 0.5 0.2 3.0827 0 0"
    assert [line[0] for line in lines[17:29]] == list("fcscscscscsf")
    assert lines[18].split()[1:5] == lines[19].split()[1:5]  # a cone, then the sphere at its base
    assert len(lines) == 17 + 6 + 60


def test_a_color_is_named_where_it_changes():
    assert text(3).count("f ") == 1 + 6 * (1 + 4 + 9)


@pytest.mark.parametrize(
    ("size", "objects"),
    [
        (1, 61),
        (7, 8401),
        (36, 972361),
        (94, 16877701),
        (118, 33279541),
        (135, 49755601),
        (368, 1000787041),
    ],
)
def test_counts_without_making_anything(size, objects):
    scene = bfrt.spd.rings(size)
    assert scene.objects == objects == sum(60 * d * d for d in range(1, size + 1)) + 1


def test_feeds_as_many_as_it_says():
    recorder = fed(7)
    spheres, _ = recorder.all(Kind.SPHERE)
    cones, _ = recorder.all(Kind.CONE)
    assert recorder.counts == [4]
    assert len(spheres) + len(cones) + len(recorder.counts) == bfrt.spd.rings(7).objects


def test_feeds_what_a_scene_has_beside_its_objects():
    scene = bfrt.spd.rings(2)
    recorder = fed(2)
    assert recorder.calls == [scene.camera, *scene.lights, scene.background]
    assert recorder.materials == list(scene.materials)
    assert scene.materials[1].shine == pytest.approx(3.0827, rel=1e-4)


def test_materials_are_the_writers_numbers():
    recorder = fed(2)
    assert recorder.all(Kind.POLYGON)[1].tolist() == [101]
    ring_by_ring = np.tile(np.repeat(np.arange(102, 108), 5), 5)
    for kind in (Kind.CONE, Kind.SPHERE):
        np.testing.assert_array_equal(recorder.all(kind)[1], ring_by_ring)


def test_a_large_layer_comes_in_bounded_blocks():
    sizes = [sum(len(part.materials) for part in block) for block in bfrt.spd.rings(40).blocks()]
    assert max(sizes) <= BLOCK_OBJECTS
    assert sum(sizes) == bfrt.spd.rings(40).objects


def test_cylinders_join_the_spheres_of_their_ring():
    recorder = fed(3)
    cones, _ = recorder.all(Kind.CONE)
    spheres, _ = recorder.all(Kind.SPHERE)
    np.testing.assert_array_equal(cones[:, :4], spheres)
    rings = spheres.reshape(-1, 5, 4)
    np.testing.assert_array_equal(cones[:, 4:], np.roll(rings, 1, axis=1).reshape(-1, 4))
    lengths = np.linalg.norm(cones[:, :3] - cones[:, 4:7], axis=1)
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-5)


def test_elements_stand_on_their_lattice():
    spheres, _ = fed(3).all(Kind.SPHERE)
    centers = spheres.reshape(-1, 30, 4)[..., :3].mean(axis=1)[-9:]
    expected = [(x, 3 / math.sin(math.pi / 8), z) for z in (-2, 0, 2) for x in (-2, 0, 2)]
    np.testing.assert_allclose(centers, expected, atol=1e-5)
