"""The seven scenes are the SPD package's: objects, order, counts, and the rays they send."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from spd_scenes import SHARED, Recorder, joined, text_of

import bfrt
from bfrt.errors import SettingError
from bfrt.records import Kind

#: Sizes that make every part of a scene and finish soon.
SMALL = {"balls": 3, "gears": 3, "mount": 5, "rings": 4, "teapot": 5, "tetra": 5, "tree": 7}

#: Objects of the sizes that the paper measured (its tables 1 and 3).
PAPER = [
    *(("balls", n, c) for n, c in ((6, 597872), (7, 5380841), (8, 48427562))),
    *(("gears", n, c) for n, c in ((18, 851473), (49, 17176755), (61, 33139227), (69, 47962315))),
    *(("mount", n, c) for n, c in ((9, 524292), (10, 2097156), (11, 8388612), (12, 33554436))),
    *(("rings", n, c) for n, c in ((36, 972361), (94, 16877701), (118, 33279541))),
    *(("rings", n, c) for n, c in ((135, 49755601), (368, 1000787041))),
    *(("teapot", n, c) for n, c in ((124, 998448), (516, 17302512), (719, 33596713))),
    *(("teapot", n, c) for n, c in ((877, 49986369),)),
    *(("tetra", n, c) for n, c in ((9, 262144), (10, 1048576), (11, 4194304), (12, 16777216))),
    *(("tree", n, c) for n, c in ((17, 524287), (19, 2097151), (21, 8388607), (23, 33554431))),
    ("mount", 14, 536870916),
]

#: The package's ray counts for its default sizes: eye hits, reflected, refracted, shadow rays.
COUNTED = {
    "balls": (263169, 175095, 0, 954368),
    "gears": (245086, 304643, 207564, 2246955),
    "mount": (173125, 354769, 354769, 412922),
    "rings": (263169, 315236, 0, 1085002),
    "teapot": (161120, 225248, 0, 407656),
    "tetra": (49788, 0, 0, 46112),
    "tree": (169836, 0, 0, 1097419),
}

#: Bytes an object against the paper's, and what part of them is allowed: the size closest to ten
#: million objects that the paper has.
BYTES = {
    "balls": (7, 251, 0.45),
    "gears": (49, 2167, 0.80),
    "mount": (11, 776, 0.70),
    "rings": (94, 1499, 0.60),
    "teapot": (516, 2189, 0.80),
    "tetra": (12, 1552, 0.70),
    "tree": (21, 744, 0.60),
}


def written():
    """The files that the package wrote."""
    return sorted((SHARED / "spd").glob("*.nff"))


@pytest.mark.skipif(not written(), reason=f"{SHARED}/spd is not here: it is optional test data")
@pytest.mark.parametrize("path", written(), ids=lambda path: path.stem)
def test_text_is_the_packages(path):
    name, size, hashed = re.fullmatch(r"([a-z]+)(\d+)-?(\w*)", path.stem).groups()
    scene = bfrt.spd.scene(name, int(size), **({"hash": hashed} if hashed else {}))
    ours, theirs = text_of(scene).splitlines(), path.read_text().splitlines()
    assert len(ours) == len(theirs)
    for our, their in zip(ours, theirs, strict=True):
        assert len(our.split()) == len(their.split()), our
        for a, b in zip(our.split(), their.split(), strict=True):
            if a != b:
                assert math.isclose(float(a), float(b), rel_tol=2e-6, abs_tol=1e-12), (our, their)


@pytest.mark.parametrize(("name", "size", "objects"), PAPER)
def test_counts_of_the_paper(name, size, objects):
    assert bfrt.spd.scene(name, size).objects == objects


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_feeds_as_many_as_it_says(name):
    scene = bfrt.spd.scene(name, SMALL[name])
    recorder = Recorder()
    scene.feed(recorder)
    fed = {kind: len(recorder.all(kind)[1]) for kind in recorder.records}
    assert fed == scene.counts
    assert sum(recorder.counts) == scene.vertices
    assert recorder.calls == [scene.camera, *scene.lights, scene.background]


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
@pytest.mark.parametrize("limit", [1, 100, 1000])
def test_block_size_changes_nothing(name, limit):
    scene = bfrt.spd.scene(name, SMALL[name])
    for kind in scene.counts:
        whole = joined(scene.blocks(1 << 30), kind)
        for a, b in zip(joined(scene.blocks(limit), kind), whole, strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_a_block_is_no_larger_than_it_may_be(name):
    scene = bfrt.spd.scene(name, SMALL[name])
    least = {"gears": 146, "rings": 60, "tetra": 4}.get(name, 2 * scene.size)
    for block in scene.blocks(300):
        places = np.concatenate([part.places for part in block])
        assert len(places) <= max(300, least)
        np.testing.assert_array_equal(np.sort(places), np.arange(len(places)))


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_float32_is_the_float64_rounded(name):
    scene = bfrt.spd.scene(name, SMALL[name])
    for kind in scene.counts:
        narrow, wide = (joined(scene.blocks(dtype=d), kind)[0] for d in (np.float32, np.float64))
        assert narrow.dtype == np.float32
        assert narrow.tobytes() == wide.astype(np.float32).tobytes()


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_store_takes_what_was_said(name, tmp_path):
    scene = bfrt.spd.scene(name, SMALL[name])
    store = scene.write(tmp_path / "s.bfrt").store
    store.verify()
    assert store.objects == scene.objects
    assert sum(s.degenerate for s in store.streams) == 0
    files = [f for f in (tmp_path / "s.bfrt").rglob("*") if f.is_file()]
    on_disk = sum(
        f.stat().st_size for f in files if not re.match("scene|made|level|quantised", f.name)
    )
    assert 0 <= scene.store_bytes - on_disk <= scene.objects + 32 * len(scene.materials)


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_bytes_an_object(name):
    size, megabytes, part = BYTES[name]
    scene = bfrt.spd.scene(name, size)
    assert scene.store_bytes <= part * megabytes * 2**20


@pytest.mark.parametrize("name", bfrt.spd.NAMES)
def test_rays_are_the_packages(name, tmp_path):
    scene = bfrt.spd.scene(name, bfrt.spd.DEFAULT_SIZES[name])
    scene.write(tmp_path / "s.bfrt")
    rays = bfrt.render(tmp_path / "s.bfrt", memory="256MiB").stats.total.rays
    eye_hits, *others = COUNTED[name]
    assert rays.eye_hits == pytest.approx(eye_hits, rel=0.01)
    assert [rays.reflection, rays.refraction, rays.shadow] == pytest.approx(others, rel=0.12)


def test_a_mountain_is_one_surface():
    """Squares that are made by themselves meet: every inner edge belongs to two triangles."""
    scene = bfrt.spd.mount(5, "jenkins")
    triangles = joined(scene.blocks(40), Kind.TRIANGLE)[0].reshape(-1, 3, 3)
    points, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    assert len(points) == 33 * 33
    edges = index.reshape(-1, 3)[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, uses = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert np.bincount(uses).tolist() == [0, 4 * 32, len(uses) - 4 * 32]


def test_the_first_hash_leaves_nothing_of_shifts_below_nothing():
    scene = bfrt.spd.mount(16)  # shifts of 7, -1 and -9
    first = next(block for block in scene.blocks(2) if block[0].kind is Kind.TRIANGLE)
    assert np.isfinite(first[0].records).all()


def test_teapot_normals_are_unit():
    records = joined(bfrt.spd.teapot(9).blocks(), Kind.PATCH)[0]
    normals = np.linalg.norm(records[:, 9:].reshape(-1, 3), axis=1)
    np.testing.assert_allclose(normals, 1.0, rtol=1e-12)


def test_gears_alternate_and_interlock():
    vertices, _, counts, _ = joined(bfrt.spd.gears(2).blocks(), Kind.POLYGON)
    assert counts[0] == 4 and (counts[1:].reshape(8, 146) == [144, *[4] * 144, 144]).all()
    edges = vertices[4:].reshape(8, -1, 3)[:, :144]
    np.testing.assert_allclose(
        np.linalg.norm(edges[0] - edges[0].mean(0), axis=1).max(), 0.995 / 1.95, 1e-9
    )


def test_names_and_sizes():
    assert bfrt.spd.NAMES == ("balls", "gears", "mount", "rings", "teapot", "tetra", "tree")
    for name in bfrt.spd.NAMES:
        scene = bfrt.spd.scene(name, 3)
        assert repr(scene) == repr(getattr(bfrt.spd, name)(3))
        assert repr(scene) == f"<bfrt.spd.{name}(3), {scene.objects} objects>"
    assert set(bfrt.spd.DEFAULT_SIZES) == set(bfrt.spd.NAMES)


def test_unknown_name_lists_the_names():
    with pytest.raises(SettingError, match="found scene 'ring', expected one of balls, gears"):
        bfrt.spd.scene("ring", 3)


def test_options():
    assert bfrt.spd.scene("mount", 3, hash="jenkins").hash == "jenkins"
    with pytest.raises(SettingError, match="found hash 'md5', expected one of package, jenkins"):
        bfrt.spd.mount(3, "md5")
    with pytest.raises(SettingError, match="found option hash for rings, which has none"):
        bfrt.spd.scene("rings", 3, hash="jenkins")


@pytest.mark.parametrize("size", [0, -1])
def test_size_below_one(size):
    with pytest.raises(SettingError, match=f"found size {size}, expected 1 or more"):
        bfrt.spd.rings(size)


def test_size_that_is_no_integer():
    with pytest.raises(TypeError):
        bfrt.spd.rings(2.5)


def test_the_third_huge_scene_is_a_view_of_the_second():
    view = bfrt.spd.VIEWS["rings368m"]
    own = bfrt.spd.rings(368).camera
    assert (view.eye, view.at, view.up, view.angle) == (own.eye, own.at, own.up, 1.5)
