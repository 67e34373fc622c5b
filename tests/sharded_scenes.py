"""One scene as one store with several groups, and as shards of one or more groups each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scenes import random_objects

import bfrt
from bfrt.records import Kind
from bfrt.shards.joining import join

SMALL = {"memory": "160MiB", "threads": 2}

#: How objects are found, and the order that a store has for it.
WAYS = {"base": "given", "sg": "given", "sgb": "given", "tree": "spatial"}

QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")

GROUPS = 8


class Both(NamedTuple):
    """The same scene twice: `one` store, and the `parts` that the file of shards names."""

    one: bfrt.Scene
    sharded: bfrt.Scene


def fill(writer, groups, lit=True):
    """Write groups of all kinds, which overlap: numbers are the writer's, seeds the scene's."""
    writer.camera(bfrt.Camera((0.0, 2.0, 16.0), (0.0, 0.0, 0.0), (0, 1, 0), resolution=(40, 30)))
    if lit:
        writer.light(bfrt.Light((4.0, 9.0, 20.0)))
        writer.light(bfrt.Light((-9.0, 1.0, 20.0), (1.0, 0.5, 0.2)))
    writer.background((0.1, 0.2, 0.4))
    for number, seed in enumerate(groups):
        rng = np.random.default_rng(seed)
        objects = random_objects(rng, 30 + 7 * seed, size=1.5)
        glass = bfrt.Material((0.2, 0.4, 0.1 * seed), 0.5, 0.4, 20.0, 0.4, 1.4)
        names = [writer.material(bfrt.Material((0.1 * seed, 0.5, 0.5)))]
        names += [writer.material(glass), writer.material(bfrt.Material(ks=0.3 + seed / 20))]
        for kind, records in (
            (Kind.SPHERE, objects.spheres),
            (Kind.CONE, objects.cones),
            (Kind.TRIANGLE, objects.triangles),
            (Kind.PATCH, objects.patches),
        ):
            each = rng.integers(len(names), size=len(records)) + names[0]
            writer.append(kind, records, each, group=number)
        writer.append_polygons(objects.vertices, objects.counts, names[-1], group=number)


def store_of(path, groups, order="given", lit=True, **settings):
    settings = {"dtype": "float32", "durable": False, **settings}
    with bfrt.SceneWriter(path, order=order, **settings) as writer:
        fill(writer, groups, lit)
    return bfrt.open(path)


def both(folder, shards, order="given", **settings):
    """The scene of `GROUPS` groups, and the same in a number of shards."""
    folder.mkdir(exist_ok=True)
    one = store_of(folder / "one.bfrt", range(GROUPS), order, **settings)
    settings = {"origin": one.origin, **settings}
    parts = np.array_split(np.arange(GROUPS), shards)
    stores = [
        store_of(folder / f"part{n}.bfrt", part.tolist(), order, **settings).store
        for n, part in enumerate(parts)
    ]
    join(folder / "scene.bfrts", stores)
    return Both(one, bfrt.open(folder / "scene.bfrts"))


def rays(n=700, seed=5):
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-9, 9, (n, 3))
    return origins, rng.uniform(-3, 3, (n, 3)) - origins


def assert_same_answer(found, expected):
    assert found.keys() == expected.keys()
    for key in expected:
        np.testing.assert_array_equal(found[key], expected[key], strict=True, err_msg=key)


def assert_same_picture(found, expected):
    assert found.channels.keys() == expected.channels.keys()
    for name in expected.channels:
        np.testing.assert_array_equal(
            found.channels[name], expected.channels[name], strict=True, err_msg=name
        )


def standard(folder, recipe, shards, order="given"):
    """A standard scene whose blocks are dealt out to groups, and the same in shards."""
    folder.mkdir(exist_ok=True)
    with _writer(folder / "one.bfrt", recipe, order) as writer:
        for number in range(shards):
            _deal(writer, recipe, number, shards, group=number)
    stores = []
    for number in range(shards):
        path = folder / f"part{number}.bfrt"
        with _writer(path, recipe, order) as writer:
            _deal(writer, recipe, number, shards, group=0)
        stores.append(bfrt.open(path).store)
    join(folder / "scene.bfrts", stores)
    return Both(bfrt.open(folder / "one.bfrt"), bfrt.open(folder / "scene.bfrts"))


def _writer(path, recipe, order):
    writer = bfrt.SceneWriter(path, order=order, dtype="float32", durable=False, origin=(0, 0, 0))
    writer.camera(recipe.camera)
    for light in recipe.lights:
        writer.light(light)
    writer.background(recipe.background)
    return writer


def _deal(writer, recipe, number, shards, group):
    """Write every so many block of a scene, with materials of its own, into a group."""
    names = np.array([writer.material(material) for material in recipe.materials], np.uint32)
    limit = max(1, recipe.objects // (3 * shards))
    blocks = [part for block in recipe.blocks(limit) for part in block if len(part.materials)]
    for block in blocks[number::shards]:
        if block.kind == Kind.POLYGON:
            writer.append_polygons(
                block.records, block.vertex_counts, names[block.materials], group=group
            )
        else:
            writer.append(block.kind, block.records, names[block.materials], group=group)
