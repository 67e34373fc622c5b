"""What is read of a .npy file: its arrays in are objects out."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from array_files import (
    CENTERS,
    DTYPES,
    MASS,
    NARROW,
    RADII,
    RNG,
    TRIANGLES,
    colors,
    header_of,
    records,
    save_as,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, outcome, shapes_of, spheres
from properties import examples

from bfrt.errors import SceneError, SettingError, ShortReadError
from bfrt.formats import arrays as arrays_module


@pytest.mark.parametrize("dtype", DTYPES)
def test_spheres_of_any_numbers(npy, dtype):
    rows = RNG.integers(0, 100, (20, 4)).astype(dtype)
    np.save(npy, rows)
    store = convert(npy)
    assert shapes_of(store) == spheres(rows[:, :3], rows[:, 3])
    assert [stream.wide for stream in store.streams] == [dtype not in NARROW]


@pytest.mark.parametrize("shape", [(9, 3, 3), (9, 9)])
@pytest.mark.parametrize("dtype", ["f4", "f8", ">f4"])
def test_triangles(npy, shape, dtype, small_blocks):
    np.save(npy, TRIANGLES.reshape(shape).astype(dtype))
    assert shapes_of(convert(npy)) == [tuple(map(tuple, t)) for t in TRIANGLES.tolist()]


def test_points_need_a_radius(npy):
    np.save(npy, CENTERS)
    assert "points without a radius, expected radius=" in failure(npy, SettingError)
    for radius in (2, 0.5, np.float32(0.5), np.int64(3)):
        assert shapes_of(convert(npy, radius=radius)) == spheres(CENTERS, float(radius))


def test_a_radius_that_is_given_is_that_of_spheres_too(npy):
    np.save(npy, np.column_stack([CENTERS, RADII]))
    assert shapes_of(convert(npy, radius=2)) == spheres(CENTERS, 2)


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_numbers_are_stored_untouched(npy, dtype, small_blocks):
    rows = RNG.normal(size=(50, 4)).astype(dtype)
    np.save(npy, rows)
    store = convert(npy, order="given")
    (stream,) = store.streams
    assert stream.path("geometry").read_bytes() == rows.tobytes()
    assert any(store.origin) == (dtype == "f8")


def test_many_blocks_of_triangles(npy):
    """More than a block: threads work on what was read, and it is nobody else's then."""
    rows = RNG.normal(size=(150_000, 9)).astype(np.float32)
    np.save(npy, rows)
    (stream,) = convert(npy, order="given").streams
    assert stream.path("geometry").read_bytes() == rows.tobytes()


@given(
    st.sampled_from(DTYPES),
    st.sampled_from([(3,), (4,), (9,), (3, 3)]),
    st.integers(0, 20),
    st.integers(2, 9),
    st.sampled_from([(1, 0), (2, 0), (3, 0)]),
)
@settings(max_examples=25)
def test_round_trip(tmp_path_factory, dtype, row, count, block, version):
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    array = np.random.default_rng(count).integers(0, 100, (count, *row)).astype(dtype)
    save_as(path, array, version)
    points = row in ((3,), (4,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays_module, "POINTS_AT_ONCE", block)
        found = shapes_of(convert(path, radius=1 if row == (3,) else None))
    flat = array.reshape(count, np.prod(row)).astype(float)
    if points:
        assert found == spheres(flat[:, :3], flat[:, 3] if row == (4,) else 1)
    else:
        assert np.array_equal(np.array(found).reshape(-1), flat.reshape(-1))


def test_map_coordinates_keep_centimeters(npy):
    rows = np.array([[500_000.0, 5_400_000.0, 300.0, 0.01], [500_000.05, 5_400_000.0, 300.0, 0.01]])
    np.save(npy, rows)
    store = convert(npy)
    assert shapes_of(store) == spheres(rows[:, :3], rows[:, 3])
    assert np.linalg.norm(np.subtract(store.origin, rows[0, :3])) < 1
    assert shapes_of(convert(npy, dtype="float32"))[0] != shapes_of(convert(npy))[1]


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_records(npy, version, small_blocks):
    save_as(npy, records(mass=MASS, r=RADII, tag=np.full(20, "é")), version)
    store = convert(npy, radius="r", color_by="mass", colormap="gray")
    assert shapes_of(store) == spheres(CENTERS, RADII)
    shades = [color[0] for color in colors(store)]
    assert shades == sorted(shades) and shades[0] == 0 and shades[-1] == 1
    assert shapes_of(convert(npy, radius=1)) == spheres(CENTERS, 1)


def test_records_of_other_kinds(npy):
    rgb = RNG.integers(0, 256, (20, 3)).astype("u1")
    np.save(npy, records(rgb=rgb, radius=RADII.astype(">f4")))
    store = convert(npy, color_by="rgb")
    assert shapes_of(store) == spheres(CENTERS, RADII)
    assert len(set(colors(store))) == len(np.unique(rgb, axis=0))
    fields = np.zeros(20, np.dtype([("pos", "f8", 3), ("m", "f4")], align=True))
    fields["pos"] = CENTERS
    np.save(npy, fields)
    assert shapes_of(convert(npy, radius=1)) == spheres(CENTERS, 1)
    mixed = np.zeros(20, [("x", "f4"), ("y", "f8"), ("z", "i2")])
    np.save(npy, mixed)
    assert convert(npy, radius=1).streams[0].wide


def test_names_of_fields_in_any_script(npy):
    rows = np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("Dichte ρ", "f4")])
    with pytest.warns(UserWarning, match="format 3"):
        np.save(npy, rows)
    assert convert(npy, radius=1, color_by="Dichte ρ", color_range=(0, 1)).objects == 4


@pytest.mark.parametrize(
    "fields",
    [
        [("x", "U3"), ("y", "f4"), ("z", "f4")],
        [("x", "M8[s]"), ("y", "f4"), ("z", "f4")],
        [("x", "f4", 2), ("y", "f4"), ("z", "f4")],
        [("x", "f4"), ("y", "f4")],
        [("x\n", "f4")],
    ],
)
def test_records_without_positions(npy, fields):
    np.save(npy, np.zeros(5, fields))
    assert "expected one array named as one of spheres, centers," in failure(npy, radius=1)


def test_records_in_two_dimensions_are_those_of_a_map(npy, small_blocks):
    """As of a cloud that is kept as the sensor saw it."""
    np.save(npy, records(mass=MASS).reshape(4, 5))
    store = convert(npy, radius=1, color_by="mass", colormap="gray")
    assert shapes_of(store) == spheres(CENTERS, 1)
    shades = [color[0] for color in colors(store)]
    assert shades == sorted(shades) and len(set(shades)) == 20


def test_records_in_more_dimensions(npy):
    np.save(npy, records().reshape(2, 2, 5))
    assert failure(npy, radius=1).startswith("found x (2, 2, 5) float32, y (2, 2, 5) float32, z")


@pytest.mark.parametrize("save", ["npy", "npz"])
@pytest.mark.parametrize("form", [str.lower, str.upper, str.capitalize])
@pytest.mark.parametrize("names", [("red", "green", "blue"), ("r", "g", "b")])
@pytest.mark.parametrize("dtype", ["u1", "u2", "i8", "f4"])
def test_colors_in_three_fields(npy, save, form, names, dtype, small_blocks):
    full = {"u1": 255, "u2": 65535, "i8": 255, "f4": 1}[dtype]
    rows = records(**{form(name): np.zeros(20, dtype) for name in names})
    rows[form(names[0])][:7] = full
    rows[form(names[2])][7:] = full
    path = npy if save == "npy" else npy.with_suffix(".npz")
    np.save(npy, rows) if save == "npy" else np.savez(path, cloud=rows, other=MASS)
    store = convert(path, radius=1, color_by="rgb")
    assert shapes_of(store) == spheres(CENTERS, 1)
    assert colors(store) == [(1, 0, 0)] * 7 + [(0, 0, 1)] * 13


@pytest.mark.parametrize("names", ["xyz", "XYZ"])
def test_positions_in_three_fields_or_arrays(npy, names, small_blocks):
    rows = np.zeros(20, [("mass", "f8"), *((name, "f4") for name in names)])
    for name, column in zip(names, CENTERS.T, strict=True):
        rows[name] = column
    rows["mass"] = MASS
    np.save(npy, rows)
    assert shapes_of(convert(npy, radius="mass")) == spheres(CENTERS, MASS)
    npz = npy.with_suffix(".npz")
    np.savez(npz, mass=MASS, **{name: rows[name] for name in names})
    assert shapes_of(convert(npz, radius="mass")) == spheres(CENTERS, MASS)
    np.savez(npz, cloud=rows, mass=MASS[:3])
    for positions in (None, "cloud", "/cloud/"):
        found = shapes_of(convert(npz, radius="mass", positions=positions))
        assert found == spheres(CENTERS, MASS)


def test_columns_of_two_lengths(npz):
    np.savez(npz, x=MASS, y=MASS[:7], z=MASS)
    words = "y: found float64 of shape (7,), expected numbers of shape (20,)"
    assert failure(npz, radius=1) == words


def test_records_in_records(npy, small_blocks):
    inner = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4")])
    rows = np.zeros(20, [("at", inner), ("speed", inner), ("mass", "f8")])
    for name, column in zip("xyz", CENTERS.T, strict=True):
        rows["at"][name] = column
    rows["mass"] = MASS
    np.save(npy, rows)
    words = "found at/x (20,) float32, at/y (20,) float32, at/z (20,) float32, speed/x (20,) float3"
    assert failure(npy, radius=1).startswith(words)
    store = convert(npy, positions="at", radius="mass", color_by="speed/x")
    assert shapes_of(store) == spheres(CENTERS, MASS)


@pytest.mark.parametrize("dtype", ["f4", "f8", ">f4"])
def test_a_map_of_positions(npy, dtype, small_blocks):
    array = CENTERS.reshape(4, 5, 3).astype(dtype)
    np.save(npy, array)
    assert shapes_of(convert(npy, radius=1)) == spheres(CENTERS, 1)
    npz = npy.with_suffix(".npz")
    rgb = np.zeros((4, 5, 3), "u1")
    rgb[..., 1] = 255
    np.savez(npz, points=array, colors=rgb, depth=MASS.reshape(4, 5), radii=RADII.reshape(4, 5))
    store = convert(npz, color_by="rgb")
    assert shapes_of(store) == spheres(CENTERS, RADII)
    assert set(colors(store)) == {(0, 1, 0)}
    assert len(set(colors(convert(npz, color_by="depth")))) == 20
    np.save(npy, np.asfortranarray(array[:, :2]))
    said = "found shape (4, 2, 3) in Fortran order, expected C order for more than two dimensions"
    assert failure(npy, radius=1) == said


def test_a_map_of_one_long_row_takes_no_memory(npy):
    header_of(npy, "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1 << 40, 3)}".replace(
        "1 << 40", str(1 << 40)
    ))  # fmt: skip
    tracemalloc.start()
    try:
        failure(npy, ShortReadError, radius=1)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("dtype", "most", "full"),
    [("u2", 255, 255), ("u2", 256, 65535), (">u2", 9, 255), ("i8", 255, 255), ("i4", 1, 1),
     ("u8", 256, 65535), ("i2", 200, 255)],
)  # fmt: skip
def test_colors_of_whole_numbers(npz, dtype, most, full, caplog, small_blocks):
    rgb = np.zeros((20, 3), dtype)
    rgb[13, 0] = most
    np.savez(npz, centers=CENTERS, colors=rgb)
    red = colors(convert(npz, radius=1, color_by="rgb"))[13][0]
    parts = np.rint(most / full * 31) / 31
    exact = ((parts + 0.055) / 1.055) ** 2.4 if parts > 0.04045 else parts / 12.92
    assert abs(red - exact) < 1e-6
    told = [f"{npz}: colors: colors of 16 bits go to {most} only: taken as of 8 bits"]
    assert caplog.messages == (told if "2" in dtype and full == 255 else [])


def test_colors_that_are_too_great(npz):
    np.savez(npz, centers=CENTERS, colors=np.full((20, 3), 65536))
    words = "colors: found a color of 65536, expected 0 to 65535"
    assert failure(npz, radius=1, color_by="rgb") == words


IN_ROWS = "expected numbers in rows, in Fortran order at most 16 in each"
BY_SHAPE = "expected (n, 3) or (h, w, 3) points, (n, 4) spheres, (n, 3, 3) or (n, 9) triangles"


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((17, 2)).T, f"found float64 of shape (2, 17) in Fortran order, {IN_ROWS}"),
        (np.array([[1, "a", None]], object), f"found object of shape (1, 3) in C order, {IN_ROWS}"),
        (np.float32(1), f"found float32 of shape () in C order, {IN_ROWS}"),
        (np.zeros(5), f"found float64 of shape (5,), {BY_SHAPE}"),
        (np.zeros((5, 5)), f"found float64 of shape (5, 5), {BY_SHAPE}"),
        (np.zeros((5, 3, 4)), f"found float64 of shape (5, 3, 4), {BY_SHAPE}"),
        (np.zeros((5, 3), "c8"), "found complex64 of shape (5, 3), expected numbers of 64 bits"),
        (np.zeros((5, 3), "U2"), "found <U2 of shape (5, 3), expected numbers of 64 bits"),
        (np.zeros((5, 9), "M8[s]"), "found datetime64[s] of shape (5, 9), expected numbers"),
    ],
)
def test_arrays_that_are_no_scene(npy, array, message):
    np.save(npy, array, allow_pickle=True)
    assert failure(npy, radius=None if array.shape[1:] == (9,) else 1).startswith(message)


def test_long_doubles(npy):
    if np.dtype(np.longdouble).itemsize == 8:
        pytest.skip("a long double is a double here")
    np.save(npy, CENTERS.astype(np.longdouble))
    assert "expected numbers of 64 bits or fewer" in failure(npy, radius=1)


@pytest.mark.parametrize(
    ("text", "version"),
    [
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 3)}", 1),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (True, 3)}", 1),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': 3}", 1),
        ("{'descr': ('<f4', (3,)), 'fortran_order': False, 'shape': (4,)}", 1),
        ("{'descr': '<f4', 'fortran_order': 1, 'shape': (4, 3)}", 1),
        ("{'descr': '<q9', 'fortran_order': False, 'shape': (4, 3)}", 1),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3)", 1),
        ("{'descr': '<f4', 'fortran_order': False, 'shape': (4, 3)", 3),
        ("{'descr': '<f4'}", 2),
        ("'''", 1),
        ("(" * 3000, 1),
        ("[" * 9000, 3),
        ("-" * 9000 + "1", 2),
        ("\n\n\\\n \t x", 1),
        (" " * 20_000, 2),
        ("{}", 4),
    ],
)
def test_headers_that_are_none(npy, text, version):
    header_of(npy, text, version)
    failure(npy, radius=1)


def test_a_file_cut_at_any_byte(npy):
    np.save(npy, CENTERS[:3])
    data = npy.read_bytes()
    for size in [*range(0, 128, 9), *range(128, len(data))]:
        npy.write_bytes(data[:size])
        said = failure(npy, SceneError if size < 128 else ShortReadError, radius=1)
        if size >= 128:
            left = f"asked for 36 bytes at byte 128, found {size - 128}: the file is truncated"
            assert said == left


def test_data_behind_the_end(npy):
    np.save(npy, CENTERS[:3])
    with npy.open("ab") as file:
        file.write(b"x")
    said = "byte 164: found more bytes than an array of shape (3, 3) has, expected its end"
    assert failure(npy, radius=1) == said


@pytest.mark.parametrize("shape", ["(1 << 60, 3)", "(10 ** 30, 4)", "(1 << 40, 9)"])
def test_counts_that_lie_take_no_memory(npy, shape):
    counts = str(eval(shape))
    header_of(npy, f"{{'descr': '<f4', 'fortran_order': False, 'shape': {counts}}}")
    begin = time.monotonic()
    tracemalloc.start()
    try:
        failure(npy, ShortReadError, radius=None if "9" in shape else 1)
        assert tracemalloc.get_traced_memory()[1] < 16 << 20
    finally:
        tracemalloc.stop()
    assert time.monotonic() - begin < 5


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.booleans(),
)
@examples(40)
@pytest.mark.filterwarnings("ignore:Reading")
def test_flipped_bytes(tmp_path_factory, flips, of_records):
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    np.save(path, records(r=RADII) if of_records else CENTERS)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * min(len(data), 200))] = value
    path.write_bytes(data)
    outcome(path, radius=1)
