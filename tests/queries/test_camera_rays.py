"""The rays of a camera: those of the picture, by rows, in the shape of the image."""

from __future__ import annotations

import numpy as np
import pytest

import bfrt
from bfrt.errors import SettingError
from bfrt.store.model import Camera

FAR = (4e7, 5e7, -3e7)


@pytest.fixture(params=[(0.0, 0.0, 0.0), (5e5, 4.5e6, 120.0)], ids=["at zero", "far"])
def seen(request, tmp_path):
    """Spheres, and cameras near and far."""
    middle = np.array(request.param)
    near, far = middle + np.array([0.1, -4, 1]), middle + np.array(FAR)
    rng = np.random.default_rng(1)
    with bfrt.SceneWriter(tmp_path / "s.bfrt") as writer:
        writer.spheres(rng.uniform(-1, 1, (200, 3)) + middle, rng.uniform(0.05, 0.3, 200))
    cameras = [
        Camera(tuple(near), tuple(middle), angle=40.0, resolution=(33, 21)),
        Camera(tuple(far), tuple(middle), angle=3e-6, resolution=(16, 16)),
    ]
    with bfrt.open(tmp_path / "s.bfrt") as scene:
        yield scene, cameras


def doubled(camera):
    """The camera of an image with twice as many pixels: of its corners each fourth is a middle."""
    width, height = camera.resolution
    return Camera(**{**vars(camera), "resolution": (2 * width, 2 * height)})


def test_they_are_the_rays_of_the_picture(seen):
    """Depth is that of each pixel's upper left corner, with SPD's procedure."""
    scene, cameras = seen
    for camera in cameras:
        image = scene.render(camera=doubled(camera), aovs=["position"], threads=1)
        hits = scene.cast_rays(bfrt.camera_rays(camera), outputs=["positions"])
        expected = image.channels["Z"][1::2, 1::2]
        found = hits["t_hit"].astype(np.float32)
        assert 0.1 < np.isfinite(expected).mean() < 1.0
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
        if camera is cameras[0]:  # Z is the length from the eye to the place, of which t differs
            np.testing.assert_allclose(found, expected, rtol=2.0**-23)
        place = np.stack([image.channels[f"P.{axis}"][1::2, 1::2] for axis in "XYZ"], axis=-1)
        np.testing.assert_array_equal(hits["positions"].astype(np.float32), place)
        ids = image.ids[1::2, 1::2]
        hit = np.isfinite(expected)
        assert (ids[hit] & ((1 << 48) - 1) == hits["primitive_ids"][hit].astype(np.uint64)).all()


def test_they_are_of_the_image(seen):
    _, (camera, _) = seen
    rays = bfrt.camera_rays(camera)
    assert rays.shape == (21, 33, 6) and rays.dtype == np.float64
    assert (rays[..., :3] == camera.eye).all()
    np.testing.assert_allclose(np.linalg.norm(rays[..., 3:], axis=-1), 1.0, rtol=1e-15)
    forward = np.subtract(camera.at, camera.eye)
    np.testing.assert_allclose(rays[10, 16, 3:], forward / np.linalg.norm(forward), atol=1e-15)
    assert (rays[0, :, 5] > rays[-1, :, 5]).all()  # the first row is the top
    slope = np.tan(np.arccos(rays[0, 16, 3:] @ rays[10, 16, 3:]))
    np.testing.assert_allclose(slope, np.tan(np.radians(20)) * 20 / 21, rtol=1e-12)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [(slice(0, 5), (0, 5)), (slice(5, None), (5, 21)), (slice(-3, None), (18, 21)),
     (slice(20, 99), (20, 21)), (slice(7, 7), (7, 7)), (slice(9, 3), (9, 9)), (None, (0, 21))],
)  # fmt: skip
def test_rows(seen, rows, expected):
    _, (camera, _) = seen
    whole = bfrt.camera_rays(camera)
    found = bfrt.camera_rays(camera, rows=rows)
    np.testing.assert_array_equal(found, whole[slice(*expected)])


def test_a_camera_in_bands(seen, tmp_path):
    scene, (camera, _) = seen
    expected = scene.cast_rays(bfrt.camera_rays(camera))
    bands = (bfrt.camera_rays(camera, rows=slice(y, y + 4)) for y in range(0, 21, 4))
    found = scene.cast_rays(bands, out=tmp_path / "out")
    for key, values in expected.items():
        assert values.shape[:2] == (21, 33)
        np.testing.assert_array_equal(found[key].reshape(values.shape), values)


def test_a_row_of_the_largest_camera():
    camera = Camera((0, 0, 0), (0, 1, 0), resolution=(65535, 65535))
    rays = bfrt.camera_rays(camera, rows=slice(65534, None))
    assert rays.shape == (1, 65535, 6) and np.isfinite(rays).all()
    assert (rays[0, :, 5] < 0).all() and (np.diff(rays[0, :, 3]) > 0).all()


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"camera": None}, "camera: found NoneType, expected a Camera"),
        ({"rows": 5}, "rows: found 5, expected a slice of step 1"),
        ({"rows": slice(0, 9, 2)}, r"rows: found slice\(0, 9, 2\), expected a slice of step 1"),
        ({"rows": slice("a")}, "rows: found slice.*, expected a slice of step 1"),
    ],
)
def test_refused(given, what):
    with pytest.raises(SettingError, match=what):
        bfrt.camera_rays(**{"camera": Camera((0, 0, 0), (0, 1, 0)), **given})
