"""The rings are the SPD package's, in its order."""

from __future__ import annotations

import io
import math
import os
from pathlib import Path

import numpy as np
import pytest

import bfrt.spd
from bfrt.errors import SettingError
from bfrt.records import SCALARS, Kind

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("BFRT_SHARED", ROOT.parent / "shared"))


class Recorder:
    """Writes down what it is fed. Its material numbers are not the scene's own."""

    def __init__(self):
        self.calls = []
        self.materials = []
        self.records = {}
        self.numbers = {}
        self.counts = []

    def camera(self, camera):
        self.calls.append(camera)

    def light(self, light):
        self.calls.append(light)

    def background(self, color):
        self.calls.append(color)

    def material(self, material):
        self.materials.append(material)
        return 100 + len(self.materials)

    def append(self, kind, records, materials):
        assert records.dtype == np.float32 and materials.dtype == np.uint32
        assert records.shape == (len(materials), SCALARS[kind])
        self.records.setdefault(kind, []).append(records)
        self.numbers.setdefault(kind, []).append(materials)

    def append_polygons(self, vertices, counts, materials):
        assert counts.dtype == np.int64 and len(counts) == len(materials)
        assert len(vertices) == counts.sum()
        self.counts.extend(counts.tolist())
        self.records.setdefault(Kind.POLYGON, []).append(vertices)
        self.numbers.setdefault(Kind.POLYGON, []).append(materials)

    def all(self, kind):
        return np.concatenate(self.records[kind]), np.concatenate(self.numbers[kind])


def fed(size):
    recorder = Recorder()
    bfrt.spd.rings(size).feed(recorder)
    return recorder


def text(size):
    file = io.StringIO()
    bfrt.spd.rings(size).write_nff(file)
    return file.getvalue()


def joined(blocks, kind):
    """A kind's records and materials, and its places in the whole scene."""
    records, materials, places, start = [], [], [], 0
    for block in blocks:
        for part in block:
            if part.kind is kind:
                records.append(part.records)
                materials.append(part.materials)
                places.append(part.places + start)
        start += sum(len(part.materials) for part in block)
    return np.concatenate(records), np.concatenate(materials), np.concatenate(places)


@pytest.mark.parametrize("size", [1, 2])
def test_text_is_the_packages(size):
    path = SHARED / "spd" / f"rings{size}.nff"
    if not path.exists():
        pytest.skip(f"{path} is not here: it is optional test data")
    ours, theirs = text(size).splitlines(), path.read_text().splitlines()
    assert len(ours) == len(theirs)
    for our, their in zip(ours, theirs, strict=True):
        assert len(our.split()) == len(their.split()), our
        for a, b in zip(our.split(), their.split(), strict=True):
            if a != b:
                assert math.isclose(float(a), float(b), rel_tol=2e-6, abs_tol=1e-12), (our, their)


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


@pytest.mark.parametrize("kind", [Kind.CONE, Kind.SPHERE, Kind.POLYGON])
@pytest.mark.parametrize("limit", [1, 60, 1000])
def test_block_size_changes_nothing(kind, limit):
    scene = bfrt.spd.rings(9)
    expected = joined(scene.blocks(1 << 30), kind)
    for a, b in zip(joined(scene.blocks(limit), kind), expected, strict=True):
        assert a.dtype == b.dtype
        assert a.tobytes() == b.tobytes()
    assert all(
        sum(len(p.materials) for p in block) <= max(60, limit) for block in scene.blocks(limit)
    )


def test_places_are_a_permutation():
    for block in bfrt.spd.rings(4).blocks(500):
        places = np.concatenate([part.places for part in block])
        np.testing.assert_array_equal(np.sort(places), np.arange(len(places)))


def test_a_large_layer_comes_in_bounded_blocks():
    sizes = [sum(len(part.materials) for part in block) for block in bfrt.spd.rings(40).blocks()]
    assert max(sizes) <= 1 << 16
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


def test_names():
    assert bfrt.spd.NAMES == ("rings",)
    scene = bfrt.spd.scene("rings", 3)
    assert (scene.name, scene.size, scene.objects) == ("rings", 3, 841)
    assert repr(scene) == "<bfrt.spd.rings(3), 841 objects>"


def test_unknown_name_lists_the_names():
    with pytest.raises(SettingError, match="found scene 'ring', expected one of rings"):
        bfrt.spd.scene("ring", 3)


@pytest.mark.parametrize("size", [0, -1])
def test_size_below_one(size):
    with pytest.raises(SettingError, match=f"found size {size}, expected 1 or more"):
        bfrt.spd.rings(size)


def test_size_that_is_no_integer():
    with pytest.raises(TypeError):
        bfrt.spd.rings(2.5)
