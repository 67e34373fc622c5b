"""A plan against the render that it is of: what is exact, what is estimated, what is refused."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from injected import dividing

import bfrt
from bfrt.planning.grid import swept_of
from bfrt.planning.planned import ASSUMED
from bfrt.planning.planner import waves
from bfrt.records import Kind
from bfrt.settings import REFINEMENTS

TRACING = ("traversal", "intersection", "shading")


@pytest.fixture(scope="module")
def rings(tmp_path_factory):
    """8,401 spheres, cones and a ground, mirrors, three lights."""
    return bfrt.spd.rings(7).write(tmp_path_factory.mktemp("scenes") / "rings.bfrt")


@pytest.fixture(scope="module")
def glass(tmp_path_factory):
    """Mirrors and glass, two lights."""
    path = tmp_path_factory.mktemp("scenes") / "glass.bfrt"
    rng = np.random.default_rng(5)
    with bfrt.SceneWriter(path, order="given") as writer:
        writer.camera(bfrt.Camera((0, -6, 1), (0, 0, 0), resolution=(80, 60)))
        writer.light(bfrt.Light((4, -5, 6)))
        writer.light(bfrt.Light((-3, -4, 2)))
        mirror = writer.material(bfrt.Material((1, 1, 1), 0.2, 0.7, 30.0))
        clear = writer.material(bfrt.Material((0.8, 1, 1), 0.1, 0.1, 50.0, 0.8, 1.5))
        writer.spheres(rng.uniform(-2, 2, (900, 3)), rng.uniform(0.02, 0.2, 900), mirror)
        corners = rng.uniform(-2, 2, (700, 1, 3)) + rng.uniform(-0.2, 0.2, (700, 3, 3))
        writer.triangles(corners, clear)
    return bfrt.open(path)


def scene_of(name, request):
    return bfrt.open(request.getfixturevalue(name).path)


def passes_of(stats):
    """Those of the preprocess, and those of all depths."""
    tracing = sum(depth.passes for depth in stats.depths)
    return stats.total.passes - tracing, tracing


def both(scene, **settings):
    """A plan, and the render after it, with the bands it reported."""
    planned = scene.plan(**settings)
    told = []
    camera = settings.pop("camera", scene.camera)
    if "resolution" in settings:
        camera = replace(camera, resolution=settings.pop("resolution"))
    image = scene.render(camera=camera, progress=told.append, **settings)
    return planned, image, max(progress.bands for progress in told)


def exact(planned, image, bands):
    """Hold what is exact to what the render has done."""
    stats = image.stats
    assert planned.objects == stats.objects
    assert planned.scene_bytes == stats.scene_bytes
    assert {key: planned.settings[key] for key in stats.settings} == stats.settings
    assert planned.bands == bands
    assert planned.frame_on_disk == isinstance(image.channels["R"], np.memmap)
    assert planned.marks_reused == stats.marks_reused
    assert planned.rays.eye == stats.total.rays.eye
    assert planned.preprocess.passes == passes_of(stats)[0]
    for grid, facts in zip(planned.grids, stats.grids, strict=True):
        assert list(grid.voxels) == facts["voxels"]
        assert grid.lower == facts["lower"]
        if grid.slabs_known:
            assert grid.slabs == facts["slabs"]
        assert grid.slabs >= facts["slabs"]


def estimated(planned, stats):
    """Hold estimates to their bounds, and to a factor of what was counted."""
    rays, phases = stats.total.rays, stats.total.phases
    others = rays.reflection + rays.refraction + rays.shadow
    assert others / 2 <= planned.rays.others <= 2 * others
    assert others <= planned.rays.others_most
    tracing = planned.tracing
    passes = passes_of(stats)[1]
    assert passes / 3 <= tracing.passes <= 3 * passes
    read = sum(getattr(phases, name).bytes_read for name in TRACING)
    assert tracing.bytes_least <= read <= tracing.bytes_most
    assert tracing.bytes_least <= tracing.bytes_read <= tracing.bytes_most
    marking = planned.preprocess
    assert marking.bytes_least <= phases.preprocess.bytes_read <= marking.bytes_most
    assert sum(getattr(phases, name).bytes_written for name in TRACING) <= planned.spool_bytes
    assert planned.disk.spools <= planned.spool_bytes
    assert tracing.seconds > 0
    assert (marking.seconds > 0) == (not stats.marks_reused)


@pytest.mark.parametrize("refine", ["base", "sg", "sgb"])
@pytest.mark.parametrize("memory", ["80MiB", "256MiB"])
@pytest.mark.parametrize("name", ["rings", "glass"])
def test_a_plan_is_what_the_render_does(request, name, memory, refine):
    scene = scene_of(name, request)
    settings = {"memory": memory, "threads": 2, "refine": refine, "resolution": (200, 150)}
    planned, image, bands = both(scene, fresh_marks=True, **settings)
    assert not planned.marks_reused
    exact(planned, image, bands)
    estimated(planned, image.stats)
    again, image, bands = both(scene, **settings)
    assert again.marks_reused
    assert again.preprocess == replace(
        planned.preprocess, passes=0, bytes_least=0, bytes_read=0, bytes_most=0, seconds=0.0
    )
    exact(again, image, bands)
    estimated(again, image.stats)


@pytest.mark.slow
def test_a_frame_on_disk_and_its_bands(rings):
    scene = bfrt.open(rings.path)
    settings = {"memory": "72MiB", "threads": 1, "depth": 1, "resolution": (900, 700)}
    planned, image, bands = both(scene, **settings)
    assert bands > 1
    assert planned.frame_on_disk
    assert planned.disk.frame == sum(channel.nbytes for channel in image.channels.values())
    exact(planned, image, bands)
    estimated(planned, image.stats)
    planned, image, bands = both(scene, samples=3, aovs=["position", "albedo"], **settings)
    assert planned.disk.frame == sum(channel.nbytes for channel in image.channels.values())
    exact(planned, image, bands)


def test_slabs_subspaces_and_two_levels(glass):
    def tight(given):
        limits = given.limits._replace(slab=512 * 60, single=16**3)
        return replace(given, limits=limits, subspace=20_000, rays=3000, candidates=12_000)

    scene = dividing(glass, tight)
    settings = {"memory": "256MiB", "threads": 2, "grid": 50}
    planned, image, bands = both(scene, fresh_marks=True, **settings)
    (grid,) = planned.grids
    assert grid.lower > 1
    assert grid.blocks > 0
    assert grid.subspaces > 1
    assert grid.slabs > 1
    assert not grid.slabs_known
    exact(planned, image, bands)
    estimated(planned, image.stats)
    again, image, bands = both(scene, **settings)
    assert again.grids[0].slabs_known
    assert again.grids[0].marks_bytes == (scene.path / "0" / "marks").stat().st_size
    assert again.grids[0].marks_bytes <= grid.marks_bytes == planned.disk.marks
    exact(again, image, bands)
    estimated(again, image.stats)


def test_groups_have_a_grid_each(tmp_path):
    text = "v\nfrom 0 -5 0\nat 0 0 0\nup 0 0 1\nangle 45\nhither 1\nresolution 24 16\nl 3 -4 5\n"
    for name, place in (("a", 0.0), ("b", 1.0)):
        lines = [f"s {place + k / 40} {k % 7 / 9} {k % 5 / 9} 0.05" for k in range(200)]
        (tmp_path / f"{name}.nff").write_text(text + "\n".join(lines) + "\n")
    bfrt.convert([tmp_path / "a.nff", tmp_path / "b.nff"], tmp_path / "two.bfrt", order="given")
    scene = bfrt.open(tmp_path / "two.bfrt")
    for settings in ({}, {"max_grid": 5}):
        planned, image, bands = both(scene, memory="128MiB", **settings)
        assert len(planned.grids) == 2
        assert planned.rays.others_most == planned.rays.eye  # one light, no mirror
        exact(planned, image, bands)


def test_nothing_but_headers_is_read(rings, tmp_path):
    """All files of objects are gone, and the plan is what it was."""
    scene = bfrt.open(shutil.copytree(rings.path, tmp_path / "copy.bfrt"))
    scene.render(memory="128MiB", depth=1, threads=2)
    before = scene.plan(memory="128MiB", threads=2)
    for stream in scene.store.streams:
        shutil.rmtree(stream.folder)
    assert scene.plan(memory="128MiB", threads=2) == before
    assert before.marks_reused
    with pytest.raises(bfrt.StoreError):
        scene.render(memory="128MiB", threads=2)


def test_an_empty_scene_has_a_plan(tmp_path):
    with bfrt.SceneWriter(tmp_path / "empty.bfrt") as writer:
        writer.camera(bfrt.Camera((0, 0, 0), (0, 1, 0), resolution=(8, 4)))
    planned, image, bands = both(bfrt.open(tmp_path / "empty.bfrt"), memory="128MiB")
    exact(planned, image, bands)
    assert planned.tracing.bytes_least == 0


@pytest.mark.parametrize(
    "settings",
    [
        {"memory": "10MiB"},
        {"memory": "lots"},
        {"threads": 0},
        {"samples": -1},
        {"depth": 0},
        {"refine": "best"},
        {"aovs": ["Q"]},
        {"grid": 0},
        {"grid": 100_000},
        {"max_grid": 1.5},
        {"scratch": "/no/such/folder"},
    ],
)
def test_what_a_render_refuses_a_plan_refuses(glass, settings):
    refusals = []
    for ask in (bfrt.plan, bfrt.render):
        with pytest.raises((bfrt.BudgetError, bfrt.SettingError)) as refusal:
            ask(glass.path, **{"memory": "128MiB", **settings})
        refusals.append((refusal.type, str(refusal.value)))
    assert refusals[0] == refusals[1]


def test_a_scene_without_camera_and_lights_is_planned_as_it_is_framed_and_lit(tmp_path):
    with bfrt.SceneWriter(tmp_path / "cloud.bfrt") as writer:
        writer.spheres([[0, 0, 0], [1, 1, 1]], [1.0, 0.5])
    scene = bfrt.open(tmp_path / "cloud.bfrt")
    planned, image, bands = both(scene, memory="128MiB", threads=2)
    exact(planned, image, bands)
    assert planned.rays.others_most == 2 * planned.rays.eye  # the two lights that are added
    assert 0 < image.stats.total.rays.shadow <= planned.rays.others_most


@pytest.mark.parametrize("ao", [1, 6])
def test_rays_of_ambient_occlusion_are_planned(glass, tmp_path, ao):
    scene = bfrt.open(shutil.copytree(glass.path, tmp_path / "glass.bfrt"))
    light = {"ao": ao, "lights": [bfrt.Sun(200, 30)]}
    settings = {"memory": "80MiB", "threads": 2, "resolution": (200, 150), **light}
    planned, image, bands = both(scene, **settings)
    exact(planned, image, bands)
    estimated(planned, image.stats)
    without = scene.plan(**{**settings, "ao": 0})
    hits = (without.rays.others_most - planned.rays.others_most) / -ao
    assert hits == int(hits) >= planned.rays.eye
    assert f"a ray each corner, depth 5, ao {ao}" in str(planned) and "ao" not in str(without)
    assert planned.as_dict()["settings"]["ao"] == ao
    assert planned.spool_bytes > without.spool_bytes and planned.disk.spools > without.disk.spools
    assert ao * image.stats.total.rays.eye_hits < image.stats.total.rays.shadow


def test_a_view_is_checked(glass, tmp_path):
    with bfrt.SceneWriter(tmp_path / "empty.bfrt") as writer:
        writer.light(bfrt.Light((0, 0, 1)))
    with pytest.raises(bfrt.SettingError, match="found no camera"):
        bfrt.plan(tmp_path / "empty.bfrt")
    with pytest.raises(bfrt.SceneError, match="found resolution"):
        bfrt.plan(glass, resolution=(0, 10))


def test_damaged_marks_are_refused_as_by_a_render(rings, tmp_path):
    scene = bfrt.open(shutil.copytree(rings.path, tmp_path / "copy.bfrt"))
    scene.render(memory="128MiB", depth=1)
    marks = scene.path / "0" / "marks"
    marks.write_bytes(marks.read_bytes()[:-1])
    with pytest.raises(bfrt.StoreError, match="the marks are damaged"):
        scene.plan(memory="128MiB")
    assert not scene.plan(memory="128MiB", fresh_marks=True).marks_reused


def test_rounds_of_rays():
    """By hand: two rays go on from every hit, three lights, two hits deep."""
    first, second, third = waves(100, 2, hits=1.0, onward=2.0, shadows=3.0)
    assert first == (100, 0, 100)
    assert second == (200, 300, 200)
    assert third == (0, 600, 0)
    assert len(waves(100, 5, hits=1.0, onward=0.0, shadows=0.0)) == 1


def test_what_passes_read_is_all_there_is(rings):
    """Every file of a group is in one of the parts."""
    (group,) = rings.store.groups
    swept = swept_of(group, REFINEMENTS["sgb"])
    facts = [stream.files.get("quantised") for stream in group.streams]
    quantised = sum(f.bytes for f in facts if f is not None)
    files = sum(facts.bytes for stream in group.streams for facts in stream.files.values())
    assert swept.all - swept.coded + swept.boxes + swept.materials + quantised == files
    boxed = sum(stream.count for stream in group.streams if stream.kind != Kind.SPHERE)
    assert quantised == 6 * boxed and swept.boxes - swept.coded == 18 * boxed
    assert swept_of(group, REFINEMENTS["sg"]).coded == swept.boxes
    assert 0 < swept.top <= swept.levels
    assert swept_of(group, REFINEMENTS["sg"]).levels == 0
    assert swept_of(group, REFINEMENTS["base"]).top == 0


def test_a_plan_is_a_table_and_json(glass):
    planned = bfrt.plan(glass, memory="128MiB", threads=3, samples=4, fresh_marks=True)
    facts = json.loads(json.dumps(planned.as_dict()))
    assert facts["rays"]["eye"] == 80 * 60 * 4
    assert facts["assumptions"]["read_rate"] == ASSUMED.read_rate
    text = str(planned)
    for words in ("19,200", "3 threads, sgb", "80 x 60", "4 samples, depth 5", "to make"):
        assert words in text
    amounts, grids, phases, ordering, assumed = text.split("\n\n")
    for table in (amounts, grids, phases, ordering):
        assert len({len(line) for line in table.splitlines()}) == 1
    assert "estimates assume 1,000 MB/s" in assumed
    assert facts["ordering"]["disk"] == planned.ordering.disk > 0
    for words in ("spatial order", f"<= {planned.ordering.disk / 1e6:,.1f}", "to make"):
        assert words in ordering
    assert f"{ASSUMED.order_rate:,.0f} objects a second" in assumed
