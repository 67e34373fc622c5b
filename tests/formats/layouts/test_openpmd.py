"""openPMD: iterations, species, units, offsets and constants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from layout_files import RNG, h5part, h5py, naive_openpmd, openpmd, species_of
from meshes import convert, failure, outcome, shades, shapes_of, spheres

from bfrt.conversion.contents import describe_file
from bfrt.errors import SettingError
from bfrt.formats import arrays as arrays_module

ROWS = RNG.random((20, 3)).astype("f4")
CELLS = RNG.integers(0, 1000, (20, 3))
MASS = np.arange(20.0)
CELL = 0.125


def test_positions_are_in_meters_with_their_offsets(file, small_blocks):
    openpmd(file, {200: {"e": species_of(ROWS, CELL, CELLS, CELL, weighting=(MASS, 1.0))}})
    rows = naive_openpmd(file, 200, "e")
    assert np.array_equal(rows, (ROWS.astype("f8") + CELLS) * CELL)
    for positions in (None, "e", "e/position", "data/200/particles/e", "/data/200/particles/e/"):
        store = convert(file, radius=0.5, positions=positions, color_by="weighting")
        assert shapes_of(store) == spheres(rows, 0.5)
        assert store.streams[0].wide and len(set(shades(store))) > 10


def test_what_has_no_unit_and_no_offset_stays_as_it_is(file):
    zero = dict.fromkeys("xyz", (0, 20))
    openpmd(file, {0: {"e": species_of(ROWS, offset=zero)}})
    store = convert(file, radius=0.5)
    assert shapes_of(store) == spheres(ROWS, 0.5) and not store.streams[0].wide
    openpmd(file, {0: {"e": species_of(ROWS)}})
    assert convert(file, radius=0.5).checksum == store.checksum


def test_constants(file, small_blocks):
    """A record component of one number, as positions and as columns."""
    flat = dict(zip("xy", ROWS.T, strict=False)) | {"z": (2.5, 20)}
    move = {"x": (8, 20), "y": (0.0, 20), "z": (np.float64(-4), 20)}
    records = {
        "position": (flat, 2.0),
        "positionOffset": (move, 0.5),
        "radius": ((3, 20), 0.25),
        "weighting": (MASS, 1.0),
    }
    openpmd(file, {7: {"e": records}})
    rows = naive_openpmd(file, 7, "e")
    assert set(rows[:, 2]) == {3.0}
    assert shapes_of(convert(file, color_by="weighting")) == spheres(rows, 0.75)


def test_the_last_iteration_or_the_one_that_is_asked_for(file):
    """By their numbers, which names do not sort by."""
    numbers = [100, 20, 3000]
    openpmd(file, {n: {"e": species_of(ROWS + n)} for n in numbers})
    order = sorted(numbers)
    for frame, number in [(None, 3000), (-1, 3000), (0, 20), (1, 100), (-2, 100), (2, 3000)]:
        assert shapes_of(convert(file, radius=1, frame=frame)) == spheres(ROWS + number, 1)
    for number in order:
        store = convert(file, radius=1, positions=f"data/{number}/particles/e/position")
        assert shapes_of(store) == spheres(ROWS + number, 1)
    said = failure(file, SettingError, radius=1, frame=3)
    assert said == "steps of openPMD: found frame=3, expected one of 3, 0 to 2 or -3 to -1"
    said = failure(file, SettingError, radius=1, frame=0, positions="data/20/particles/e")
    assert said.startswith("found frame=0 and positions='data/20/particles/e', which are of step")


def test_iterations_of_fields_alone_are_no_steps(file):
    openpmd(file, {5: {"e": species_of(ROWS)}})
    with h5py.File(file, "a") as made:
        made["data/10/fields/rho"] = np.zeros((3, 3))
    assert shapes_of(convert(file, radius=1)) == spheres(ROWS, 1)


def test_several_species_are_refused_and_listed(file):
    openpmd(file, {5: {name: species_of(ROWS + k) for k, name in enumerate("ep")}})
    said = failure(file, radius=1)
    assert "found data/5/particles/e/position/x (20,) float32" in said
    assert "data/5/particles/p/position/x" in said and said.endswith("positions= with its name")
    assert shapes_of(convert(file, radius=1, positions="p")) == spheres(ROWS + 1, 1)


def test_other_paths_and_no_number_in_them(file):
    openpmd(file, {9: {"e": species_of(ROWS)}}, "/run/it%T/", "p/q/")
    assert shapes_of(convert(file, radius=1)) == spheres(ROWS, 1)
    openpmd(file, {0: {"e": species_of(ROWS)}}, "/run/", "p/")
    assert shapes_of(convert(file, radius=1, frame=0)) == spheres(ROWS, 1)


def test_columns_have_units_too(file):
    heat = species_of(ROWS, 1.0, heat=(MASS, 10.0))
    openpmd(file, {0: {"e": heat}})
    asked = {"radius": 1, "color_by": "heat", "colormap": "gray"}
    found = shades(convert(file, **asked))
    assert shades(convert(file, **asked, color_range=(0, 190))) == found
    assert set(shades(convert(file, **asked, color_range=(0, 1900)))) != set(found)
    whole = species_of(ROWS, id=(np.arange(20, dtype="u8") + (1 << 60), 1.0))
    openpmd(file, {0: {"e": whole}})
    assert convert(file, radius=1, color_by="id").objects == 20


# --- what is wrong -------------------------------------------------------------------------------


@pytest.mark.parametrize("unit", [None, np.nan, np.inf, 0.0, "one", [1.0, 2.0]])
def test_a_unit_that_is_none(file, unit):
    openpmd(file, {0: {"e": species_of(ROWS, unit)}})
    said = failure(file, radius=1)
    assert said.startswith("data/0/particles/e/position/x: found unitSI=")
    assert said.endswith("expected a number that makes SI units of it, as openPMD has it")


def test_an_offset_of_another_length(file):
    offset = dict(zip("xyz", CELLS.T, strict=True)) | {"y": CELLS[:7, 1]}
    openpmd(file, {0: {"e": species_of(ROWS, 1.0, offset)}})
    said = failure(file, radius=1)
    assert said.startswith("data/0/particles/e/positionOffset/y: found int64 of shape (7,)")


@pytest.mark.parametrize(("value", "shape"), [("a", [20]), ([1.0, 2.0], [20]), (1.0, [-1]),
                                              (1.0, []), (1.0, [2.5]), (1.0, "20"),
                                              (1.0, [1 << 62])])  # fmt: skip
def test_a_constant_that_is_none(file, value, shape):
    openpmd(file, {0: {"e": species_of(ROWS)}})
    with h5py.File(file, "a") as made:
        group = made["data/0/particles/e/position"]
        del group["z"]
        made_here = group.create_group("z")
        made_here.attrs["value"], made_here.attrs["shape"] = value, shape
        made_here.attrs["unitSI"] = 1.0
    assert failure(file, radius=1).startswith("data/0/particles/e/position/z: found value=")


def test_attributes_of_no_use(file):
    openpmd(file, {0: {"e": species_of(ROWS)}})
    with h5py.File(file, "a") as made:
        made.attrs["basePath"] = 3
    assert failure(file, radius=1).startswith("found basePath=3, expected a path, as openPMD has")
    with h5py.File(file, "a") as made:
        made.attrs["basePath"] = np.zeros(5000)
    assert "attribute basePath of shape (5000,)" in failure(file, radius=1)
    with h5py.File(file, "a") as made:
        made.attrs["basePath"] = np.zeros(2, [("a", "f4")])
    assert failure(file, radius=1).startswith("/: found 'attribute basePath of ndarray'")
    with h5py.File(file, "a") as made:
        made.attrs["basePath"] = h5py.Empty("f4")
    assert failure(file, radius=1).startswith("/: found 'attribute basePath of Empty'")


def test_two_axes_alone_are_refused(file):
    columns = dict(zip("xz", ROWS.T, strict=False))
    openpmd(file, {0: {"e": {"position": (columns, 1.0)}}})
    said = failure(file, radius=1)
    assert said.startswith("found data/0/particles/e/position/x (20,) float32, data/0/particles/e/")


def test_a_file_of_meshes_alone_is_listed(file):
    """The standard asks for no path of particles where there are none."""
    with h5py.File(file, "w") as made:
        made.attrs["openPMD"], made.attrs["basePath"] = "1.1.0", "/data/%T/"
        made["data/5/fields/rho"] = np.zeros((4, 5, 6))
    assert [row["name"] for row in describe_file(str(file))["contents"]] == ["data/5/fields/rho"]
    assert failure(file, radius=1).startswith("found data/5/fields/rho (4, 5, 6) float64, expected")


def test_two_layouts_are_refused(file):
    h5part(file, {3: (ROWS + 1, {})})
    with h5py.File(file, "a") as made:
        made.attrs["openPMD"], made.attrs["basePath"] = "1.0.0", "/data/%T/"
        made.attrs["particlesPath"] = "particles/"
        for k, axis in enumerate("xyz"):
            made[f"data/0/particles/e/position/{axis}"] = ROWS[:, k]
            made[f"data/0/particles/e/position/{axis}"].attrs["unitSI"] = 1.0
    said = failure(file, radius=1)
    assert said.startswith("found data/0/particles of openPMD, Step#3 of H5Part, expected one")
    assert shapes_of(convert(file, radius=1, positions="Step#3")) == spheres(ROWS + 1, 1)
    assert shapes_of(convert(file, radius=1, positions="data/0/particles/e")) == spheres(ROWS, 1)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_not_finite(file, bad):
    rows = ROWS.copy()
    rows[4, 1] = bad
    openpmd(file, {0: {"e": species_of(rows, CELL, CELLS, CELL)}})
    assert failure(file, radius=1).startswith("point 4: found ")
    store = convert(file, radius=1, skip_invalid=True)
    assert shapes_of(store) == spheres(np.delete(naive_openpmd(file, 0, "e"), 4, axis=0), 1)


@pytest.mark.parametrize("seed", range(4))
def test_a_file_cut_or_flipped_anywhere(file, seed):
    random = np.random.default_rng(seed)
    openpmd(file, {n: {"e": species_of(ROWS, CELL, CELLS, CELL)} for n in (0, 10)})
    data = file.read_bytes()
    for cut in range(seed, len(data), len(data) // 6):
        file.write_bytes(data[:cut])
        failure(file, radius=1)
    for _ in range(3):
        flipped = bytearray(data)
        for place in random.integers(0, len(data), 3):
            flipped[place] = random.integers(0, 256)
        file.write_bytes(flipped)
        outcome(file, radius=1)


@settings(max_examples=15, deadline=None)
@given(
    rows=st.integers(0, 9),
    unit=st.sampled_from([1.0, 1e-6, 3, -2.0]),
    offset_unit=st.sampled_from([1.0, 0.1]),
    constant=st.booleans(),
    dtype=st.sampled_from(["f4", "f8", ">f4", "i2"]),
    block=st.integers(1, 10),
    frame=st.sampled_from([None, 0, 1]),
)
def test_as_a_naive_reader(
    tmp_path_factory, rows, unit, offset_unit, constant, dtype, block, frame
):
    path = tmp_path_factory.mktemp("openpmd") / "a.h5"
    iterations = {}
    for number in (4, 12):
        own = (RNG.random((rows, 3)) * 100).astype(dtype)
        offset = dict.fromkeys("xyz", (number, rows)) if constant else own.astype("i8")
        iterations[number] = {"ions": species_of(own, unit, offset, offset_unit)}
    openpmd(path, iterations)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays_module, "POINTS_AT_ONCE", block)
        store = convert(path, radius=0.5, frame=frame)
    found = naive_openpmd(path, 4 if frame == 0 else 12, "ions")
    assert shapes_of(store) == spheres(found, 0.5)
