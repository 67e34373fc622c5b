"""Pictures made where the shards are, without a cluster: the same bits in any order."""

from __future__ import annotations

import numpy as np
import pytest
from shading import LIT
from sharded_scenes import WAYS, assert_same_picture, both, store_of
from waves import render_here, wave_of

import bfrt
from bfrt.errors import Cancelled, StoreError
from bfrt.image.film import Film
from bfrt.image.film_parts import SUMS, FilmPart, add_part, film_of, part_of, seen_by
from bfrt.phases.settling import set_out, settle
from bfrt.records import HIT, NO_HIT, QUEUED, RayKind
from bfrt.shards.joining import join
from bfrt.wavefront import far_shading, ferry, frame
from bfrt.wavefront.far_shading import hits_at_once
from bfrt.wavefront.frame import ClientRoom

AOVS = ("position", "albedo")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Both forms of the scene, by order and number of shards, with the local picture."""
    made = {}

    def scene_of(way, shards):
        order = WAYS[way]
        if (order, shards) not in made:
            folder = tmp_path_factory.mktemp(f"{order}{shards}")
            scene = both(folder, shards, order)
            settings = {"refine": way, "memory": "160MiB", "threads": 1}
            made[order, shards] = scene, scene.one.render(aovs=AOVS, **settings)
        return made[order, shards]

    return scene_of


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(ferry, "BLOCK", 300)
    monkeypatch.setattr(frame, "BLOCK", 300)
    monkeypatch.setattr(far_shading, "BLOCK", 300)


def assert_same(found, expected):
    assert_same_picture(found, expected)
    assert found.stats.total.rays == expected.stats.total.rays
    for mine, theirs in zip(found.stats.depths, expected.stats.depths, strict=True):
        assert mine.rays == theirs.rays


@pytest.mark.parametrize("shards", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("way", [pytest.param("base", marks=pytest.mark.slow), "sgb", "tree"])
def test_one_carrier_a_shard(scenes, way, shards):
    scene, expected = scenes(way, shards)
    wave = wave_of(scene.sharded, [[n] for n in range(shards)], way)
    found = render_here(wave, seed=shards, aovs=AOVS)
    assert_same(found, expected)
    rays = found.stats.total.rays
    assert rays.reflection and rays.refraction and rays.shadow


@pytest.mark.parametrize("parts", [[range(8)], [[0, 3, 5], [1, 2, 4, 6, 7]]])
def test_carriers_with_several_shards(scenes, parts):
    scene, expected = scenes("sgb", 8)
    assert_same(render_here(wave_of(scene.sharded, parts, "sgb"), aovs=AOVS), expected)


def test_any_order_of_arrival(scenes):
    """Who comes when differs from seed to seed; what it travels for does not."""
    scene, expected = scenes("tree", 5)
    wave = wave_of(scene.sharded, [[n] for n in range(5)], "tree")
    pictures = [render_here(wave, seed=seed, aovs=AOVS) for seed in range(3)]
    for found in pictures:
        assert_same(found, expected)
    sent = [[depth.tracing.rays for depth in found.stats.travel] for found in pictures]
    assert all(each == sent[0] for each in sent)
    legs = {tuple(depth.tracing.legs for depth in found.stats.travel) for found in pictures}
    assert len(legs) > 1


@pytest.mark.parametrize("samples", [1, 3])
def test_samples_of_a_pixel(scenes, samples):
    scene, _ = scenes("sgb", 3)
    expected = scene.one.render(samples=samples, depth=2, memory="160MiB", aovs=AOVS)
    wave = wave_of(scene.sharded, [[0], [1, 2]], None)
    assert_same(render_here(wave, samples=samples, depth=2, aovs=AOVS), expected)


@pytest.mark.parametrize("light", [LIT, {"ao": 3}], ids=["of all kinds", "as it is"])
@pytest.mark.parametrize("way", [pytest.param("base", marks=pytest.mark.slow), "sgb", "tree"])
def test_light_that_is_asked_for(scenes, way, light):
    """The rays of ambient occlusion are those of the frame's elements, whoever shades a hit."""
    scene, _ = scenes(way, 5)
    expected = scene.one.render(refine=way, memory="160MiB", threads=1, samples=2, **light)
    for parts in ([[0], [1], [2], [3], [4]], [[0, 3], [1, 2, 4]]):
        found = render_here(wave_of(scene.sharded, parts, way), samples=2, **light)
        assert_same(found, expected)
    assert found.metadata == {**expected.metadata, "scene": "scene", "checksum": checksum(scene)}
    assert expected.metadata["ao"] == str(light["ao"])


def checksum(scene):
    return f"{scene.sharded.store.checksum:08x}"


def test_a_frame_that_memory_does_not_hold(scenes, monkeypatch):
    """Bands of rows, with the picture on disk, hits and rays too, and one block at a time."""
    scene, expected = scenes("sgb", 5)
    monkeypatch.setattr(frame, "default_memory", lambda: frame.BASELINE)
    monkeypatch.setattr(frame, "FEWEST_RAYS", 100)
    told = []
    wave = wave_of(scene.sharded, [[0, 1], [2, 3, 4]], "sgb")
    found = render_here(wave, report=told.append, aovs=AOVS)
    assert_same_picture(found, expected)
    assert found.stats.total.rays == expected.stats.total.rays
    assert isinstance(found.channels["Z"], np.memmap)
    assert {p.bands for p in told} == {10}  # 30 rows of 40 pixels, 100 at the least
    assert found.stats.total.phases.shading.bytes_written > 0


def test_what_the_clients_memory_holds():
    size = bfrt.image.frame.FrameSize(1000, 1000, 1)
    plenty = ClientRoom.of(size, 64 << 30, 4)
    assert plenty.render.rows == 1000 and not plenty.render.frame_on_disk
    assert plenty.blocks == 9 and plenty.render.hits > 10**6
    little = ClientRoom.of(size, 128 << 20, 100)
    assert little.render.frame_on_disk and little.blocks == 1
    memory = little.render.hits * 280 + little.render.queue * 144 + little.blocks * 23 * 10**6
    assert memory < 128 << 20


def test_a_scene_without_lights_and_camera(tmp_path):
    """They are made from the bounds of all shards."""
    rng = np.random.default_rng(2)
    stores = []
    with bfrt.SceneWriter(tmp_path / "one.bfrt", dtype="float32", origin=(0, 0, 0)) as whole:
        for number in range(3):
            centers = rng.uniform(-1, 1, (40, 3)).astype("f4") + np.float32(3 * number)
            with bfrt.SceneWriter(
                tmp_path / f"{number}.bfrt", dtype="float32", origin=(0, 0, 0)
            ) as part:
                part.spheres(centers, 0.3)
            whole.spheres(centers, 0.3, group=number)
            stores.append(bfrt.open(tmp_path / f"{number}.bfrt").store)
    join(tmp_path / "scene.bfrts", stores)
    sharded = bfrt.open(tmp_path / "scene.bfrts")
    camera = sharded.framing_camera(resolution=(30, 20))
    expected = bfrt.open(tmp_path / "one.bfrt").render(camera=camera, memory="160MiB")
    wave = wave_of(sharded, [[0], [1], [2]], "sgb")
    found = render_here(wave, camera=camera)
    assert_same(found, expected)
    assert len(np.unique(found.channels["id.hi"])) == 4  # of three groups, and none


def test_coincident_objects_are_seen_once(tmp_path):
    """The same group in each shard: of all hits at one t the least id counts."""
    stores = [store_of(tmp_path / f"{n}.bfrt", [4]).store for n in range(3)]
    join(tmp_path / "scene.bfrts", stores)
    sharded = bfrt.open(tmp_path / "scene.bfrts")
    expected = sharded.render(memory="160MiB", threads=1)
    for seed in range(3):
        found = render_here(wave_of(sharded, [[0], [1], [2]], "sgb"), seed=seed)
        assert_same(found, expected)
    hit = found.channels["Z"] < np.inf
    assert hit.sum() > 50
    assert (found.channels["id.hi"][hit] >> 20 == 0).all()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # NumPy's, of a view that is no view
def test_bad_rays_see_the_background(tmp_path):
    """An eye so far away that directions vanish: rays are counted once, and go nowhere."""
    scene = both(tmp_path, 2)
    camera = bfrt.Camera((1e300, 1e300, 1e300), (0, 0, 0), (0, 1, 0), resolution=(6, 4))
    expected = scene.one.render(camera=camera, memory="160MiB", threads=1)
    found = render_here(wave_of(scene.sharded, [[0], [1]], "sgb"), camera=camera)
    assert_same(found, expected)
    assert found.stats.bad_rays == expected.stats.bad_rays == 7 * 5


def test_a_report_cancels(scenes):
    scene, _ = scenes("sgb", 2)
    wave = wave_of(scene.sharded, [[0], [1]], "sgb")
    with pytest.raises(Cancelled, match="at depth 2, with"):
        render_here(wave, report=lambda p: p.depth < 2 or p.done < 10)


def test_a_shard_that_goes_meanwhile(tmp_path):
    scene = both(tmp_path, 2)

    def replace(progress):
        if (progress.depth, progress.done) == (2, 0):
            store_of(tmp_path / "part1.bfrt", [6])

    wave = wave_of(scene.sharded, [[0], [1]], "sgb")
    with pytest.raises(StoreError, match=r"^process \d+: .*part1\.bfrt: the store was replaced"):
        render_here(wave, report=replace)


def test_rays_set_out_and_are_settled():
    queued = np.zeros(4, QUEUED)
    queued["dx"] = 1.0
    queued["dx"][2] = np.nan
    queued["kind"] = [RayKind.EYE, RayKind.SHADOW, RayKind.EYE, RayKind.REFLECTION]
    queued["pixel"], queued["red"] = [0, 1, 2, 1], 0.5
    rays = np.empty(4, HIT)
    assert set_out(queued, rays) == 1
    assert rays["t"].tolist() == [np.inf, 1 - 2.0**-30, -1.0, np.inf]
    assert (rays["id"] == NO_HIT).all()
    for name in QUEUED.names:
        np.testing.assert_array_equal(rays[name], queued[name])
    film = Film(3, 1, 1)
    rays["id"][3] = 7
    assert settle(rays, film, np.array([0.5, 0.0, 0.0])) == (1, 0)
    assert rays["id"][0] == 7
    sums = film.planes()[0][0] / 2.0**32
    assert sums[:, 0].tolist() == [0.25, 0.5, 0.25]  # the background, a light, the background
    rays["kind"][0], rays["id"][:2] = RayKind.SHADOW, 3
    rays["kind"][1] = RayKind.EYE
    assert settle(rays[:2], film, np.zeros(3)) == (1, 1)


def test_parts_of_a_film_add_up_saturating():
    most = np.iinfo(np.int64).max
    film = Film(4, 3, 1, 2, AOVS)
    film.begin_at(1)
    sums = np.zeros(2, SUMS)
    sums["element"], sums["sums"] = [4, 9], [[1, 2, 3, 4], [most - 1, most, 5, 0]]
    seen = np.zeros(1, seen_by(AOVS))
    seen["element"], seen["id"], seen["albedo"] = 9, 11, 0.5
    for _ in range(2):
        add_part(film, FilmPart(sums, seen))
    (found, _), _, (ids, _), (positions, _), (albedos, _) = film.planes()
    assert found[0].tolist() == [2, 4, 6, 8]
    assert found[5].tolist() == [most, most, 10, 0]
    assert ids.tolist() == [NO_HIT] * 5 + [11] + [NO_HIT] * 2
    assert albedos[5].tolist() == [0.5] * 3 and positions[5].tolist() == [0.0] * 3


def test_only_what_is_touched_is_a_part():
    elements = np.array([7, 8, 90], np.uint32)
    film = film_of(elements, ("albedo",))
    film.planes()[0][0][1] = 5
    part = part_of(film, elements, np.array([False, False, True]), ("albedo",))
    assert part.sums["element"].tolist() == [8] and part.seen["element"].tolist() == [90]
    assert part.seen.dtype.names == ("element", "depth_normal", "id", "albedo")


def test_a_block_of_hits_sends_no_more_rays_than_two_blocks():
    assert [hits_at_once(n) for n in (0, 1, 2, 8, 10**6)] == [300, 200, 150, 60, 1]
