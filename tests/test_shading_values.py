"""Rendered values against what the textbook says of the same scene, pixel by pixel."""

from __future__ import annotations

import itertools
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
    film_points,
    floor,
    meet_ball,
    meet_level,
    met,
    mirrored,
    over,
    rendered,
    shade,
    square,
    unit,
)

from bfrt import Camera, Light, Material

#: Weights travel, and pixels are kept, as float32.
close = partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-9)

MATT = Material((0.75, 0.5, 0.25), 0.5)
LAMP = Light((3, -5, 4))

#: A look at the unit ball around the origin, with some room beside it.
AT_BALL = Camera((0, -6, 0), (0, 0, 0), angle=24, resolution=(24, 20))


@pytest.fixture
def written(tmp_path):
    return partial(shading.written, tmp_path / "a.bfrt")


# --- Lambert -----------------------------------------------------------------------------------


LIGHTS = {
    "beside the eye": [Light((1, -7, 2))],
    "far above": [Light((0, 0, 500))],
    "near the surface": [Light((0.7, -0.8, 0.4))],
    "behind": [Light((3, 4, 1))],
    "straight behind": [Light((0, 9, 0))],
    "inside": [Light((0.2, -0.3, 0.1))],
    "two": [Light((4, -5, 3)), Light((-3, -2, -4))],
    "three": [Light((4, -5, 3)), Light((-3, -2, -4)), Light((0, 8, 1))],
    "four in one place": [LAMP] * 4,
    "colored": [Light((4, -5, 3), (0.25, 0.5, 2.0))],
    "two colors": [Light((4, -5, 3), (1, 0, 0)), Light((-3, -2, -4), (0, 0.5, 3))],
}


@pytest.mark.parametrize("name", LIGHTS)
def test_a_matt_ball(written, name):
    """Where the light is behind the surface, the ambient light is alone."""
    lights = LIGHTS[name]
    image = rendered(written([ball(1, MATT)], lights, (0.125, 0, 0.5)), AT_BALL)
    place = meet_ball(AT_BALL.eye, corner_rays(AT_BALL))
    seen = shade(AT_BALL.eye, place, place, MATT, lights)  # of the unit ball it is the normal too
    close(image.rgb, film(over(seen, met(place), (0.125, 0, 0.5))))
    close(image.channels["A"], film(met(place)))
    facing = sum((dot(place, light.position - place) > 0).sum() for light in lights)
    assert image.stats.total.rays.shadow == facing


def test_the_ambient_light_is_alone_where_no_light_comes(written):
    """The values themselves: I kd color, with I = 1/2 for one light."""
    image = rendered(written([ball(1, MATT)], LIGHTS["straight behind"]), AT_BALL)
    assert (image.rgb[9:11, 11:13] == (0.1875, 0.125, 0.0625)).all()


def test_light_straight_from_above(written):
    """n.l = 1 in the middle of a ball that is lit from the eye's side: ambient and all of kd."""
    camera = Camera((0, -6, 0), (0, 0, 0), angle=1e-4, resolution=(2, 2))
    image = rendered(written([ball(1, MATT)], [Light((0, -50, 0))]), camera)
    close(image.rgb, np.broadcast_to((0.375, 0.25, 0.125), (2, 2, 3)))


def test_twice_the_diffuse_part_is_twice_the_light(written):
    pictures = [
        rendered(written([ball(1, MATT._replace(kd=kd))], LIGHTS["two"]), AT_BALL).rgb
        for kd in (0.25, 0.5, 1.0)
    ]
    assert pictures[0].max() > 0.1
    close(pictures[1], 2 * pictures[0])
    close(pictures[2], 4 * pictures[0])


def test_the_order_of_lights_does_not_matter(written):
    glossy = MATT._replace(ks=0.3, shine=7.3)
    things = [ball(1, glossy), floor(-1.5, 30, glossy)]
    camera = replace(AT_BALL, eye=(0, -6, 2))
    pictures = {
        rendered(written(things, order), camera).rgb.tobytes()
        for order in itertools.permutations(LIGHTS["three"][:2] + LIGHTS["colored"])
    }
    assert len(pictures) == 1


# --- Phong -------------------------------------------------------------------------------------


SHINES = [1.0, 5.5, 100.0]


@pytest.mark.parametrize("shine", SHINES)
@pytest.mark.parametrize("kd", [0.0, 0.5])
def test_the_highlight_of_a_ball(written, shine, kd):
    glossy = Material((0.75, 0.5, 0.125), kd, 0.5, shine)
    lights = [Light((2, -5, 3), (1, 0.5, 2)), Light((-6, -1, -2))]
    image = rendered(written([ball(1, glossy)], lights), AT_BALL)
    place = meet_ball(AT_BALL.eye, corner_rays(AT_BALL))
    close(image.rgb, film(shade(AT_BALL.eye, place, place, glossy, lights)))


@pytest.mark.parametrize("shine", SHINES)
def test_the_highlight_of_a_plane(written, shine):
    """Its color is the light's; the object's, without red, does not show."""
    camera = Camera((0, -4, 3), (0, 0, 0), angle=40, resolution=(24, 24))
    light = Light((0.5, 3, 3), (1, 0.5, 0.25))
    image = rendered(written([floor(0, 50, Material((0, 1, 1), 0, 0.75, shine))], [light]), camera)
    place = meet_level(camera.eye, corner_rays(camera), 0)
    # the mirror image of the light, seen from the place under the angle alpha to the eye's way
    below = np.multiply(light.position, (1, 1, -1))
    alpha = np.arccos(dot(unit(below - place), unit(place - camera.eye)))
    expected = film(0.5 * 0.75 * np.cos(np.minimum(alpha, math.pi / 2)) ** shine)
    assert expected.max() > 0.3
    close(image.rgb, expected[..., None] * light.color)


# --- mirrors -----------------------------------------------------------------------------------


def test_a_mirror_shows_a_ball(written):
    """The light is on the eye's side, so that the mirror has no highlight of its own."""
    camera = Camera((0, -6, 3), (0, 1, 0.5), angle=40, resolution=(32, 32))
    center, light, background = (0, 2, 1.5), Light((1, -20, 1)), (0.25, 0.5, 0.0)
    mirror = Material((1, 1, 1), 0, 0.625)
    scene = written([floor(0, 6, mirror), ball(1, MATT, center)], [light], background)
    image = rendered(scene, camera)

    def seen(eye, d):
        place = meet_ball(eye, d, 1, center)
        return over(shade(eye, place, place - center, MATT, [light]), met(place), background)

    d = corner_rays(camera)
    glass, direct = meet_level(camera.eye, d, 0, 6), meet_ball(camera.eye, d, 1, center)
    glass[met(direct)] = np.nan  # the ball is above the mirror, and hides it
    turned = mirrored(d, (0, 0, 1))
    assert (dot(turned, unit(light.position - glass))[met(glass)] < 0).all()
    shown = seen(glass, turned)
    assert (shown != background).any(axis=-1)[met(glass)].sum() > 50
    close(image.rgb, film(over(0.625 * shown, met(glass), seen(camera.eye, d))))


def mirrors(end, ks=0.5):
    """Two facing each other at x = -1 and 1, from y = -1 to `end`; red and green."""
    corners = np.array([[1, -1, -9], [1, end, -9], [1, end, 9], [1, -1, 9]])
    return [
        ("polygons", corners * (side, 1, 1), [4], Material(color, 0.5, ks))
        for side, color in ((-1, (1, 0, 0)), (1, (0, 1, 0)))
    ]


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 5, 6, 9])
def test_two_mirrors_show_each_other_as_often_as_depth_says(written, depth):
    """Each hit k shows the ambient light, ks^k of it: neither mirror lets the lamp light the other.

    All numbers are halves and quarters: the sum is exact.
    """
    camera = Camera((0.25, 0, 0), (1, 0, 0), angle=5, resolution=(8, 8))
    scene = written(mirrors(9.0), [Light((9, 0, 0))], (0, 0, 1))
    image = rendered(scene, camera, depth=depth)
    weights = 0.25 * 0.5 ** np.arange(depth)
    assert (image.rgb == (weights[1::2].sum(), weights[0::2].sum(), 0)).all()


def test_the_depth_is_five_by_default(written):
    camera = Camera((0.25, 0, 0), (1, 0, 0), angle=5, resolution=(8, 8))
    scene = written(mirrors(9.0), [Light((9, 0, 0))])
    assert (rendered(scene, camera).rgb == rendered(scene, camera, depth=5).rgb).all()
    assert (rendered(scene, camera).rgb != rendered(scene, camera, depth=6).rgb).any()


@pytest.mark.parametrize("bounces", [0, 1, 2, 3, 4, 5, 6])
def test_a_ray_leaves_two_mirrors_for_the_background(written, bounces):
    """It meets them at y = 1/4, 3/4, 5/4, ..., and the background shows ks^bounces of itself; after
    the fifth hit no ray goes on."""
    camera = Camera((0, 0, 0), (4, 1, 0), angle=1e-3, resolution=(4, 4))
    scene = written(mirrors(0.5 * bounces), [Light((9, 0, 0))], (0, 0, 1))
    assert (rendered(scene, camera).rgb[..., 2] == (0.5**bounces if bounces < 5 else 0)).all()


# --- glass -------------------------------------------------------------------------------------


CLEAR = Material((1, 1, 1), 0, 0, transmittance=0.75, ior=1.5)


def pane(top, bottom, material, half=50.0):
    """Its two sides, counterclockwise from outside."""
    return [
        floor(top, half, material),
        ("polygons", np.array(square(bottom, half))[::-1], [4], material),
    ]


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.4, 0.0], ids=lambda ior: f"ior {ior:g}")
def test_a_pane_moves_a_ray_aside_and_does_not_turn_it(written, ior):
    """The lamp is between pane and floor, so that its light tells where the floor is hit.

    An index of 0, which SPD writes for what is opaque, bends nothing.
    """
    camera = Camera((-1, -2, 2.5), (0.25, 0.5, 0), angle=40, resolution=(20, 16))
    light = Light((0.5, -0.25, -2))
    scene = written([*pane(0, -1, CLEAR._replace(ior=ior)), floor(-3, 50, MATT)], [light])
    d = corner_rays(camera)
    enters = meet_level(camera.eye, d, 0)
    across = np.hypot(d[..., 0], d[..., 1])
    inside = np.arcsin(across / (ior or 1))
    leaves = enters + d / across[..., None] * np.tan(inside)[..., None]
    leaves[..., 2] = -1
    place = meet_level(leaves, d, -3)
    expected = film(0.75**2 * shade(camera.eye, place, (0, 0, 1), MATT, [light]))
    close(rendered(scene, camera).rgb, expected)
    straight = meet_level(camera.eye, d, -3)
    unbent = film(0.75**2 * shade(camera.eye, straight, (0, 0, 1), MATT, [light]))
    moved = np.abs(expected - unbent).max()
    assert moved > 0.005 if ior > 1 else moved < 1e-9


def test_a_ball_of_glass(written):
    """A central ray goes straight through, another is turned twice by the same angle; the lamp is
    between ball and wall, so that its light tells where the wall is hit."""
    light, sky = Light((1, 3, 0.5)), (0.125, 0.25, 0.5)
    wall = np.array(square(0, 40))[:, [0, 2, 1]] + (0, 4, 0)
    scene = written([ball(1, CLEAR), ("polygons", wall, [4], MATT)], [light], sky)

    def seen(place, d):
        """What is there of the wall, with its plane taken as a level one."""
        there = meet_level(place[..., [0, 2, 1]], d[..., [0, 2, 1]], 4, 40)[..., [0, 2, 1]]
        return over(shade(AT_BALL.eye, there, (0, -1, 0), MATT, [light]), met(there), sky)

    d = corner_rays(AT_BALL)
    nearest = AT_BALL.eye - dot(AT_BALL.eye, d)[..., None] * d
    beside = np.linalg.norm(nearest, axis=-1)
    assert beside.min() < 1e-9  # the central ray is one of them
    aside = nearest / np.maximum(beside, 1e-99)[..., None]
    hits = beside < 1
    before = np.arcsin(np.where(hits, beside, 0))
    after = np.arcsin(np.sin(before) / 1.5)

    def polar(angle):
        """Directions at an angle to the rays', in the plane of each and the center."""
        return np.cos(angle)[..., None] * d + np.sin(angle)[..., None] * aside

    through = 0.75**2 * seen(polar(2 * after - before), polar(2 * (after - before)))
    close(rendered(scene, AT_BALL).rgb, film(over(through, hits, seen(np.array(AT_BALL.eye), d))))


def bubble_weight(beside, ior, ks, transmittance):
    """How much of an even background a bubble shows to a ray at that distance from its center.

    Outside of the critical angle all is in the first mirroring. Else what is let in comes to the
    surface again and again, up to the fifth hit, and a part goes out each time.
    """
    once = ks + transmittance**2 * (1 + ks + ks**2)
    return np.where(beside > ior, ks + transmittance, once)


@pytest.mark.parametrize(("ks", "transmittance"), [(0.0, 0.5), (0.25, 0.5)])
def test_total_internal_reflection_by_a_bubble(written, ks, transmittance):
    """The index is less than 1: beyond the critical angle the bubble is a mirror to the outside,
    and what would be let in goes to the reflected ray."""
    material = Material((1, 1, 1), 0, ks, 1e4, transmittance, 0.625)
    background = (1.0, 0.5, 0.25)
    scene = written([ball(1, material)], [Light((0, 9, 0))], background)
    d = corner_rays(AT_BALL)
    beside = np.linalg.norm(np.cross(AT_BALL.eye, d), axis=-1)
    weight = np.where(beside < 1, bubble_weight(beside, 0.625, ks, transmittance), 1)
    image = rendered(scene, AT_BALL)
    close(image.rgb, film(weight)[..., None] * background)
    close(image.channels["A"], film(beside < 1))  # what is seen through is not alpha


def test_a_window_above_water(written):
    """From below, the sky is seen within the critical angle; around it the ground is mirrored,
    with transmittance and ks. The lamp is above: what is clear shades the ground all the same."""
    water = Material((1, 1, 1), 0, 0.25, 1.0, 0.5, 1.5)
    sky = (0.0, 1.0, 2.0)
    camera = Camera((0, 0, -2), (0, 0, 0), (0, 1, 0), angle=120, resolution=(32, 32))
    scene = written([floor(0, 900, water), floor(-4, 900, MATT)], [Light((1, 2, 3))], sky)
    steep = np.degrees(np.arccos(corner_rays(camera)[..., 2]))
    total = (steep > math.degrees(math.asin(1 / 1.5)))[..., None]
    assert 0.2 < total.mean() < 0.9
    ground = 0.5 * 0.5 * np.array(MATT.color)
    expected = np.where(total, 0.75 * ground, 0.25 * ground + 0.5 * np.array(sky))
    close(rendered(scene, camera).rgb, film(expected))


# --- background and alpha ----------------------------------------------------------------------


def test_the_background_is_where_nothing_is(written):
    """Alpha is the part of a pixel's rays that meet something; the background is the rest."""
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), angle=40, resolution=(16, 12))
    black = Material((0, 0, 0), 0)
    sky = (0.25, 0.5, 4.0)
    image = rendered(written([floor(0, 0.9, black)], [LAMP], sky), camera)
    hit = met(meet_level(camera.eye, corner_rays(camera), 0, 0.9))
    alpha = film(hit)
    assert set(alpha.flat) == {0, 0.25, 0.5, 1}
    assert (image.channels["A"] == alpha).all()
    assert (image.rgb == (1 - alpha)[..., None] * sky).all()


# --- normals -----------------------------------------------------------------------------------


def octahedron():
    """Corners of its eight faces, (8, 3, 3), counterclockwise from outside."""
    signs = np.array(list(itertools.product((1, -1), repeat=3)), float)
    faces = signs[:, None, :] * np.eye(3)
    turned = signs.prod(axis=1) < 0
    faces[turned] = faces[turned, ::-1]
    return faces


def halved(faces):
    """Each face in four, with the new corners on the unit ball."""
    a, b, c = faces.swapaxes(0, 1)
    ab, bc, ca = unit(a + b), unit(b + c), unit(c + a)
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(each, axis=1) for each in corners])


#: The octahedron is turned against this view, so that no corner ray passes along an edge.
AT_OCTAHEDRON = Camera((1.5, -6, 2.25), (0.05, 0, 0.02), angle=18, resolution=(24, 24))


def meet_octahedron(eye, d):
    """Where rays from outside enter it, and the faces' normals there."""
    signs = np.array(list(itertools.product((1, -1), repeat=3)), float)
    speed = d @ signs.T
    t = (1 - eye @ signs.T) / speed  # |x| + |y| + |z| <= 1, one face at a time
    enter, leave = np.where(speed < 0, t, -np.inf), np.where(speed > 0, t, np.inf)
    face = enter.argmax(axis=-1)
    near = enter.max(axis=-1)
    place = eye + np.where(near < leave.min(axis=-1), near, np.nan)[..., None] * d
    return place, unit(signs[face])


def test_patches_have_the_normals_of_the_ball_that_they_are_cut_from(written):
    """The octahedron in a ball: a place on a face is a mean of its corners, and the mean of the
    corners' normals is the same vector. Light comes, and is asked for, where both normals face it.
    """
    eye, light = np.array(AT_OCTAHEDRON.eye), Light((6, -3, 2.5))
    faces = octahedron()
    image = rendered(written([("patches", faces, faces, MATT)], [light]), AT_OCTAHEDRON)
    place, flat = meet_octahedron(eye, corner_rays(AT_OCTAHEDRON))
    lit = dot(flat, light.position - place) > 0
    assert lit[met(place)].any() and not lit[met(place)].all()
    close(image.rgb, film(shade(eye, place, unit(place), MATT, [light], lit)))
    smooth = dot(unit(place), light.position - place) > 0
    assert image.stats.total.rays.shadow == (smooth & lit).sum() < smooth.sum()
    normals = np.stack([image.channels[f"N.{axis}"] for axis in "XYZ"], axis=-1)
    hit = met(place)[:-1, :-1]
    close(normals[hit], unit(place)[:-1, :-1][hit], atol=1e-7)


def test_small_patches_shade_as_the_ball(written):
    """8,192 patches: as far from a ball as their corners are apart, squared; flat faces are not."""
    faces = octahedron()
    for _ in range(5):
        faces = halved(faces)
    lights = LIGHTS["beside the eye"]
    camera = replace(AT_BALL, angle=12)  # inside of the outline
    place = meet_ball(camera.eye, corner_rays(camera))
    expected = film(shade(camera.eye, place, place, MATT, lights))
    smooth = rendered(written([("patches", faces, faces, MATT)], lights), camera).rgb
    flat = rendered(written([("triangles", faces, MATT)], lights), camera).rgb
    assert np.abs(smooth - expected).max() < 5e-4
    assert np.abs(flat - expected).max() > 2e-3


def test_a_patch_does_not_mirror_into_itself(written):
    """Its normals lean so far away from the eye that their mirror image would go below the face:
    the face's own normal is taken. The lamp under the ceiling tells where that is hit."""
    mirror = Material((1, 1, 1), 0, 0.5, 1e4)
    corners = [[-9, -9, 0], [9, -9, 0], [0, 18, 0]]
    normal = (0, math.sin(1), math.cos(1))
    ceiling = "polygons", np.array(square(5, 50))[::-1], [4], MATT
    light = Light((1, 6, 4))
    scene = written([("patches", [corners], [[normal] * 3], mirror), ceiling], [light])
    camera = Camera((0, -6, 1.5), (0, 0, 0), angle=10, resolution=(12, 12))
    d = corner_rays(camera)
    assert (mirrored(d, normal)[..., 2] < 0).all()
    place = meet_level(meet_level(camera.eye, d, 0), mirrored(d, (0, 0, 1)), 5)
    expected = 0.5 * shade(camera.eye, place, (0, 0, -1), MATT, [light])
    close(rendered(scene, camera).rgb, film(expected))


def test_a_patch_lets_a_ray_through_once(written):
    """Its normals lean towards the eye. Whether the ray is let in or wholly mirrored, it is once
    weakened by the transmittance before it meets the sky."""
    film_of_air = Material((1, 1, 1), 0, 0, transmittance=0.5, ior=1 / 1.5)
    corners = [[-9, -9, 0], [9, -9, 0], [0, 18, 0]]
    normal = (0, -math.sin(1), math.cos(1))
    patch = "patches", [corners], [[normal] * 3], film_of_air
    scene = written([patch], [Light((0, 0, -50))], (1, 1, 1))
    camera = Camera((0, -6, 0.6), (0, 0, 0), angle=1, resolution=(4, 4))
    assert (rendered(scene, camera).rgb == 0.5).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_a_negative_radius_turns_the_normal(written, sign):
    """That of the picture; light comes to both sides."""
    lights = LIGHTS["beside the eye"]
    cone = "cones", [[0, 0, -1]], [sign * 1.0], [[0, 0, 1]], [sign * 0.5], MATT
    place = meet_ball(AT_BALL.eye, corner_rays(AT_BALL))
    hit = met(place)[:-1, :-1]
    image = rendered(written([ball(sign, MATT)], lights), AT_BALL)
    normals = np.stack([image.channels[f"N.{axis}"] for axis in "XYZ"], axis=-1)
    close(normals[hit], sign * place[:-1, :-1][hit], atol=1e-7)
    close(image.rgb, film(shade(AT_BALL.eye, place, place, MATT, lights)))
    middle = rendered(written([cone], lights), replace(AT_BALL, angle=1e-4, resolution=(1, 1)))
    assert middle.channels["N.Y"] == pytest.approx(-sign / math.hypot(1, 0.25))
    assert middle.channels["N.Z"] == pytest.approx(sign * 0.25 / math.hypot(1, 0.25))


def test_a_negative_radius_turns_glass_inside_out(written):
    """What is inside of a ball of index 1/2 is outside of a turned one of index 2."""
    pictures = []
    for radius, ior in ((1, 0.5), (-1, 2), (1, 2), (-1, 0.5)):
        glass = CLEAR._replace(ior=ior, ks=0.25, shine=9.0)
        scene = written([ball(radius, glass), floor(-2, 50, MATT)], [LAMP], (1, 1, 1))
        pictures.append(rendered(scene, AT_BALL).rgb)
    close(pictures[0], pictures[1])
    close(pictures[2], pictures[3])
    assert np.abs(pictures[0] - pictures[2]).max() > 0.1


def test_the_inside_of_a_ball(written):
    """The lamp is near the surface, and lights all of it: a ball is hollow, and has two sides."""
    camera = Camera((0.25, -0.5, 0), (0, 0.5, 0.125), angle=110, resolution=(24, 24))
    light = Light((0.25, 0.5, 0.75))
    image = rendered(written([ball(1, MATT)], [light]), camera)
    eye, d = np.array(camera.eye), corner_rays(camera)
    along = dot(eye, d)
    place = eye + (np.sqrt(along**2 + 1 - eye @ eye) - along)[..., None] * d
    close(image.rgb, film(shade(camera.eye, place, -place, MATT, [light])))


@pytest.mark.parametrize("kind", ["triangles", "patches", "polygons"])
@pytest.mark.parametrize("turned", [False, True], ids=["front", "back"])
def test_a_face_has_two_sides(written, kind, turned):
    camera = Camera((0, -4, 3), (0, 0, 0), angle=30, resolution=(12, 12))
    corners = np.array([[-40, -40, 0], [40, -40, 0], [40, 40, 0], [-40, 40, 0]], float)
    corners = corners[::-1] if turned else corners
    triangles = np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]])
    normals = np.broadcast_to((0, 0, -1.0 if turned else 1.0), (2, 3, 3))
    shapes = {
        "triangles": (triangles,), "patches": (triangles, normals), "polygons": (corners, [4]),
    }  # fmt: skip
    for height, lights in (
        (2, [Light((1, 0.5, 2))]),
        (-2, [Light((1, 0.5, -2))]),
    ):
        image = rendered(written([(kind, *shapes[kind], MATT)], lights), camera)
        place = meet_level(camera.eye, corner_rays(camera), 0, 40)
        close(image.rgb, film(shade(camera.eye, place, (0, 0, 1), MATT, lights)))
        assert (image.rgb[..., 0].max() > 0.1875) == (height > 0)


# --- shadows -----------------------------------------------------------------------------------


#: Under what shades, so that only the ground is seen.
AT_GROUND = Camera((0, -4, 1.5), (0, -0.2, 0), angle=30, resolution=(40, 40))
GROUND = Material((1, 1, 1), 1.0)
SHADING = Light((0.5, 0.75, 6))
OPAQUE_AND_CLEAR = {"opaque": MATT, "clear": CLEAR, "mirror": Material((1, 1, 1), 0, 1)}


def square_of(kind, z, half, material):
    corners = np.array(square(z, half))
    halves = np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]])
    shapes = {
        "triangles": (halves,),
        "patches": (halves, np.broadcast_to((0, 0, 1.0), (2, 3, 3))),
        "polygons": (corners, [4]),
    }
    return kind, *shapes[kind], material


def close_to_ground(scene, blocked):
    """The ground is as lit as it says, to the edge: each corner is in the shadow or not."""
    place = meet_level(AT_GROUND.eye, corner_rays(AT_GROUND), 0)
    shaded = blocked(place)
    assert 0.05 < shaded.mean() < 0.95
    expected = shade(AT_GROUND.eye, place, (0, 0, 1), GROUND, [SHADING], ~shaded)
    close(rendered(scene, AT_GROUND).rgb, film(expected))


@pytest.mark.parametrize("material", OPAQUE_AND_CLEAR)
@pytest.mark.parametrize("kind", ["triangles", "patches", "polygons"])
def test_the_shadow_of_a_square(written, kind, material):
    """It is the square seen from the light, and has no half-shade; two triangles have no gap."""
    half, height = 0.6, 2.0
    thing = square_of(kind, height, half, OPAQUE_AND_CLEAR[material])

    def blocked(place):
        part = height / SHADING.position[2]  # of the way from the ground to the light
        crossing = place + part * (SHADING.position - place)
        return (np.abs(crossing[..., :2]) < half).all(axis=-1)

    close_to_ground(written([floor(0, 50, GROUND), thing], [SHADING]), blocked)


@pytest.mark.parametrize("material", OPAQUE_AND_CLEAR)
def test_the_shadow_of_a_ball(written, material):
    """All that the cone from the light around the ball contains."""
    center, radius = np.array((0.25, 0.5, 3)), 0.75
    thing = ball(radius, OPAQUE_AND_CLEAR[material], center)

    def blocked(place):
        to_center, to_place = center - SHADING.position, place - SHADING.position
        spread = math.asin(radius / np.linalg.norm(to_center))
        return np.arccos(dot(unit(to_center), unit(to_place))) < spread

    close_to_ground(written([floor(0, 50, GROUND), thing], [SHADING]), blocked)


def test_the_shadow_of_a_cylinder(written):
    """An upright one that the light is beside: a strip as wide as it looks from there."""
    radius, top = 0.25, 20.0
    thing = "cones", [[0, 0, 1.75]], [radius], [[0, 0, top]], [radius], MATT

    def blocked(place):
        """The way from the light passes the axis by less than the radius, above the lower end."""
        begin, way = np.array(SHADING.position), place - SHADING.position
        a = dot(way[..., :2], way[..., :2])
        b = dot(way[..., :2], begin[:2])
        c = begin[:2] @ begin[:2] - radius**2
        with np.errstate(invalid="ignore"):
            enters = begin[2] + way[..., 2] * (-b - np.sqrt(b * b - a * c)) / a
            leaves = begin[2] + way[..., 2] * (-b + np.sqrt(b * b - a * c)) / a
        return (b < 0) & ((enters > 1.75) | (leaves > 1.75))

    close_to_ground(written([floor(0, 50, GROUND), thing], [SHADING]), blocked)


def test_what_is_beyond_the_light_casts_no_shadow(written):
    things = [floor(0, 50, GROUND), ball(0.5, MATT, (0.5, 0.75, 6.75)), floor(6.25, 9, MATT)]
    place = meet_level(AT_GROUND.eye, corner_rays(AT_GROUND), 0)
    expected = shade(AT_GROUND.eye, place, (0, 0, 1), GROUND, [SHADING])
    close(rendered(written(things, [SHADING]), AT_GROUND).rgb, film(expected))


def test_each_light_has_its_own_shadow(written):
    lights = [Light((1, 0, 6), (1, 0, 0)), Light((-1.5, 0.5, 6), (0, 1, 0)), Light((0.5, 1, 8))]
    half, height = 0.5, 2.0
    scene = written([floor(0, 50, GROUND), square_of("polygons", height, half, MATT)], lights)
    place = meet_level(AT_GROUND.eye, corner_rays(AT_GROUND), 0)
    ambient = INTENSITY[3]
    expected = np.full(place.shape, ambient)
    for light in lights:
        to = light.position - place
        crossing = place + height / to[..., 2:] * to
        clear = (np.abs(crossing[..., :2]) > half).any(axis=-1)
        assert 0.02 < 1 - clear.mean() < 0.5
        expected += ambient * np.multiply((clear * unit(to)[..., 2])[..., None], light.color)
    close(rendered(scene, AT_GROUND).rgb, film(expected))


# --- grazing light -----------------------------------------------------------------------------


def grid(side=4):
    """The square [-1, 1]^2 of z = 0 as two triangles a cell."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, side + 1)] * 2)
    corners = np.stack([x, y, np.zeros_like(x)], axis=-1)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]
    halves = [np.stack(half, axis=-2).reshape(-1, 3, 3) for half in ((a, b, c), (a, c, d))]
    return np.concatenate(halves)


def leaning(place):
    """Normals of the patches there: of no unit length, so that means of corners' are the same."""
    return place * (0.5, 0.5, 0) + (0, 0, 1)


#: By name: the shape in units of its size, moved by a function of places.
PENTAGON = [[-1, -1, 0], [1, -0.75, 0], [0.75, 1, 0], [0, 0.875, 0], [-1, 1, 0]]
SHAPES = {
    "ball": lambda moved, size: ("spheres", moved([[0, 0, 0]]), [size]),
    "cone": lambda moved, size: (
        "cones", moved([[0, 0, -1]]), [size], moved([[0, 0, 1]]), [size / 2],
    ),
    "triangles": lambda moved, size: ("triangles", moved(grid())),
    "polygon": lambda moved, size: ("polygons", moved(PENTAGON), [5]),
    "patches": lambda moved, size: ("patches", moved(grid()), leaning(grid())),
}  # fmt: skip

#: What is looked at, and the normal there; where it is none of these, a square of z = 0.
LOOKED_AT = {
    "ball": ((0.6, -0.8, 0), (0.6, -0.8, 0)),
    "cone": ((0, -0.75, 0), unit((0, -1, 0.25))),
}
IN_SQUARE = ((0.125, 0, 0), (0, 0, 1))

#: Powers of two near 10^-6 and 10^6, so that what is grazed is stored without rounding.
TINY, HUGE = 2.0**-20, 2.0**20
FAR = np.array((HUGE, -HUGE, HUGE / 2))

#: To the normal, in degrees, each in a channel of its own; so bright that a trace would be seen.
GRAZING = {89.0: (1024, 0, 0), 89.9: (0, 1024, 0), 89.99: (0, 0, 1024)}

WHITE = Material((1, 1, 1), 1.0)


def exact(place):
    """Rounded so that it stays what it is when it is made tiny and moved far away."""
    return np.round(np.multiply(place, 4096)) / 4096


def grazing(name, side):
    """A close look at a surface, and lamps that graze the place, before its plane or behind it."""
    at, normal = (np.array(v, float) for v in LOOKED_AT.get(name, IN_SQUARE))
    along = unit(np.cross(normal, (0.3, 0.2, 1)))
    eye = exact(at + normal + 0.75 * np.cross(normal, along))
    lights = []
    for angle, tint in GRAZING.items():
        up = side * math.cos(math.radians(angle))
        lights.append(Light(exact(at + 8 * (up * normal + along)), tint))
    return Camera(eye, exact(at), (0.1, 0.2, 1), 12, resolution=(16, 16)), lights


def meet_cone(eye, d):
    """Where rays from outside enter the cone of `SHAPES`: its radius is (3 - z) / 4."""
    flatten = np.array((1, 1, -1 / 16))
    tip = np.subtract(eye, (0, 0, 3))
    a, b, c = dot(d * d, flatten), dot(tip * d, flatten), dot(tip * tip, flatten)
    return eye + ((-b - np.sqrt(b * b - a * c)) / a)[..., None] * d


def grazed(name, eye, d):
    """Where rays meet a surface of `SHAPES`, and the normals that it is shaded with."""
    if name == "ball":
        place = meet_ball(eye, d)
        return place, place
    if name == "cone":
        place = meet_cone(eye, d)
        return place, unit(unit(place * (1, 1, 0)) + np.array((0, 0, 0.25)))
    place = meet_level(eye, d, 0)
    return place, unit(leaning(place)) if name == "patches" else np.array((0, 0, 1.0))


def lit_and_expected(written, name, size, offset, side, **settings):
    """The picture of a shape that is made so large and moved there, and what it is to be."""

    def moved(place):
        return offset + size * np.asarray(place, float)

    camera, lights = grazing(name, side)
    lamps = [Light(moved(position), tint) for position, tint in lights]
    scene = written([(*SHAPES[name](moved, size), WHITE)], lamps, **settings)
    there = replace(camera, eye=tuple(moved(camera.eye)), at=tuple(moved(camera.at)))
    place, normal = grazed(name, camera.eye, corner_rays(camera))
    faces = name in LOOKED_AT or side > 0  # all of a flat shape, or nothing
    lit = shade(camera.eye, place, normal, WHITE, lights, faces)
    assert met(place).all() and (lit > INTENSITY[3]).any() == faces
    return rendered(scene, there).rgb, film(lit)


@pytest.mark.parametrize("side", [1, -1], ids=["before", "behind"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("offset", [0, FAR], ids=["near", "far"])
@pytest.mark.parametrize("size", [TINY, 1.0, HUGE], ids=["tiny", "one", "huge"])
@pytest.mark.parametrize("name", SHAPES)
def test_grazing_light_makes_no_spots(written, name, size, offset, dtype, side):
    """All that faces a lamp is lit by it, and nothing else is, whatever the size and place."""
    close(*lit_and_expected(written, name, size, offset, side, dtype=dtype))


@pytest.mark.parametrize("name", SHAPES)
def test_grazing_light_far_from_the_origin_of_the_store(written, name):
    """As far as a million times its size."""
    close(*lit_and_expected(written, name, 1.0, FAR, 1, origin=(0, 0, 0)))


@pytest.mark.parametrize("name", SHAPES)
def test_grazing_light_as_far_as_float64_tells_apart(written, name):
    """A million million times its size from the store's origin, where coordinates are multiples of
    2^-12 of it: n.l is right to about as much."""
    image, lit = lit_and_expected(written, name, TINY, FAR, 1, origin=(0, 0, 0))
    close(image, lit, rtol=0, atol=INTENSITY[3] * 1024 / 2**12)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_grazing_light_near_the_surface_of_a_very_large_ball(written, dtype):
    """As on a planet: eye, lamps and view are a millionth of its radius."""
    camera = Camera((0.5, -1.5, 1), (0, 0, 0), angle=20, resolution=(16, 16))
    lights = [
        Light((8, 3, 8.5 / math.tan(math.radians(angle))), tint) for angle, tint in GRAZING.items()
    ]
    planet = ball(HUGE, WHITE, (0, 0, -HUGE))
    place = meet_ball(camera.eye, corner_rays(camera), HUGE, (0, 0, -HUGE))
    normal = (place - (0, 0, -HUGE)) / HUGE
    lit = shade(camera.eye, place, normal, WHITE, lights)
    assert (lit > INTENSITY[3]).all()
    close(rendered(written([planet], lights, dtype=dtype), camera).rgb, film(lit))


# --- camera and film ---------------------------------------------------------------------------


def test_the_camera_sees_its_angle_from_the_bottom_to_the_top(written):
    """A picture wider than high, held askew, of a wall straight before it: the ray of a pixel's
    upper left corner meets it where the angle says."""
    eye, forward, up = np.array((1.0, 2, 3)), unit((2, 3, -1)), np.array((1.0, 0, 2))
    camera = Camera(eye, eye + 7 * forward, up, angle=50, resolution=(12, 8))
    right = unit(np.cross(forward, up))
    above = np.cross(right, forward)
    wall = [eye + 4 * forward + x * right + y * above for x, y, _ in square(0, 50)]
    scene = written([("polygons", wall, [4], MATT)], [LAMP])
    image = rendered(scene, camera, aovs=["position"])
    high = 4 * math.tan(math.radians(25))
    x = np.linspace(-1.5 * high, 1.5 * high, 13)[:-1]
    y = np.linspace(high, -high, 9)[:-1, None]
    offset = x[..., None] * right + y[..., None] * above
    position = np.stack([image.channels[f"P.{axis}"] for axis in "XYZ"], axis=-1)
    close(position, eye + 4 * forward + offset, rtol=0, atol=2e-6)
    close(image.channels["Z"], np.sqrt(16 + x**2 + y**2))


def test_a_sample_is_in_its_pixel_and_has_the_light_of_its_place(written):
    """The position says where the one sample of each pixel is; the color is what is there."""
    lights = LIGHTS["two colors"]
    camera = replace(AT_BALL, eye=(1, -6, 2), resolution=(31, 24))
    image = rendered(written([ball(1, MATT)], lights), camera, samples=1, aovs=["position"])
    place = np.stack([image.channels[f"P.{axis}"] for axis in "XYZ"], axis=-1).astype(float)
    hit = np.isfinite(place).all(axis=-1)
    assert (image.channels["A"] == hit).all() and 0.3 < hit.mean() < 0.9
    rows, columns = np.nonzero(hit)
    corners = [
        film_points(camera, columns + x, rows + y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    ways = unit(place[hit] - camera.eye)
    for one, other in itertools.pairwise([*corners, corners[0]]):
        assert (dot(np.cross(one, other), ways) > -1e-8).all()  # inside of all four sides
    normal = unit(place[hit])
    close(image.rgb[hit], shade(camera.eye, normal, normal, MATT, lights), rtol=2e-6, atol=2e-7)


def test_samples_are_spread_evenly_over_their_pixel(written):
    """One in each of 64 columns and rows: their mean is the mean over the pixel, but for a 64th of
    what it changes from side to side, at the most."""
    light = [Light((1, -3, 1))]
    camera = replace(AT_BALL, angle=12, resolution=(12, 10))  # inside of the outline
    image = rendered(written([ball(1, MATT)], light), camera, samples=64)

    def seen(columns, rows):
        place = meet_ball(camera.eye, film_points(camera, columns, rows))
        return shade(camera.eye, place, place, MATT, light)

    steps = (np.arange(8) + 0.5) / 8
    columns, rows = np.meshgrid(*(np.add.outer(np.arange(n), steps).ravel() for n in (12, 10)))
    mean = seen(columns, rows).reshape(10, 8, 12, 8, 3).mean(axis=(1, 3))
    columns, rows = np.meshgrid(np.arange(13), np.arange(11))
    across, down = (np.abs(np.diff(seen(columns, rows), axis=axis)) for axis in (1, 0))
    change = np.maximum(across[:-1], across[1:]) + np.maximum(down[:, :-1], down[:, 1:])
    assert (np.abs(image.rgb - mean) < change / 64 + 1e-5).all()


@pytest.mark.parametrize("samples", [1, 4, 7, 16])
@pytest.mark.parametrize("axis", [0, 1], ids=["upright", "level"])
def test_an_edge_through_a_pixel_covers_the_part_that_is_behind_it(written, samples, axis):
    """Of samples in columns and rows of their own one more or less is on either side."""
    camera = Camera((0, 0, 1), (0, 0, 0), (0, 1, 0), angle=90, resolution=(16, 16))
    edge = 0.3  # in an image from -1 to 1: 10.4 pixels from the left, or from below
    wall = np.array(square(0, 9.0))
    wall[:, axis] = np.minimum(wall[:, axis], edge)
    alpha = rendered(written([("polygons", wall, [4], MATT)], [LAMP]), camera, samples=samples)
    lines = alpha.channels["A"] if axis == 0 else alpha.channels["A"][::-1].T
    assert (lines[:, :10] == 1).all() and (lines[:, 11:] == 0).all()
    assert (np.abs(lines[:, 10] - 0.4) < 1 / samples).all()
    assert np.ptp(lines[:, 10]) > 0  # no two pixels have the same samples


def test_the_film_is_the_mean_of_four_corners(written):
    """Each corner alone, by a camera that looks there through a very small angle."""
    lights = LIGHTS["two colors"]
    scene = written([ball(1, MATT), floor(-1, 5, MATT)], lights, (0, 0.5, 1))
    camera = replace(AT_BALL, eye=(1, -6, 2), resolution=(5, 4))
    each = [
        [rendered(scene, replace(camera, at=ahead, angle=1e-7, resolution=(1, 1))).rgba[0, 0]
         for ahead in row]
        for row in camera.eye + corner_rays(camera)
    ]  # fmt: skip
    assert 0.2 < np.mean(each, axis=(0, 1))[3] < 1
    close(rendered(scene, camera).rgba, film(each), rtol=1e-5)
