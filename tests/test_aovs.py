"""Channels on request: position and albedo of what each pixel's first sample meets."""

from __future__ import annotations

import numpy as np
import OpenEXR
import pytest

import bfrt
from bfrt.cli import main
from bfrt.ids import stream_number, stream_of
from bfrt.image.film import Film
from bfrt.phases.eye import EyeRays, view_vectors
from bfrt.records import INDEX_BITS, NO_HIT, ON_REQUEST, Kind
from bfrt.reference import exhaustive

ALWAYS = {"R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "id.lo", "id.hi"}
CHANNELS = {
    "position": {"P.X", "P.Y", "P.Z"},
    "albedo": {"albedo.R", "albedo.G", "albedo.B"},
}
BOTH = tuple(CHANNELS)

#: Materials by turns; their colors are no halves or quarters.
COLORS = np.array([(0.9, 0.1, 0.3), (0.2, 0.7, 1.0), (0.0, 1.5, 0.6)])
ORIGIN = (5e5, 4.5e6, 100.0)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """All kinds in two groups, on map coordinates, float64; each object's color by its index."""
    path = tmp_path_factory.mktemp("aovs") / "a.bfrt"
    rng = np.random.default_rng(4)

    def places(n):
        return rng.uniform(-2, 2, (n, 3)) + ORIGIN

    with bfrt.SceneWriter(path, origin=ORIGIN) as writer:
        writer.camera(bfrt.Camera(tuple(np.add(ORIGIN, (1, -7, 2))), ORIGIN, resolution=(60, 40)))
        writer.light(bfrt.Light(tuple(np.add(ORIGIN, (4, -5, 6)))))
        for k, color in enumerate(COLORS):
            glass = {"ks": 0.3, "transmittance": 0.4, "ior": 1.3} if k == 2 else {}
            writer.material(bfrt.Material(tuple(color), 0.8, **glass))
        turns = np.arange(60) % 3
        for group in range(2):
            writer.spheres(places(60), rng.uniform(0.1, 0.4, 60), turns, group=group)
            ends = places(60)
            writer.cones(ends, 0.1, ends + 0.5, 0.02, turns, group=group)
            corners = places(60)[:, None] + rng.uniform(-0.5, 0.5, (60, 3, 3))
            writer.triangles(corners, turns, group=group)
            writer.patches(corners + 0.3, rng.normal(size=(60, 3, 3)), turns, group=group)
            square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.2
            writer.polygons(
                (places(60)[:, None] + square).reshape(-1, 3), [4] * 60, turns, group=group
            )
    return bfrt.open(path)


def stacked(image, prefix, letters):
    return np.stack([image.channels[f"{prefix}.{letter}"] for letter in letters], axis=-1)


def seen_by_the_reference(store, samples):
    """Position, color, depth and id of each pixel's first sample, (height, width, ...)."""
    rays = EyeRays(store, [store.camera], samples)
    rays = rays.read(len(rays))
    rays = rays[rays["sample"] == 0]
    origins, directions = (
        np.stack([rays[f"{which}{axis}"] for axis in "xyz"], axis=-1) for which in "od"
    )
    t, ids = exhaustive.nearest(store, origins, directions)
    hit = ids != NO_HIT
    place = np.full(origins.shape, np.inf)
    place[hit] = origins[hit] + t[hit, None] * directions[hit]
    x, y, z = (place - view_vectors(store.camera, store.origin)[0]).T
    color = np.zeros(origins.shape)
    index = ids[hit] & np.uint64((1 << INDEX_BITS) - 1)
    color[hit] = COLORS[(index % np.uint64(3)).astype(int)]
    width, height = store.camera.resolution
    across = width + (samples == 0)
    return (
        array.reshape(-1, across, *array.shape[1:])[:height, :width]
        for array in (
            (place + store.origin).astype(np.float32),
            color.astype(np.float32),
            np.sqrt(x * x + y * y + z * z).astype(np.float32),
            ids,
        )
    )


@pytest.mark.parametrize("samples", [None, 3], ids=["corners", "three samples"])
@pytest.mark.parametrize("refine", ["base", "sgb"])
def test_they_are_the_references(scene, samples, refine):
    image = bfrt.render(scene, samples=samples, refine=refine, memory="256MiB", aovs=BOTH)
    place, color, depth, ids = seen_by_the_reference(scene.store, samples or 0)
    streams = {stream_number(group, kind) for group in range(2) for kind in Kind}
    assert set(stream_of(np.unique(ids)).tolist()) == {*streams, NO_HIT >> INDEX_BITS}
    np.testing.assert_array_equal(image.ids, ids)
    np.testing.assert_array_equal(image.channels["Z"], depth)
    np.testing.assert_array_equal(stacked(image, "P", "XYZ"), place)
    np.testing.assert_array_equal(stacked(image, "albedo", "RGB"), color)


def test_a_miss_is_infinitely_far_and_has_no_color(scene):
    image = bfrt.render(scene, memory="256MiB", aovs=BOTH)
    miss = image.ids == NO_HIT
    assert 0.1 < miss.mean() < 0.9
    place, color = stacked(image, "P", "XYZ"), stacked(image, "albedo", "RGB")
    assert (place[miss] == np.inf).all() and (np.isinf(image.channels["Z"]) == miss).all()
    assert (color[miss] == 0).all()
    assert np.isfinite(place[~miss]).all() and color[~miss].any(axis=-1).all()


@pytest.mark.parametrize("asked", [(), ("position",), ("albedo",), BOTH, BOTH[::-1], BOTH * 2])
def test_the_image_has_what_is_asked_for_and_no_more(scene, asked):
    image = bfrt.render(scene, memory="256MiB", aovs=asked)
    assert set(image.channels) == ALWAYS.union(*(CHANNELS[name] for name in asked))
    everything = bfrt.render(scene, memory="256MiB", aovs=BOTH)
    for name, channel in image.channels.items():
        assert channel.dtype == (np.uint32 if name.startswith("id.") else np.float32)
        assert channel.tobytes() == everything.channels[name].tobytes(), name
    assert image.metadata == everything.metadata


def test_all_that_may_be_asked_for_has_channels_here():
    assert list(ON_REQUEST) == list(CHANNELS)


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize("asked", [(), ("position",), ("albedo",), BOTH])
def test_a_film_takes_the_bytes_that_a_budget_counts(asked, samples):
    film = Film(31, 50, samples, 7, asked)
    elements = (31 + (not samples)) * (7 + (not samples))
    each = 56 + sum(ON_REQUEST[name] for name in asked)
    assert sum(plane.nbytes for plane, _ in film.planes()) == elements * each
    image = film.rows(0, 7)
    assert sum(rows.nbytes for rows in image.values()) == 31 * 7 * (40 + 12 * len(asked))


@pytest.mark.parametrize("wrong", ["position", ("position", "shine"), [""], ("Z",), "P.X"], ids=str)
def test_what_cannot_be_asked_for(scene, wrong):
    with pytest.raises(
        bfrt.SettingError, match=r"aovs: found '.*', expected a sequence of position, albedo"
    ):
        bfrt.render(scene, aovs=wrong)


def test_the_command_writes_them(scene, tmp_path):
    output = tmp_path / "a.exr"
    command = ["render", str(scene.path), "--memory", "256MiB", "-o", str(output)]
    assert main([*command, "--half", "--aov", "albedo,position"]) == 0
    image = bfrt.render(scene, memory="256MiB", aovs=BOTH)
    with OpenEXR.File(str(output), separate_channels=True) as file:
        found = {name: channel.pixels.copy() for name, channel in file.channels().items()}
    assert set(found) == set(image.channels)
    for name in CHANNELS["position"] | CHANNELS["albedo"]:
        assert found[name].dtype == np.float32
        np.testing.assert_array_equal(found[name], image.channels[name])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "a.exr", "--aov", "colour"], "aovs: found 'colour', expected"),
        (["-o", "a.exr", "--aov", ""], "aovs: found '', expected"),
        (["-o", "a.png", "-o", "a.npy", "--aov", "albedo"], "--aov: found outputs a.png, a.npy, "),
    ],
)
def test_the_command_refuses_before_the_work(tmp_path, capsys, arguments, words):
    assert main(["render", str(tmp_path / "none.nff"), *arguments]) == 2
    assert words in capsys.readouterr().err
