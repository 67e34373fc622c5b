"""Rays of every shape that people have: the answers are those of (n, 3), in that shape."""

from __future__ import annotations

import fast
import numpy as np
import pytest
from injected import holding
from scenes import hard_scenes, random_rays

import bfrt
from bfrt.errors import SceneError, SettingError
from bfrt.queries import given as given_module
from bfrt.scene import Scene

QUERIES = ("cast_rays", "occluded", "count_intersections", "list_intersections")
WAYS = {"base": "given", "sgb": "given", "tree": "spatial"}
ROWS, COLUMNS = 7, 11


@pytest.fixture(params=WAYS)
def asked(request, tmp_path, monkeypatch):
    """A scene, a refinement, and rays, (ROWS, COLUMNS, 3) each; they are taken a few at a time."""
    monkeypatch.setattr(given_module, "RAYS_AT_ONCE", 13)
    rng = np.random.default_rng(3)
    objects = hard_scenes(rng)["overlapping"]
    path = tmp_path / "s.bfrt"
    fast.write(objects, path, order=WAYS[request.param])
    rays = random_rays(rng, objects, 100)["random"]
    o, d = (part[: ROWS * COLUMNS].reshape(ROWS, COLUMNS, 3) for part in rays)
    with bfrt.open(path) as scene:
        yield scene, {"refine": request.param}, o, d


@pytest.fixture
def scene(tmp_path):
    """A sphere of radius 1."""
    with bfrt.SceneWriter(tmp_path / "ball.bfrt") as writer:
        writer.spheres([[0.0, 0, 0]], [1.0])
    with bfrt.open(tmp_path / "ball.bfrt") as opened:
        yield opened


def flat(array):
    return np.ascontiguousarray(array).reshape(-1, 3)


def assert_shaped(found, expected, lead):
    """The same numbers, in another leading shape; lists of hits have none."""
    assert found.keys() == expected.keys()
    for key, values in expected.items():
        row = values.shape[1:]
        shape = values.shape if "ray_splits" in expected else (*lead, *row)
        assert found[key].shape == shape and found[key].dtype == values.dtype
        np.testing.assert_array_equal(found[key], values.reshape(shape))
    assert found.stats.total.rays == expected.stats.total.rays


@pytest.mark.parametrize("name", QUERIES)
def test_maps_of_rays(asked, tmp_path, name):
    scene, way, o, d = asked
    query = getattr(scene, name)
    t_max = np.random.default_rng(4).uniform(0, 3, (ROWS, COLUMNS))
    expected = query(flat(o), flat(d), 0.0, t_max.ravel(), **way)
    both = np.concatenate([o, d], axis=-1)
    np.save(tmp_path / "o.npy", o)
    np.save(tmp_path / "both.npy", both)
    for given in (
        (o, d),
        (o.tolist(), d.tolist()),
        (np.asfortranarray(o), d[::-1][::-1]),
        (np.repeat(o, 2, axis=1)[:, ::2], d),
        (both, None),
        (both.tolist(), None),
        (np.asfortranarray(both), None),
        (np.ascontiguousarray(both.swapaxes(0, 1)).swapaxes(0, 1), None),
        (tmp_path / "o.npy", d),
        (tmp_path / "both.npy", None),
    ):
        assert_shaped(query(*given, 0.0, t_max, **way), expected, (ROWS, COLUMNS))
    spread = np.repeat(t_max, 2, axis=1)[:, ::2]
    assert_shaped(query(both, None, 0.0, spread, **way), expected, (ROWS, COLUMNS))


@pytest.mark.parametrize("name", QUERIES)
def test_rows_of_six(asked, tmp_path, name):
    scene, way, o, d = asked
    query = getattr(scene, name)
    expected = query(flat(o), flat(d), **way)
    six = np.hstack([flat(o), flat(d)])
    np.save(tmp_path / "six.npy", six)
    np.save(tmp_path / "fortran.npy", np.asfortranarray(six))
    n = (len(six),)
    for given in (
        six, six.tolist(), [*six], tuple(six), six[::-1][::-1], str(tmp_path / "six.npy"),
        tmp_path / "fortran.npy", np.lib.format.open_memmap(tmp_path / "six.npy", "r"),
    ):  # fmt: skip
        assert_shaped(query(given, **way), expected, n)
    blocks = [six[:5], six[5:6], tmp_path / "part.npy", (six[40:, :3], six[40:, 3:])]
    np.save(tmp_path / "part.npy", six[6:40])
    for some in (blocks, iter(blocks), [six[:40].reshape(8, 5, 6), six[40:]]):
        assert_shaped(query(some, **way), expected, n)
    pairs = [(six[:9, :3].tolist(), six[:9, 3:].tolist()), (six[9:, :3], six[9:, 3:])]
    assert_shaped(query(pairs, **way), expected, n)


@pytest.mark.parametrize("name", QUERIES)
def test_one_for_all(asked, tmp_path, name):
    """One origin of many directions, one direction of many origins, a column of either."""
    scene, way, o, d = asked
    query = getattr(scene, name)
    np.save(tmp_path / "d.npy", d)
    for one, other in (
        (o[0, 0], d), (o[0, 0].tolist(), d), (o, d[0, 0]), (o[:1, :1], d), (o[:, :1], d[:1]),
        (o[0, 0], tmp_path / "d.npy"),
    ):  # fmt: skip
        whole = np.load(other) if other is not d and not isinstance(other, np.ndarray) else other
        spread = [flat(part) for part in np.broadcast_arrays(one, whole)]
        assert_shaped(query(one, other, **way), query(*spread, **way), (ROWS, COLUMNS))


@pytest.mark.parametrize("name", QUERIES)
def test_one_ray(asked, name):
    scene, way, o, d = asked
    query = getattr(scene, name)
    expected = query(o[0, :1], d[0, :1], **way)
    assert_shaped(query(o[0, 0], d[0, 0], **way), expected, ())
    assert_shaped(query([*o[0, 0], *d[0, 0]], **way), expected, ())


@pytest.mark.parametrize("dtype", [">f4", ">f8", "<f4", "<i8", ">i2", "u1"])
def test_maps_of_any_numbers(scene, dtype):
    rng = np.random.default_rng(1)
    rays = rng.integers(1, 4, (3, 4, 6)).astype(dtype)
    expected = scene.cast_rays(rays.reshape(-1, 6).astype(float), t_max=9)
    assert_shaped(scene.cast_rays(rays, t_max=9), expected, (3, 4))


@pytest.mark.parametrize("held", [fast.ROOMY, None])
def test_answers_fill_maps(scene, tmp_path, held):
    """Arrays with gaps too, and files of that shape."""
    rng = np.random.default_rng(2)
    rays = rng.normal(size=(5, 6, 6))
    rays[..., 3:] = -rays[..., :3]
    asked = scene if held is None else holding(Scene(scene.store), held)
    expected = asked.cast_rays(rays.reshape(30, 6))
    assert np.isfinite(expected["t_hit"]).any()
    whole = {key: np.zeros((5, 12, *v.shape[1:]), v.dtype) for key, v in expected.items()}
    gaps = {key: values[:, ::2] for key, values in whole.items()}
    turned = {"t_hit": np.zeros((6, 5)).T, "primitive_normals": np.zeros((5, 6, 3), "f4", "F")}
    files = asked.cast_rays(rays, out=tmp_path / "out")
    for found in (asked.cast_rays(rays, out=gaps), asked.cast_rays(rays, out=turned), files):
        assert_shaped(found, expected, (5, 6))
    assert all(not values[:, 1::2].any() for values in whole.values())
    np.testing.assert_array_equal(turned["t_hit"].ravel(), expected["t_hit"])
    assert np.load(tmp_path / "out" / "primitive_normals.npy").shape == (5, 6, 3)
    with pytest.raises(SettingError, match=r"t_hit of float64 and shape \(30,\), expected .* 6\)"):
        asked.cast_rays(rays, out={"t_hit": np.zeros(30)})


def test_maps_of_nothing(scene):
    for shape in ((0, 3), (0, 4, 3), (4, 0, 3)):
        none = np.zeros(shape)
        assert scene.cast_rays(none, none)["primitive_normals"].shape == shape
    assert scene.occluded(np.zeros((0, 6)))["occluded"].shape == (0,)
    assert scene.occluded([])["occluded"].shape == (0,)


class Frame:
    ndim = 2
    """What pandas and its kin have."""

    columns = ("x", "y", "z")

    def __array__(self, dtype=None, copy=None):
        raise AssertionError("a frame is converted")

    def to_numpy(self):
        raise AssertionError("a frame is converted")


class LazyFrame(Frame):
    to_dask_array = None


class OnDevice:
    """An array that is not in memory, as torch has them on a graphics card."""

    def __array__(self, dtype=None, copy=None):
        raise TypeError("can't convert cuda:0 device type tensor to numpy")


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ((Frame(),), r"origins: found a Frame of .*, as frame.*\.to_numpy\(\) makes it"),
        ((Frame(), np.ones((2, 3))), r"origins: found a Frame"),
        ((np.ones((2, 3)), LazyFrame()), r"directions: .*\.to_dask_array\(lengths=True\) makes"),
        (([Frame()],), "rays: found a Frame of"),
        (([(np.ones((2, 3)), Frame())],), "directions: found a Frame of"),
        ((np.ones((2, 3)), OnDevice()), "directions: found OnDevice, of which NumPy says .can't"),
        ((np.ones((2, 3)), np.ones((2, 2, 3))[:, :, :2]), "directions: found float64 of shape"),
        ((np.ones((2, 4, 3)), np.ones((3, 4, 3))), r"found origins \(2, 4, 3\) and directions"),
        ((np.ones((2, 6), bool),), "directions: found none with origins of bool"),
        ((np.ones((2, 6), complex),), "directions: found none with origins of complex128"),
        ((np.ones((2, 5)),), r"none with origins of float64 and shape \(2, 5\), .* \(n, 6\)"),
        ((np.ones((2, 6)), np.ones((2, 6))), r"origins: found .* expected .* of shape \(n, 3\)"),
        ((5,), "directions: found none|origins: found int, expected an array, a file or blocks"),
        (([np.ones((2, 5))],), "rays: found a block|directions: found|origins: found"),
        (([[1, 2, 3, 4, 5, 6], [1, 2]],), "origins: found|rays: found"),
        ((np.ones((2, 3)), np.ones((2, 3)), 0.0, np.ones((2, 3))), "t_max: found float64 of sh"),
        ((np.ones((2, 3)), "five"), r"five: expected an \.npy file of directions"),
    ],
)
@pytest.mark.parametrize("name", QUERIES)
def test_refused_in_one_sentence(scene, name, arguments, what):
    with pytest.raises(SettingError, match=what) as caught:
        getattr(scene, name)(*arguments)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_a_frame_of_pandas_is_refused(scene):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(np.ones((2, 3)), columns=["x", "y", "z"])
    with pytest.raises(SettingError, match=r"a DataFrame of pandas, expected .*\.to_numpy\(\)"):
        scene.cast_rays(frame, frame)
    rows = frame[["x", "y", "z"]].to_numpy()
    assert scene.occluded(rows, -rows)["occluded"].all()
    ends = scene.cast_rays(rows, -rows, t_max=frame["x"])
    assert np.isfinite(ends["t_hit"]).all()


def test_files_that_are_no_rays(scene, tmp_path):
    np.save(tmp_path / "o.npy", np.ones((2, 4, 3)))
    np.save(tmp_path / "one.npy", np.ones((1, 4, 3)))
    np.save(tmp_path / "turned.npy", np.ones((2, 4, 6), order="F"))
    with pytest.raises(SettingError, match=r"found origins \(2, 4, 3\) and directions \(1, 4, 3"):
        scene.cast_rays(tmp_path / "o.npy", tmp_path / "one.npy")
    with pytest.raises(SettingError, match=r"in Fortran order, expected .* for origins"):
        scene.cast_rays(tmp_path / "turned.npy")
    with pytest.raises(SettingError, match="directions: found none with origins of float64"):
        scene.cast_rays(tmp_path / "o.npy")
    data = (tmp_path / "o.npy").read_bytes()
    (tmp_path / "cut.npy").write_bytes(data[:-8])
    with pytest.raises((bfrt.ShortReadError, SceneError)):
        scene.cast_rays(tmp_path / "cut.npy", np.ones(3))
