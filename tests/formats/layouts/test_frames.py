"""H5MD and H5Part, and frames of any arrays, in HDF5 and in .npz."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from layout_files import RNG, h5md, h5part, h5py
from meshes import convert, failure, shades, shapes_of, spheres

from bfrt.errors import SettingError, ShortReadError
from bfrt.formats import arrays as arrays_module

FRAMES = RNG.random((4, 20, 3)).astype("f4")
MASS = np.arange(20.0)
VALUE = "particles/all/position/value"
#: A frame that is asked for, and the place that it has of four.
ASKED = [(None, 3), (-1, 3), (0, 0), (2, 2), (-4, 0)]


# --- H5MD ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "place"), ASKED)
def test_a_frame_of_h5md(file, frame, place, small_blocks):
    elements = {"position": (FRAMES, True), "mass": (MASS, False),
                "heat": (np.stack([np.roll(MASS, k) for k in range(4)]), True)}  # fmt: skip
    h5md(file, {"all": elements})
    for positions in (None, "particles/all", "particles/all/position", VALUE):
        store = convert(file, radius="mass", color_by="heat", colormap="gray", frame=frame,
                        positions=positions)  # fmt: skip
        assert shapes_of(store) == spheres(FRAMES[place], MASS)
        assert np.argmin(shades(store)) == place


def test_a_frame_that_is_not_there(file):
    h5md(file, {"all": {"position": (FRAMES, True)}})
    said = failure(file, SettingError, radius=1, frame=4)
    assert said == f"{VALUE}: found frame=4, expected one of 4, 0 to 3 or -4 to -1"
    for frame in (1.5, "1", True):
        assert failure(file, SettingError, radius=1, frame=frame).startswith("frame: found ")


def test_elements_of_other_frames_are_refused(file):
    elements = {"position": (FRAMES, True), "heat": (np.stack([MASS, MASS]), True)}
    h5md(file, {"all": elements})
    said = failure(file, radius=1, color_by="heat")
    assert said == "particles/all/heat/value: found 2 frames, expected 4, as the positions have"


def test_several_groups_are_refused_and_listed(file):
    h5md(file, {name: {"position": (FRAMES + k, True)} for k, name in enumerate("ab")})
    said = failure(file, radius=1)
    assert said.startswith("found particles/a/position/value (4, 20, 3) float32, particles/b/posi")
    store = convert(file, radius=1, frame=1, positions="particles/b")
    assert shapes_of(store) == spheres((FRAMES + 1)[1], 1)


def test_a_frame_where_there_are_none(file):
    h5md(file, {"all": {"position": (FRAMES[0], False)}})
    assert shapes_of(convert(file, radius=1)) == spheres(FRAMES[0], 1)
    said = failure(file, SettingError, radius=1, frame=0)
    assert said.endswith("found frame=0, expected none for .h5 files of this content")


@pytest.mark.parametrize(("frame", "place"), ASKED)
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_of_the_same_names(tmp_path, save, frame, place, small_blocks):
    path = tmp_path / "a.npz"
    heat = np.stack([np.roll(MASS, k) for k in range(4)])
    save(path, **{VALUE: FRAMES, "particles/all/mass": MASS, "particles/all/heat/value": heat})
    store = convert(path, radius="mass", color_by="heat", colormap="gray", frame=frame)
    assert shapes_of(store) == spheres(FRAMES[place], MASS)
    assert np.argmin(shades(store)) == place
    path.write_bytes(path.read_bytes()[:-300])
    failure(path, radius="mass", frame=frame)


def test_npy_frames_are_a_map_unless_one_is_asked_for(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, FRAMES)
    assert shapes_of(convert(path, radius=1)) == spheres(FRAMES.reshape(-1, 3), 1)
    assert shapes_of(convert(path, radius=1, frame=1)) == spheres(FRAMES[1], 1)
    assert "expected one of 4" in failure(path, SettingError, radius=1, frame=-5)
    np.save(path, np.asfortranarray(FRAMES[:, :1]))
    assert "in Fortran order, expected C order" in failure(path, radius=1, frame=1)
    np.save(path, FRAMES)
    path.write_bytes(path.read_bytes()[:-1])
    failure(path, ShortReadError, radius=1, frame=-1)


# --- H5Part --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "number"), [(None, 10), (0, 1), (1, 2), (-1, 10)])
def test_a_step_of_h5part(file, frame, number, small_blocks):
    """By number, not by name."""
    h5part(file, {n: (FRAMES[0] + n, {"px": MASS, "q": MASS + 1}) for n in (1, 10, 2)})
    store = convert(file, radius="q", color_by="px", colormap="gray", frame=frame)
    assert shapes_of(store) == spheres(FRAMES[0] + number, MASS + 1)
    assert shades(store) == sorted(shades(store)) and len(set(shades(store))) == 20
    asked = convert(file, radius=1, positions=f"/Step#{number}")
    assert shapes_of(asked) == spheres(FRAMES[0] + number, 1)


def test_steps_of_npz(tmp_path):
    path = tmp_path / "a.npz"
    arrays = {f"Step#{n}/{a}": FRAMES[n][:, k] for n in range(4) for k, a in enumerate("xyz")}
    np.savez(path, **arrays)
    for frame, place in ASKED:
        assert shapes_of(convert(path, radius=1, frame=frame)) == spheres(FRAMES[place], 1)


def test_columns_of_other_lengths_are_refused(file):
    h5part(file, {0: (FRAMES[0], {"q": MASS[:3]})})
    assert failure(file, SettingError, radius="q").startswith("Step#0/q: found float64 of shape")
    with h5py.File(file, "a") as made:
        del made["Step#0/y"]
        made["Step#0/y"] = MASS[:5]
    assert failure(file, radius=1).startswith("Step#0/y: found float64 of shape (5,), expected")


@settings(max_examples=15, deadline=None)
@given(
    frames=st.integers(1, 4),
    rows=st.integers(0, 8),
    dtype=st.sampled_from(["f4", "f8", "i4", ">f8"]),
    chunk=st.booleans(),
    block=st.integers(1, 9),
    data=st.data(),
)
def test_as_a_naive_reader(tmp_path_factory, frames, rows, dtype, chunk, block, data):
    path = tmp_path_factory.mktemp("h5md") / "a.h5"
    array = (RNG.random((frames, rows, 3)) * 50).astype(dtype)
    frame = data.draw(st.integers(-frames, frames - 1))
    with h5py.File(path, "w") as made:
        how = {"chunks": (1, 3, 2), "compression": "gzip"} if chunk and rows >= 3 else {}
        made.create_dataset(VALUE, data=array, **how)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays_module, "POINTS_AT_ONCE", block)
        store = convert(path, radius=0.5, frame=frame)
    with h5py.File(path) as made:
        assert shapes_of(store) == spheres(made[VALUE][frame], 0.5)
