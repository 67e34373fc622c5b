"""Queries that are broken off go on from their checkpoints: the same answers."""

from __future__ import annotations

import numpy as np
import pytest
from checkpoints import Killed, Stop, mostly_slow, spied, tight
from scenes import units

from bfrt.errors import SettingError

QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")
FEW = {"hits": 60, "queue": 50}

#: Of each form the refinement and how the memory is divided; then another memory.
FORMS = {
    "base": ("base", tight(), tight(voxels=4**3, rays=100, candidates=100)),
    "sg": ("sg", tight(), tight(rays=40, candidates=60)),
    "sgb": ("sgb", tight(), tight(voxels=4**3, rays=3000, candidates=9000)),
    "streamed": ("tree", tight(resident=False), tight(resident=True)),
    "resident": ("tree", tight(resident=True), tight(resident=False, rays=90, candidates=90)),
}


@pytest.fixture(scope="module")
def rays():
    rng = np.random.default_rng(9)
    origins = rng.uniform(-4, 4, (700, 3))
    directions = units(rng, 700) * rng.uniform(0.5, 2.0, (700, 1))
    directions[[5, 600]] = np.nan
    return origins, directions, rng.uniform(0.0, 0.4, 700), 6.0


@pytest.fixture(scope="module")
def expected(scenes, rays):
    return {
        (name, query): getattr(scene, query)(*rays)
        for name, scene in scenes.items()
        for query in QUERIES
    }


def same(answer, expected):
    assert answer.keys() == expected.keys()
    for key, values in expected.items():
        assert np.asarray(answer[key]).tobytes() == values.tobytes(), key
    assert answer.stats.bad_rays == expected.stats.bad_rays == 2
    assert answer.stats.total.rays == expected.stats.total.rays


def ways(form, scenes):
    refine, divided, other = FORMS[form]
    name = "tree" if refine == "tree" else "given"
    return refine, divided(scenes[name]), other(scenes[name]), name


@pytest.mark.parametrize("query", QUERIES)
@pytest.mark.parametrize("form", FORMS)
def test_a_kill_after_every_pass(scenes, rays, expected, tmp_path, form, query):
    refine, scene, _, name = ways(form, scenes)
    runs = 0
    while True:
        try:
            answer = getattr(scene, query)(
                *rays, out=tmp_path / "out", checkpoint=tmp_path / "kept", every=0, threads=2,
                refine=refine, progress=Stop(1),
            )  # fmt: skip
            break
        except Killed:
            runs += 1
            assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert runs >= 2
    same(answer, expected[name, query])
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("query", mostly_slow(QUERIES, ["cast_rays", "list_intersections"]))
@pytest.mark.parametrize("form", mostly_slow(FORMS, ["sgb", "streamed"]))
def test_other_memory_and_threads(scenes, rays, expected, tmp_path, form, query, monkeypatch):
    """Where rays in flight begin again, what they had crossed is not counted twice."""
    refine, scene, other, name = ways(form, scenes)
    again = spied(monkeypatch)
    number = 1
    while True:
        settings = {
            "out": tmp_path / f"out{number}", "checkpoint": tmp_path / "kept", "every": 0,
            "refine": refine,
        }  # fmt: skip
        stop = Stop(number)
        try:
            getattr(scene, query)(*rays, progress=stop, **settings)
            break
        except Killed:
            settings["every"] = 60.0
            same(getattr(other, query)(*rays, threads=2, **settings), expected[name, query])
        number += 1
    assert number > 2
    assert any(again) == (form != "resident")


def test_blocks_that_come_once_more(scenes, rays, expected, tmp_path):
    """An iterable is read again up to where the work was."""
    origins, directions, *_ = rays
    whole = scenes["given"].cast_rays(origins, directions)

    def blocks():
        for part in np.array_split(np.arange(700), 9):
            yield origins[part], directions[part]

    settings = {"out": tmp_path / "out", "checkpoint": tmp_path / "kept", "every": 0}
    scene = tight()(scenes["given"])
    with pytest.raises(Killed):
        scene.cast_rays(blocks(), progress=Stop(5), **settings)
    same(scene.cast_rays(blocks(), **settings), whole)


def test_other_rays_are_refused(scenes, rays, tmp_path):
    origins, directions, near, far = rays
    kept = tmp_path / "kept"
    settings = {"out": tmp_path / "out", "checkpoint": kept, "every": 0}
    scene = tight()(scenes["given"])
    with pytest.raises(Killed):
        scene.cast_rays(*rays, progress=Stop(9), **settings)
    moved = origins.copy()
    moved[3, 1] += 1e-12
    other = [(moved, directions, near, far), (origins, -directions, near, far),
             (origins, directions, near + 1e-9, far), (origins, directions, near, 5.0)]  # fmt: skip
    for given in other:
        with pytest.raises(SettingError, match=f"{kept}: found other rays among the"):
            scene.cast_rays(*given, **settings)
    with pytest.raises(SettingError, match=f"{kept}: found 2 rays, expected the"):
        scene.cast_rays(origins[:2], directions[:2], **settings)
    with pytest.raises(SettingError, match='with work "cast_rays", expected work "occluded"'):
        scene.occluded(*rays, **settings)
    scene.cast_rays(*rays, **settings)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("query", QUERIES)
def test_a_checkpoint_is_for_answers_in_a_folder(scenes, rays, tmp_path, query):
    for out in (None, {}):
        with pytest.raises(SettingError, match="checkpoint: found no folder for the answer"):
            getattr(scenes["given"], query)(*rays, checkpoint=tmp_path / "kept", out=out)
    assert list(tmp_path.iterdir()) == []


POINTS = {"visibility": {"rays": 5, "distance": 3.0}, "contains": {}}


@pytest.mark.parametrize("query", POINTS)
@pytest.mark.parametrize("form", FORMS)
def test_points_after_kills(scenes, rays, tmp_path, form, query):
    """What the rays of a point add up to is kept, and each of them counts once."""
    refine, scene, other, name = ways(form, scenes)
    points, asked = rays[0].copy(), POINTS[query]
    points[7] = np.nan
    whole = getattr(scenes[name], query)(points, **asked)
    assert len(np.unique(whole[next(iter(whole))])) > 2
    settings = {"checkpoint": tmp_path / "kept", "every": 0, "refine": refine, **asked}
    runs = 0
    while True:
        try:
            turn = (scene, other)[runs % 2]
            answer = getattr(turn, query)(
                points, out=tmp_path / "out", progress=Stop(2 + runs % 2), **settings
            )
            break
        except Killed:
            runs += 1
    assert runs >= 2
    for key, values in whole.items():
        assert np.asarray(answer[key]).tobytes() == values.tobytes()
    assert answer.stats.bad_rays == whole.stats.bad_rays
    assert answer.stats.unsure_points == whole.stats.unsure_points


def test_other_points_are_refused(scenes, rays, tmp_path):
    points, kept = rays[0], tmp_path / "kept"
    settings = {"out": tmp_path / "out", "checkpoint": kept, "every": 0}
    scene = tight()(scenes["given"])
    with pytest.raises(Killed):
        scene.visibility(points, rays=5, progress=Stop(9), **settings)
    for given in ({"rays": 6}, {"rays": 5, "distance": 2.0}, {"normals": -points, "rays": 5}):
        with pytest.raises(SettingError, match=f"{kept}: found other rays among the"):
            scene.visibility(points, **given, **settings)
    with pytest.raises(SettingError, match='with work "visibility", expected work "contains"'):
        scene.contains(points, **settings)
