"""What .npy and .npz files are refused for: not finite, not readable, not asked right."""

from __future__ import annotations

import errno

import numpy as np
import pytest
from array_files import CENTERS, FACES, MASS, RADII, SAVES, TRIANGLES, records
from failing import alone, refuse_reads, refuse_writes
from meshes import convert, failure, shapes_of, spheres

from bfrt.errors import SceneError, SettingError, ShortReadError, StreamError

# --- what is not finite --------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("column", [0, 2, 3])
def test_points_that_are_not_finite(npy, bad, column, small_blocks, caplog):
    rows = np.column_stack([CENTERS, RADII])
    rows[7, column] = rows[15, 0] = bad
    np.save(npy, rows)
    said = failure(npy)
    assert said.startswith("point 7: found ") and said.endswith(", expected finite numbers")
    good = np.delete(rows, [7, 15], axis=0)
    assert shapes_of(convert(npy, skip_invalid=True)) == spheres(good[:, :3], good[:, 3])
    assert caplog.messages == [f"{npy}: 2 invalid objects were dropped"]


def test_triangles_that_are_not_finite(npy, small_blocks, caplog):
    rows = TRIANGLES.copy()
    rows[4, 1, 2] = np.nan
    np.save(npy, rows)
    assert failure(npy).startswith("triangle 4: found ")
    assert convert(npy, skip_invalid=True).objects == 8
    assert "1 invalid objects were dropped" in caplog.text


def test_all_are_dropped(npy, caplog):
    np.save(npy, np.full((5, 3), np.nan))
    assert convert(npy, skip_invalid=True, radius=1).objects == 0
    assert "5 invalid objects" in caplog.text


def test_too_large_for_boxes(npy):
    np.save(npy, np.array([[1e39, 0, 0]]))
    assert failure(npy, radius=1).startswith("point 0: found 1e+39 0 0 1, expected finite")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("save", SAVES)
def test_fortran_order(npy, npz, save, small_blocks):
    """As the transpose of columns is saved."""
    flat = TRIANGLES.reshape(9, 9)
    for triangles in (TRIANGLES, flat):
        np.save(npy, np.asfortranarray(triangles))
        assert shapes_of(convert(npy)) == [tuple(map(tuple, rows)) for rows in TRIANGLES.tolist()]
        save(npz, triangles=np.asfortranarray(triangles))
        assert shapes_of(convert(npz)) == shapes_of(convert(npy))
    save(npz, positions=np.stack(list(CENTERS.T)).T, radii=RADII)
    assert shapes_of(convert(npz)) == spheres(CENTERS, RADII)


def test_fortran_order_cut_anywhere(npy):
    np.save(npy, np.asfortranarray(CENTERS))
    data = npy.read_bytes()
    for size in range(0, len(data), 7):
        npy.write_bytes(data[:size])
        failure(npy, ShortReadError if size >= 128 else SceneError, radius=1)
    npy.write_bytes(data + b"x")
    assert failure(npy, radius=1).startswith(f"byte {len(data)}: found more bytes than an array")


def test_radii_too_large_for_the_positions(npz):
    np.savez(npz, centers=CENTERS, radii=np.full(20, 1e200))
    assert failure(npz).startswith("point 0: found ")


# --- the system ----------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npy", ".npz", "compressed.npz"])
def test_a_read_that_is_refused(tmp_path, suffix, small_blocks, monkeypatch):
    path = tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(path, records(radius=RADII, mass=MASS))
    else:
        save = np.savez if suffix == ".npz" else np.savez_compressed
        save(path, centers=CENTERS, radii=RADII, mass=MASS)
    reads = refuse_reads(
        monkeypatch, path, lambda: convert(path, color_by="mass"), lambda: alone(path)
    )
    assert reads > 5


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_no_such_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    with pytest.raises(StreamError) as caught:
        convert(path)
    assert caught.value.errno == errno.ENOENT
    assert str(path) in str(caught.value)
    path.mkdir()
    with pytest.raises(StreamError):
        convert(path)


def test_a_full_disk_at_any_write(npz, monkeypatch):
    np.savez(npz, centers=CENTERS, radii=RADII, mass=MASS)
    refused = refuse_writes(monkeypatch, lambda: convert(npz, color_by="mass"), lambda: alone(npz))
    assert refused > 3


def test_progress_counts_bytes(npy, npz, small_blocks):
    np.save(npy, CENTERS)
    np.savez(npz, centers=CENTERS)
    for path in (npy, npz):
        done = []
        convert(path, radius=1, progress=done.append, order="given")
        assert done[-1] == max(done) == path.stat().st_size


# --- settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"triangulate": True}, "found triangulate=True, expected none for .npz files"),
        ({"radius": "no"}, "found no array 'no' for radius, expected one of centers (20, 3) fl"),
        ({"color_by": "no"}, "found no array 'no' for color_by, expected one of centers (20, 3)"),
        ({"color_by": "rgb"}, "expected one array of colors (n, 3), named as one of colors, rgb"),
        ({"color_by": "flat"}, "flat: found float64 of shape (7,), expected numbers of shape (20,"),
        ({"radius": "flat"}, "flat: found float64 of shape (7,), expected numbers of shape (20,)"),
        ({"color_by": "names"}, "names: found <U1 of shape (20,), expected numbers of shape (20,)"),
        ({"color_by": "centers"}, "centers: found float32 of shape (20, 3), expected numbers"),
        ({"color_range": (0, 1)}, "found without color_by, expected with it only"),
        ({"colormap": "gray"}, "found without color_by, expected with it only"),
        ({"color_by": "mass", "colormap": "no"}, "colormap: found 'no', expected viridis"),
        ({"radius": np.nan}, "radius: found nan, expected a finite number"),
    ],
)
def test_settings_that_do_not_fit(npz, asked, words):
    np.savez(npz, centers=CENTERS, mass=MASS, flat=np.ones(7), names=np.full(20, "a"))
    assert words in failure(npz, SettingError, **{"radius": 1, **asked})


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": 1}, "found radius=1, expected none for .npz files of this content"),
        ({"color_by": "flat"}, "found float64 of shape (7,), expected numbers of shape (20 or 12,"),
        ({"color_by": "rgb"}, "colors: found float64 of shape (7, 3), expected numbers of shape ("),
    ],
)
def test_settings_that_do_not_fit_a_mesh(npz, asked, words):
    np.savez(npz, vertices=CENTERS, faces=FACES, flat=np.ones(7), colors=np.ones((7, 3)))
    assert words in failure(npz, SettingError, **asked)


def test_settings_that_do_not_fit_triangles(npy):
    np.save(npy, TRIANGLES)
    for asked in ({"radius": 1}, {"triangulate": True}):
        assert "expected none for .npy files of this content" in failure(npy, SettingError, **asked)


def test_radii_of_another_length(npz):
    np.savez(npz, centers=CENTERS, radii=RADII[:7])
    assert "radii: found float32 of shape (7,), expected numbers of shape (20,)" in failure(
        npz, SettingError
    )


def test_nothing_to_color_by(npz):
    np.savez(npz, centers=CENTERS, mass=np.full(20, np.nan))
    said = "found no finite number to color by, expected one or more"
    assert failure(npz, radius=1, color_by="mass") == said
    assert convert(npz, radius=1, color_by="mass", color_range=(0, 1)).objects == 20
