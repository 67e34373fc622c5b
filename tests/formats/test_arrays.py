"""Arrays with names, in NumPy's files, in HDF5 and in LAS: what becomes of them."""

from __future__ import annotations

import numpy as np
import pytest

import bfrt
from bfrt.errors import BfrtError, SceneError, SettingError, ShortReadError
from bfrt.records import SCALARS, Kind

CENTERS = np.arange(30, dtype=np.float32).reshape(10, 3)
RADII = np.linspace(0.5, 1.5, 10, dtype=np.float32)
TRIANGLES = np.random.default_rng(1).normal(size=(7, 3, 3)).astype(np.float32)


def geometry(scene, kind):
    """A kind's records as the store has them."""
    (stream,) = (s for s in scene.streams if s.kind == kind)
    dtype = np.float64 if stream.wide else np.float32
    path = scene.path / "0" / kind.label / "geometry"
    return np.frombuffer(path.read_bytes(), dtype).reshape(-1, SCALARS[kind])


def convert(path, **settings):
    return bfrt.convert(path, path.with_suffix(".bfrt"), **settings).store


def refused(path, kind=SceneError, **settings):
    """A file is refused in one sentence, and nothing is left."""
    there = set(path.parent.iterdir())
    with pytest.raises(kind) as caught:
        convert(path, **settings)
    assert set(path.parent.iterdir()) == there
    message = str(caught.value)
    assert path.name in message and "\n" not in message
    return message


def test_npy_spheres_points_and_triangles(tmp_path):
    path = tmp_path / "a.npy"
    both = np.hstack([CENTERS, RADII[:, None]])
    np.save(path, both)
    assert (geometry(convert(path, order="given"), Kind.SPHERE) == both).all()
    np.save(path, CENTERS)
    assert (geometry(convert(path, radius=2, order="given"), Kind.SPHERE)[:, 3] == 2).all()
    assert "expected radius=" in refused(path, SettingError)
    for shape in ((7, 3, 3), (7, 9)):
        np.save(path, TRIANGLES.reshape(shape))
        found = geometry(convert(path, order="given"), Kind.TRIANGLE)
        assert (found == TRIANGLES.reshape(7, 9)).all() and found.dtype == np.float32


def test_npy_of_doubles_keeps_centimeters_at_map_coordinates(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, CENTERS.astype(np.float64) * 0.01 + (5e5, 5e6, 0))
    scene = convert(path, radius=0.001)
    assert np.allclose(np.diff(geometry(scene, Kind.SPHERE)[:, 0]), 0.03, atol=1e-9)


def test_npy_records(tmp_path):
    path = tmp_path / "a.npy"
    rows = np.zeros(10, [(name, "f4") for name in ("mass", "z", "y", "x", "r")])
    rows["x"], rows["y"], rows["z"] = CENTERS.T
    rows["r"], rows["mass"] = RADII, np.arange(10)
    np.save(path, rows)
    found = convert(path, radius="r", color_by="mass", colormap="gray")
    assert (geometry(found, Kind.SPHERE) == np.hstack([CENTERS, RADII[:, None]])).all()
    assert len(found.materials()) == 257
    assert "expected one of" in refused(path, SettingError, radius="no")


@pytest.mark.parametrize(
    "array",
    [np.zeros((4, 5)), np.zeros(4), np.array(1.0), np.asfortranarray(np.ones((5, 17))),
     np.array([[None] * 3])],
    ids=["five", "flat", "scalar", "fortran", "objects"],
)  # fmt: skip
def test_npy_of_no_scene_is_refused(tmp_path, array):
    path = tmp_path / "a.npy"
    np.save(path, array, allow_pickle=True)
    assert "expected" in refused(path, radius=1)


def test_npy_cut_anywhere_is_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, CENTERS)
    data = path.read_bytes()
    for size in range(len(data)):
        path.write_bytes(data[:size])
        refused(path, (SceneError, ShortReadError), radius=1)
    path.write_bytes(data + b"1")
    refused(path, radius=1)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_is_told_by_names(tmp_path, save):
    path = tmp_path / "a.npz"
    save(path, positions=CENTERS, radii=RADII, heat=np.arange(10), other=np.array(["x"]))
    found = convert(path, color_by="heat")
    assert (geometry(found, Kind.SPHERE) == np.hstack([CENTERS, RADII[:, None]])).all()
    faces = np.array([[0, 1, 2], [2, 1, 3]], np.uint64)
    save(path, vertices=CENTERS, faces=faces)
    assert (geometry(convert(path), Kind.TRIANGLE) == CENTERS[faces].reshape(-1, 9)).all()
    save(path, vertices=CENTERS, faces=faces + np.uint64(9))
    assert "expected 0 to 9" in refused(path)
    save(path, centers=CENTERS, positions=CENTERS)
    assert "centers, positions" in refused(path, radius=1)


def test_npz_with_flipped_bytes_is_a_store_or_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, spheres=np.hstack([CENTERS, RADII[:, None]]))
    data = bytearray(path.read_bytes())
    random = np.random.default_rng(2)
    for _ in range(150):
        bad = data.copy()
        bad[random.integers(len(bad))] ^= 1 << random.integers(8)
        path.write_bytes(bad)
        try:
            convert(path)
        except BfrtError as error:
            assert "\n" not in str(error)


def test_what_is_not_finite_is_refused_or_dropped(tmp_path, caplog):
    path = tmp_path / "a.npy"
    some = CENTERS.copy()
    some[3, 1] = np.nan
    np.save(path, some)
    assert "point 3: found 9 nan 11" in refused(path, radius=1)
    assert convert(path, radius=1, skip_invalid=True).objects == 9
    assert "1 invalid objects were dropped" in caplog.text


def test_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        for part in (0, 1):
            group = file.create_group(f"PartType{part}")
            group.create_dataset("Coordinates", data=CENTERS + part, chunks=(3, 3))
            group.create_dataset("Masses", data=np.arange(10.0), compression="gzip")
        file["note"] = "text"
    assert "found PartType0/Coordinates (10, 3) float32, PartType1/" in refused(path, radius=1)
    found = convert(path, positions="PartType1/Coordinates", radius=1, color_by="Masses")
    assert (geometry(found, Kind.SPHERE)[:, :3] == CENTERS + 1).all()
    data = path.read_bytes()
    for size in range(0, len(data), 997):
        path.write_bytes(data[:size])
        refused(path, BfrtError, positions="PartType1/Coordinates", radius=1)


@pytest.mark.parametrize("suffix", ["las", "laz"])
def test_las(tmp_path, suffix):
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    pytest.importorskip("lazrs", reason="lazrs is not installed")
    path = tmp_path / f"a.{suffix}"
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = (5e5, 5e6, 0), (0.01, 0.01, 0.01)
    scan = laspy.LasData(header)
    scan.x, scan.y, scan.z = (CENTERS.astype(float) * 0.05 + (5e5, 5e6, 0)).T
    scan.red = scan.green = np.full(10, 65535)
    scan.intensity = np.arange(10)
    scan.write(path)
    read = laspy.read(path)
    found = convert(path, radius=0.01, color_by="rgb")
    places = geometry(found, Kind.SPHERE)[:, :3]  # float64 keeps what the file has
    assert (places == np.stack([read.x, read.y, read.z], axis=1)).all()
    assert found.streams[0].wide
    assert convert(path, radius=0.01, color_by="intensity").objects == 10
    assert "no dimension 'x1'" in refused(path, SettingError, radius="x1")
    refused(path, SettingError)
    data = path.read_bytes()
    for size in range(0, len(data) - 1, 31):
        path.write_bytes(data[:size])
        refused(path, BfrtError, radius=0.01)
