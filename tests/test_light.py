"""Suns, ambient occlusion, the ambient light and the background, by what geometry says of them."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import shading
from shading import (
    INTENSITY,
    ball,
    corner_rays,
    dot,
    film,
    floor,
    meet_ball,
    meet_level,
    met,
    over,
    rendered,
    shade,
    square,
    toward,
    unit,
)

import bfrt
from bfrt import Camera, Light, Material, SceneError, Sun
from bfrt.ids import stream_of
from bfrt.phases.eye import EyeRays
from bfrt.records import NO_HIT, Kind
from bfrt.reference import exhaustive
from bfrt.reference.openness import openness, seeds_of

close = partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-9)

MATT = Material((0.75, 0.5, 0.25), 0.5)
WHITE = Material((1, 1, 1), 1.0)

#: Ambient light alone, of strength 1: what is white is as bright as it is open.
OPEN = {"lights": []}

SIZES = {"tiny": 1e-6, "one": 1.0, "huge": 1e6}

ABOVE = Camera((0, -6, 4), (0, 0, 0), angle=40, resolution=(24, 20))


@pytest.fixture
def written(tmp_path):
    """A scene of these things, without lights of its own."""

    def scene(things, **settings):
        return shading.written(tmp_path / "a.bfrt", things, [], **settings)

    return scene


# --- suns --------------------------------------------------------------------------------------

COMPASS = {0: (0, 1), 45: (0.5**0.5, 0.5**0.5), 90: (1, 0), 180: (0, -1), 270: (-1, 0), 360: (0, 1)}


@pytest.mark.parametrize("azimuth", COMPASS)
@pytest.mark.parametrize("elevation", [0, 30, 90, -90])
def test_azimuths_go_clockwise_from_north(azimuth, elevation):
    east, north = COMPASS[azimuth]
    level = math.cos(math.radians(elevation))
    expected = (level * east, level * north, math.sin(math.radians(elevation)))
    np.testing.assert_allclose(Sun(azimuth, elevation).direction, expected, atol=1e-15)


def test_quarters_of_a_circle_are_exact():
    assert Sun(90, 0).direction == (1, 0, 0) and Sun(-90, 0).direction == (-1, 0, 0)
    assert Sun(180, 0).direction == (0, -1, 0) and Sun(3600, 0).direction == (0, 1, 0)
    assert Sun(33, 90).direction == (0, 0, 1) and Sun(33, -90).direction == (0, 0, -1)


@pytest.mark.parametrize("elevation", [-20, 0, 1, 30, 60, 90])
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_a_plane_has_the_sine_of_the_elevation(written, elevation, size):
    """One value all over: a sun has no place."""
    sun = Sun(70, elevation, (1, 0.5, 0.25), 1.5)
    at = tuple(size * np.array(ABOVE.eye))
    image = rendered(written([floor(0, 50 * size, WHITE)]), replace(ABOVE, eye=at), lights=[sun])
    cosine = max(0.0, math.sin(math.radians(elevation)))
    close(image.rgb, np.broadcast_to(0.5 + 0.5 * 1.5 * cosine * np.array(sun.color), (20, 24, 3)))


@pytest.mark.parametrize("azimuth", range(0, 360, 40))
def test_a_ball_shows_where_the_sun_is(written, azimuth):
    glossy = MATT._replace(ks=0.5, shine=20.0)
    lights = [Sun(azimuth, 35, (1, 0.5, 2)), Light((3, -5, 4))]
    camera = replace(ABOVE, angle=20)
    scene = written([ball(1, glossy)])
    image = rendered(scene, camera, lights=lights, background=(0.25, 0, 1), depth=1)
    place = meet_ball(camera.eye, corner_rays(camera))
    seen = shade(camera.eye, place, place, glossy, lights)
    close(image.rgb, film(over(seen, met(place), (0.25, 0, 1))), atol=1e-7)
    facing = sum(
        (dot(place, way) > 0).sum() for way in (toward(lights[0]), lights[1].position - place)
    )
    assert image.stats.total.rays.shadow == facing


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("far", [0, 1e6], ids=["near", "far"])
@pytest.mark.parametrize("elevation", [0.01, 0.5, 5.0])
def test_a_low_sun_makes_no_spots(written, size, far, elevation):
    """Where it grazes a ball, and a plane under it, all that faces it is lit."""

    def moved(place):
        return size * (np.asarray(place, float) + far)

    sun = Sun(180, elevation, intensity=1e4)
    camera = Camera((0, -6, 3), (0, 0, 1), angle=20, resolution=(24, 24))
    there = replace(camera, eye=tuple(moved(camera.eye)), at=tuple(moved(camera.at)))
    things = [("spheres", moved([[0, 0, 1]]), [size], WHITE)]
    things.append(("polygons", moved(np.array(square(-5, 900))), [4], WHITE))
    image = rendered(written(things), there, lights=[sun])
    d, center = corner_rays(camera), (0, 0, 1)
    ball_at, floor_at = meet_ball(camera.eye, d, 1, center), meet_level(camera.eye, d, -5)
    clear = np.linalg.norm(np.cross(center - floor_at, toward(sun)), axis=-1) > 1
    seen = over(
        shade(camera.eye, ball_at, ball_at - center, WHITE, [sun]),
        met(ball_at),
        shade(camera.eye, floor_at, (0, 0, 1), WHITE, [sun], clear),
    )
    # n.l of 1e-4, of a place 1e6 times as far from the store's origin as the ball is large
    np.testing.assert_allclose(image.rgb, film(seen), rtol=2e-6, atol=1e-4 if far else 1e-5)


@pytest.mark.parametrize("height", [1.0, 3.0, 4000.0])
@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 90), (90, 30), (200, 75), (315, 10)])
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_the_shadow_of_a_ball_has_its_radius(written, height, azimuth, elevation, size):
    """However high it is: shadows of a sun have parallel edges, and no end."""
    sun = Sun(azimuth, elevation)
    way = toward(sun)
    foot = height * way[:2] / way[2]  # of the ball's middle, along the light, at the origin
    center = (*foot, height)
    camera = Camera((9, -20, 14), (0, 0, 0), angle=10, resolution=(48, 48))
    moved = replace(camera, eye=tuple(size * np.array(camera.eye)))
    things = [floor(0, size * 2e5, WHITE), ball(size, WHITE, size * np.array(center))]
    image = rendered(written(things), moved, lights=[sun])
    d = corner_rays(camera)
    place = meet_level(camera.eye, d, 0)
    to = center - place
    across = np.linalg.norm(np.cross(to, way), axis=-1)
    hidden = met(meet_ball(camera.eye, d, 1, center))
    assert hidden.mean() < 0.5
    dark = across < 1
    expected = np.where(dark, 0.5, 0.5 + 0.5 * way[2])
    # of a ball that is high up, float32 is not precise to the last pixel
    sure = ~hidden & (np.abs(across - 1) > (0.01 if height > 10 else 1e-4))
    assert (sure & dark).sum() > 20 and (sure & ~dark).sum() > 100
    found = image.rgb[..., 0]
    certain = film(sure[..., None])[..., 0] == 1
    close(found[certain], film(expected[..., None])[..., 0][certain])


@pytest.mark.parametrize("size", [1e120, 1e155, 1e200, 1.7e308])
@pytest.mark.parametrize("refine", ["sgb", "tree"])
def test_a_light_from_very_far_is_parallel(tmp_path, size, refine):
    """As a sun is: it lights, and shadows have their places."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt", order="spatial") as writer:
        writer.spheres([[0.0, 0, 1], [3, 0, 1]], [1.0, 0.5])
        writer.mesh([[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]], [[0, 1, 2]])
    settings = {"refine": refine, "memory": "160MiB", "ambient": 0.0}
    camera = bfrt.Camera((1, -9, 9), (1, 0, 0), resolution=(40, 30))
    scene = bfrt.open(tmp_path / "a.bfrt")
    lamp = bfrt.Light((size, 0.0, size))
    found = scene.render(camera=camera, lights=[lamp], **settings)
    sun = scene.render(camera=camera, lights=[bfrt.Sun(90.0, 45.0)], **settings)
    assert 0.1 < sun.rgb.mean() < 0.5
    assert np.mean(np.abs(found.rgb - sun.rgb) > 1e-5) < 2e-3


def test_suns_count_among_the_lights(written):
    scene = written([floor(0, 50, WHITE)])
    for count in (1, 2, 3, 4):
        image = rendered(scene, ABOVE, lights=[Sun(10, 90)] * count)
        close(image.rgb, np.full((20, 24, 3), INTENSITY[count] * (1 + count)))


def test_lights_replace_those_of_the_scene(tmp_path):
    scene = shading.written(tmp_path / "a.bfrt", [floor(0, 50, WHITE)], [Light((0, 0, 9))])
    alone = rendered(scene, ABOVE, lights=[Sun(0, 90)])
    assert (alone.rgb == 1).all()
    assert alone.metadata["lights"] == "sun 0 90 1 1 1"
    both = rendered(scene, ABOVE, lights=[*scene.lights, Sun(0, 90)])
    own = rendered(scene, ABOVE)
    as_it_is = rendered(scene, ABOVE, lights=scene.lights)
    assert (as_it_is.rgba == own.rgba).all() and as_it_is.metadata == own.metadata
    # two lights have 1/sqrt(2) of the intensity of one, each
    close(both.rgb, INTENSITY[2] * (2 * own.rgb + 1), rtol=1e-5)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ((math.nan, 0), "azimuth of a sun: found nan, expected a finite number"),
        ((math.inf, 0), "azimuth of a sun: found inf, expected a finite number"),
        (("north", 0), "azimuth of a sun: found 'north', expected a finite number"),
        ((10**400, 0), f"azimuth of a sun: found {str(10**400)[:80]}, expected a finite number"),
        ((1j, 0), "azimuth of a sun: found 1j, expected a finite number"),
        ((0, 91), "elevation of a sun: found 91, expected -90 to 90"),
        ((0, -90.5), "elevation of a sun: found -90.5, expected -90 to 90"),
        ((0, 45, (1, 1, 1), -1), "intensity of a sun: found -1, expected 0 or more"),
        ((0, 45, (1, 1)), "color of a sun: found (1, 1), expected three finite numbers"),
        ((0, 45, (1, 1, 1), True), "intensity of a sun: found True, expected a finite number"),
    ],
)
def test_what_is_no_sun(given, said):
    with pytest.raises(SceneError) as caught:
        Sun(*given)
    assert str(caught.value) == said


# --- the ambient light and the background ------------------------------------------------------


def test_the_ambient_light_scales_the_color(written):
    scene = written([floor(0, 50, MATT)])
    assert (rendered(scene, ABOVE, lights=[], ambient=0.5).rgb == (0.1875, 0.125, 0.0625)).all()
    assert (rendered(scene, ABOVE, lights=[]).rgb == (0.375, 0.25, 0.125)).all()
    assert (rendered(scene, ABOVE, lights=[], ambient=0).rgb == 0).all()
    lit = rendered(scene, ABOVE, lights=[Sun(0, 90)], ambient=2)
    assert (lit.rgb == np.multiply(2.5 * 0.5, MATT.color)).all()


def test_mirrors_show_the_background_that_is_asked_for(written):
    mirror = Material((1, 1, 1), 0, 0.5)
    scene = written([floor(0, 3, mirror)], background=(1, 0, 0))
    image = rendered(scene, replace(ABOVE, angle=80), background=(0, 0.5, 1), **OPEN)
    hit = image.channels["A"] == 1
    assert 0.1 < hit.mean() < 0.9
    assert (image.rgb[hit] == (0, 0.25, 0.5)).all()
    assert (image.rgb[image.channels["A"] == 0] == (0, 0.5, 1)).all()
    assert image.metadata["background"] == "0 0.5 1"


# --- ambient occlusion by formulas -------------------------------------------------------------


def brightness(scene, camera, rays, **settings):
    """How open the pixels are, (height, width), of a white scene."""
    return rendered(scene, camera, ao=rays, **{**OPEN, **settings}).rgb[..., 0]


def agree(found, expected, rays):
    """Within the error of independent rays: each pixel within 5 sigma, the mean within 4."""
    sigma = np.sqrt(np.maximum(expected * (1 - expected), 1 / rays) / rays)
    assert (np.abs(found - expected) < 5 * sigma).all()
    assert abs((found - expected).mean()) < 4 * math.sqrt((sigma**2).mean() / expected.size)


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_a_ball_above_a_plane_hides_its_form_factor(written, size):
    """(r / D)^2 cos, with D to the middle and the angle there from the normal."""
    center, radius = np.array((0.5, 1.0, 1.5)), 1.2
    things = [floor(0, 5e3 * size, WHITE), ball(radius * size, WHITE, size * center)]
    camera = Camera((0, -6, 4), (0, -0.5, 0), angle=30, resolution=(24, 20))
    moved = replace(camera, eye=tuple(size * np.array(camera.eye)), at=(0, -0.5 * size, 0))
    found = brightness(written(things), moved, 900)
    d = corner_rays(camera)
    place = meet_level(camera.eye, d, 0)
    to = center - place
    distance = np.linalg.norm(to, axis=-1)
    hidden = met(meet_ball(camera.eye, d, radius, center))
    sure = film(~hidden[..., None])[..., 0] == 1
    expected = film((1 - radius**2 * to[..., 2] / distance**3)[..., None])[..., 0]
    assert sure.sum() > 250 and np.ptp(expected[sure]) > 0.3
    agree(found[sure], expected[sure], 4 * 900)


@pytest.mark.parametrize("distance", [None, math.inf, 3.0, 1.5, 1.0])
@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_a_corner(written, size, distance):
    """Directions, put down on the plane, fill a disk; those that meet the wall in time a segment of
    it, from x / D on. So half of all is open at the wall, if rays go on for ever."""
    wall = np.array([[2, -5e4, -5e4], [2, 5e4, -5e4], [2, 5e4, 5e4], [2, -5e4, 5e4]])
    things = [floor(0, 5e4 * size, WHITE), ("polygons", wall * size, [4], WHITE)]
    camera = Camera((0, -3, 5), (0.8, 0, 0), angle=14, resolution=(20, 16))
    moved = replace(
        camera, eye=tuple(size * np.array(camera.eye)), at=tuple(size * np.array(camera.at))
    )
    ends = {} if distance is None else {"ao_distance": distance * size}
    found = brightness(written(things), moved, 900, **ends)
    place = meet_level(camera.eye, corner_rays(camera), 0)
    assert (place[..., 0] < 2).all()
    c = np.minimum((2 - place[..., 0]) / (distance or math.inf), 1)
    shut = (np.arccos(c) - c * np.sqrt(1 - c * c)) / math.pi
    agree(found, film((1 - shut)[..., None])[..., 0], 4 * 900)
    if distance == 1.0:
        assert (found == 1).any() and (found < 0.9).any()


CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
LEANING = unit([[-1, -1, 2], [1, -1, 2], [1, 1, 2]])

#: Surfaces that hide nothing of themselves, moved and scaled.
CONVEX = {
    "ball": lambda moved, size: ("spheres", moved([[0, 0, 0]]), [size]),
    "cone": lambda moved, size: (
        "cones", moved([[0, 0, -1.5]]), [size], moved([[0, 0, 1]]), [0],
    ),
    "triangle": lambda moved, size: ("triangles", moved(CORNERS[None, :3])),
    "polygon": lambda moved, size: ("polygons", moved(CORNERS), [4]),
    "patch": lambda moved, size: ("patches", moved(CORNERS[None, :3]), LEANING[None]),
}  # fmt: skip


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("far", [0, 1e6], ids=["near", "far"])
@pytest.mark.parametrize("name", CONVEX)
def test_what_is_convex_is_open_all_over(written, name, size, far):
    """No surface hides itself: not where it curves, nor where normals lean, nor where it is far."""

    def moved(place):
        return size * (np.asarray(place, float) + far)

    camera = Camera((0.3, -4, 2), (0, 0, 0), angle=25, resolution=(24, 24))
    there = replace(camera, eye=tuple(moved(camera.eye)), at=tuple(moved(camera.at)))
    scene = written([(*CONVEX[name](moved, size), WHITE)])
    image = rendered(scene, there, ao=16, samples=1, **OPEN)
    hit = image.channels["A"] == 1
    assert hit.sum() > 50
    assert image.stats.total.rays.shadow == 16 * image.stats.total.rays.eye_hits
    close(image.rgb[hit], 1)
    assert (image.rgb[~hit] == 0).all()


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("far", [0, 1e6], ids=["near", "far"])
def test_no_light_comes_into_what_is_shut(written, size, far):
    """A ball, and a box of six squares: not through edges or corners either."""
    camera = Camera((0.1, 0.2, 0.3), (1, 2, 3), angle=150, resolution=(16, 16))

    def moved(place):
        return size * (np.asarray(place, float) + far)

    there = replace(camera, eye=tuple(moved(camera.eye)), at=tuple(moved(camera.at)))
    faces = [np.roll(square(z, 1), k, axis=1) for z in (-1, 1) for k in range(3)]
    box = ("polygons", moved(np.concatenate(faces)), [4] * 6, WHITE)
    for thing in (box, ("spheres", moved([[0, 0, 0]]), [size], WHITE)):
        image = rendered(written([thing]), there, ao=64, **OPEN)
        assert (image.channels["A"] == 1).all()
        assert (image.rgb == 0).all()


# --- ambient occlusion by brute force ----------------------------------------------------------


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """Balls in a bowl of squares, some of them mirrors."""
    rng = np.random.default_rng(3)
    glossy = MATT._replace(ks=0.25)
    things = [floor(-1, 6, MATT)]
    for material in (MATT, glossy):
        centers, radii = rng.uniform(-2, 2, (25, 3)), rng.uniform(0.2, 0.7, 25)
        things.append(("spheres", centers, radii, material))
    path = tmp_path_factory.mktemp("light") / "crowd.bfrt"
    return shading.written(path, things, [], dtype="float64", origin=(0, 0, 0)), things


def nearest_hits(scene, camera, samples):
    """Eye rays, and where they meet what: places, normals to the eye, ids."""
    rays = EyeRays(scene.store, [camera], samples)
    rays = rays.read(len(rays))
    o, d = (np.stack([rays[f"{which}{axis}"] for axis in "xyz"], axis=-1) for which in "od")
    t, ids = exhaustive.nearest(scene.store, o, d)
    hit = ids != NO_HIT
    return rays[hit], o[hit] + t[hit, None] * d[hit], ids[hit]


def normals_at(things, place, ids):
    """Of balls, outwards, and of the floor, up; and the material's ks."""
    index = (ids & np.uint64((1 << 48) - 1)).astype(int)
    centers = np.concatenate([thing[1] for thing in things[1:]])
    is_ball = stream_of(ids) == Kind.SPHERE  # of group 0
    normal = np.where(is_ball[:, None], unit(place - centers[index % len(centers)]), (0, 0, 1.0))
    return normal, np.where(is_ball & (index >= 25), 0.25, 0.0)


@pytest.mark.parametrize("distance", [None, 0.8])
@pytest.mark.parametrize("samples", [1, 3])
@pytest.mark.parametrize("rays", [1, 7, 32])
def test_each_ray_is_that_of_the_reference(crowd, rays, samples, distance):
    """But for one in a thousand that passes an edge by a rounding's width."""
    scene, things = crowd
    camera = Camera((0, -7, 3), (0, 0, 0), angle=50, resolution=(20, 16))
    image = rendered(scene, camera, ao=rays, ao_distance=distance, samples=samples, depth=1, **OPEN)
    hits, place, ids = nearest_hits(scene, camera, samples)
    normal, _ = normals_at(things, place, ids)
    seeds = seeds_of(hits["pixel"], hits["sample"])
    above = place + 1e-10 * normal
    part = openness(scene.store, above, normal, seeds, rays, distance or np.inf)
    summed = np.bincount(hits["pixel"], part, 20 * 16).reshape(16, 20, 1) / samples
    expected = summed * (0.5 * np.array(MATT.color))
    same = np.isclose(image.rgb, expected, rtol=1e-6, atol=1e-7)
    assert same.mean() > 0.995 and 0.05 < part.mean() < 0.98
    assert image.stats.total.rays.shadow == rays * len(hits)


def test_other_random_rays_say_the_same(crowd):
    """NumPy's own generator, and directions that a ball of chance is added to the normal for."""
    scene, things = crowd
    camera = Camera((0, -7, 3), (0, 0, 0), angle=50, resolution=(12, 10))
    image = rendered(scene, camera, ao=512, samples=1, depth=1, **OPEN)
    hits, place, ids = nearest_hits(scene, camera, 1)
    normal, _ = normals_at(things, place, ids)
    rng = np.random.default_rng(8)
    ways = unit(normal[:, None] + unit(rng.normal(size=(len(hits), 512, 3))))
    start = np.repeat(place + 1e-10 * normal, 512, axis=0)
    dark = exhaustive.occluded(scene.store, start, ways.reshape(-1, 3)).reshape(-1, 512)
    expected = np.zeros(120)
    expected[hits["pixel"]] = 1 - dark.mean(axis=1)
    hit = (image.channels["A"] == 1).ravel()
    found = (image.rgb[..., 0] / (0.5 * MATT.color[0])).ravel()
    agree(found[hit], expected[hit], 256)  # both are estimates


def test_neighbors_do_not_share_their_rays(crowd):
    """The error of a mean over pixels goes down with their number, as chance has it."""
    scene, _ = crowd
    camera = Camera((0, -0.5, 5.9), (0.5, 0.5, -1), angle=8, resolution=(40, 40))
    few = rendered(scene, camera, ao=4, samples=1, depth=1, **OPEN).rgb[..., 0]
    many = rendered(scene, camera, ao=256, samples=1, depth=1, **OPEN).rgb[..., 0]
    error = (few - many) / (0.5 * MATT.color[0])
    assert error.std() > 0.02
    blocks = error.reshape(10, 4, 10, 4).mean(axis=(1, 3))
    assert blocks.std() < 2 * error.std() / 4


@pytest.mark.parametrize(
    ("ks", "rays", "each"),
    [(0.25, 16, 4), (0.1, 20, 2), (0.1, 3, 1), (0.3, 9, 3), (0.7, 64, 45), (1.5, 8, 8)],
)
def test_what_a_mirror_shows_sends_its_part_of_the_rays(written, ks, rays, each):
    """Rounded up, and no more than an eye hit does."""
    mirror = Material((1, 1, 1), 0, ks)
    camera = Camera((0, -4, 2), (0, 0, 1), angle=30, resolution=(16, 12))
    wall = np.array([[-90, 3, -1], [90, 3, -1], [90, 3, 70], [-90, 3, 70]])
    roof = np.array([[-90, -90, 60], [90, -90, 60], [90, 90, 60], [-90, 90, 60]])
    scene = written(
        [floor(0, 50, mirror), ("polygons", wall, [4], WHITE), ("polygons", roof, [4], MATT)]
    )
    image = rendered(scene, camera, ao=rays, **OPEN)
    d = corner_rays(camera)
    down = met(meet_level(camera.eye, d, 0)) & (image_ids_of(scene, camera) == 0)
    sent = image.stats.depths[0].rays
    assert (
        sent.shadow == rays * (~down).sum()
    )  # mirrors without kd have no ambient light to ask for
    shown = image.stats.depths[1].rays
    assert sent.reflection == down.sum() > 20
    assert shown.shadow == each * down.sum()  # the wall and the roof are all around


def image_ids_of(scene, camera):
    """The index of the object that each corner's ray meets; -1 for none."""
    rays = EyeRays(scene.store, [camera], 0)
    rays = rays.read(len(rays))
    o, d = (np.stack([rays[f"{which}{axis}"] for axis in "xyz"], axis=-1) for which in "od")
    _, ids = exhaustive.nearest(scene.store, o, d)
    index = np.where(ids == NO_HIT, -1, (ids & np.uint64((1 << 48) - 1)).astype(int))
    width, height = camera.resolution
    return index.reshape(height + 1, width + 1)


def test_a_mirror_is_as_shaded_as_what_it_shows(written):
    """The same corner, seen by a mirror: as bright, but for the mirror's part and for chance."""
    wall = np.array([[2, -500, -500], [2, 500, -500], [2, 500, 500], [2, -500, 500]])
    corner = [("polygons", np.array(square(0, 500)), [4], WHITE), ("polygons", wall, [4], WHITE)]
    glass = np.array([[-3, -9, -9], [-3, 9, -9], [-3, 9, 9], [-3, -9, 9]])
    scene = written([*corner, ("polygons", glass, [4], Material((0, 0, 0), 0, 0.5))])
    seen = Camera((-2, 0, 1.5), (1, 0, 0), angle=20, resolution=(12, 12))
    mirrored = replace(seen, at=(-7, 0, 0))
    # from (-2, 0, 1.5) the glass at x = -3 shows what is seen from (-4, 0, 1.5), turned round
    direct = replace(seen, eye=(-4, 0, 1.5), at=(1, 0, 0))
    near = {**OPEN, "ao_distance": 2.0}
    shown = rendered(scene, mirrored, ao=400, **near).rgb[:, ::-1, 0]
    expected = rendered(written(corner), direct, ao=400, **near).rgb[..., 0]
    assert np.ptp(expected) > 0.3
    agree(2 * shown, expected, 4 * 100)
