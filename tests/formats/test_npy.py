"""NumPy's files, .npy and .npz: arrays in are objects out, and broken ones are told of."""

from __future__ import annotations

import errno
import io
import itertools
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
from failing import alone, refuse_reads, refuse_writes
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, expected, failure, objects_of, outcome, shapes_of

from bfrt.errors import SceneError, SettingError, ShortReadError, StreamError
from bfrt.formats import arrays as arrays_module
from bfrt.formats import naming
from bfrt.records import Kind

RNG = np.random.default_rng(5)
CENTERS = RNG.normal(size=(20, 3)).astype(np.float32)
RADII = RNG.uniform(0.1, 1, 20).astype(np.float32)
MASS = np.arange(20.0)
TRIANGLES = RNG.normal(size=(9, 3, 3)).astype(np.float32)
FACES = RNG.integers(0, 20, (12, 3))

#: Whole numbers and floats that all these hold.
DTYPES = ["f2", "f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f4", ">f8", ">i2"]
#: Those that float32 holds without a loss.
NARROW = {"f2", "f4", ">f4", "i1", "u1", "i2", "u2", ">i2"}

SAVES = [np.savez, np.savez_compressed]


@pytest.fixture
def npy(tmp_path):
    return tmp_path / "a.npy"


@pytest.fixture
def npz(tmp_path):
    return tmp_path / "a.npz"


def spheres(centers, radii):
    """What `shapes_of` gives for these."""
    rows = np.column_stack([centers, np.broadcast_to(radii, len(centers))])
    return [(tuple(row),) for row in rows.astype(np.float64).tolist()]


def save_as(path, array, version):
    with path.open("wb") as file:
        np.lib.format.write_array(file, array, version, allow_pickle=True)


def header_of(path, text, version=1):
    """A file of a header and nothing behind it."""
    head = text.encode()
    size = len(head).to_bytes(2 if version == 1 else 4, "little")
    path.write_bytes(b"\x93NUMPY" + bytes([version, 0]) + size + head)


def colors(store):
    return [each.color for each in objects_of(store)]


# --- .npy ----------------------------------------------------------------------------------------


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
    store = convert(npy)
    (stream,) = store.streams
    assert stream.path("geometry").read_bytes() == rows.tobytes()
    assert any(store.origin) == (dtype == "f8")


def test_many_blocks_of_triangles(npy):
    """More than a block: threads work on what was read, and it is nobody else's then."""
    rows = RNG.normal(size=(150_000, 9)).astype(np.float32)
    np.save(npy, rows)
    (stream,) = convert(npy).streams
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


def records(**more):
    fields = [(axis, "f4") for axis in "xyz"] + [(name, a.dtype, a.shape[1:]) for name, a in
                                                 more.items()]  # fmt: skip
    rows = np.zeros(20, fields)
    rows["x"], rows["y"], rows["z"] = CENTERS.T
    for name, array in more.items():
        rows[name] = array
    return rows


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
@settings(max_examples=40)
@pytest.mark.filterwarnings("ignore:Reading")
def test_flipped_bytes(tmp_path_factory, flips, of_records):
    path = tmp_path_factory.mktemp("npy") / "a.npy"
    np.save(path, records(r=RADII) if of_records else CENTERS)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * min(len(data), 200))] = value
    path.write_bytes(data)
    outcome(path, radius=1)


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


# --- .npz ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("name", [*naming.CENTERS, "Coordinates", "snap/POS"])
def test_points_by_their_name(npz, save, name, small_blocks):
    other = {"a string": np.array("x"), "objects": np.array([None]), "number": np.float64(1)}
    order = {"fortran": np.asfortranarray(np.ones((3, 30))), "flat": np.ones(7)}
    save(npz, **{name: CENTERS}, **other, **order)
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("name", ["radii", "radius", "Radii"])
def test_radii_by_their_name(npz, save, name, small_blocks):
    save(npz, positions=CENTERS, **{name: RADII}, size=RADII * 2)
    assert shapes_of(convert(npz)) == spheres(CENTERS, RADII)
    assert shapes_of(convert(npz, radius="size")) == spheres(CENTERS, RADII * 2)
    assert shapes_of(convert(npz, radius=3)) == spheres(CENTERS, 3)


def test_spheres_with_their_radii(npz):
    np.savez(npz, spheres=np.column_stack([CENTERS, RADII]), mass=MASS)
    assert shapes_of(convert(npz)) == spheres(CENTERS, RADII)
    assert len(set(colors(convert(npz, color_by="mass")))) == 20


def test_positions_by_a_setting(npz):
    np.savez(npz, a=CENTERS, b=CENTERS + 1, vertices=CENTERS, faces=FACES)
    assert shapes_of(convert(npz, positions="b", radius=1)) == spheres(CENTERS + 1, 1)
    assert shapes_of(convert(npz, positions="vertices", radius=1)) == spheres(CENTERS, 1)
    assert failure(npz, SettingError, positions="c", radius=1) == (
        "found no array 'c' for positions, expected one of a (20, 3) float32, "
        "b (20, 3) float32, vertices (20, 3) float32, faces (12, 3) int64"
    )


def test_several_that_may_be_positions(npz):
    np.savez(npz, pos=CENTERS, points=CENTERS, mass=MASS)
    assert failure(npz, radius=1).startswith(
        "found pos (20, 3) float32, points (20, 3) float32, expected one array named as"
    )
    assert shapes_of(convert(npz, positions="pos", radius=1)) == spheres(CENTERS, 1)
    np.savez(npz, pos=CENTERS, points=np.array(["a", "b"]), xyz=MASS)
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


def test_none_that_may_be_positions(npz):
    np.savez(npz, **{f"a{i}": MASS for i in range(20)})
    first = ", ".join(f"a{i} (20,) float64" for i in range(8))
    assert failure(npz).startswith(f"found {first}, ..., expected one array named as one of")
    np.savez(npz, **{f"{i}" * 300: MASS for i in range(9)})
    assert failure(npz).startswith(f"found {'0' * 60}... (20,) float64, {'1' * 60}... (20,) float")
    np.savez(npz)
    assert failure(npz).startswith("found no arrays, expected one")


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">i4", ">u8"])
def test_meshes(npz, dtype, small_blocks):
    np.savez_compressed(npz, vertices=CENTERS, faces=FACES.astype(dtype), points=CENTERS)
    assert shapes_of(convert(npz)) == expected(CENTERS, FACES.tolist())


def test_meshes_of_squares(npz):
    faces = [[0, 1, 2, 3], [4, 5, 6, 7]]
    np.savez(npz, vertices=CENTERS, faces=faces)
    assert shapes_of(convert(npz, polygons=True)) == expected(CENTERS, faces)
    assert [s.kind for s in convert(npz, triangulate=True).streams] == [Kind.TRIANGLE]


def test_meshes_painted_by_vertices_or_faces(npz, small_blocks):
    paint = {"colormap": "gray", "color_range": (0, 20)}
    np.savez(npz, vertices=CENTERS, faces=FACES, v=MASS, f=np.arange(12), flag=MASS > 9)
    of_faces = [color[0] for color in colors(convert(npz, color_by="f", **paint))]
    assert of_faces == sorted(of_faces) and len(set(of_faces)) == 12
    of_vertices = [color[0] for color in colors(convert(npz, color_by="v", **paint))]
    means = FACES.mean(axis=1)
    for a, b in itertools.combinations(range(12), 2):
        assert (means[a] <= means[b]) == (of_vertices[a] <= of_vertices[b]) or means[a] == means[b]
    assert convert(npz, color_by="flag").objects == 12


@pytest.mark.parametrize("index", [20, -1, 2**31 - 1, 2**63, 2**64 - 1])
def test_indices_out_of_range(npz, index, small_blocks):
    faces = FACES.astype(np.int64 if index < 2**63 else np.uint64)
    faces[7, 1] = index
    np.savez(npz, vertices=CENTERS, faces=faces)
    shown = min(index, 2**63 - 1)
    assert failure(npz) == f"face 7: found vertex {shown}, expected 0 to 19"


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (CENTERS[:, :2], FACES, "vertices: found float32 of shape (20, 2), expected (n, 3)"),
        (CENTERS, FACES.astype("f4"), "faces: found float32 of shape (12, 3), expected (n, 3)"),
        (CENTERS, FACES[:, :2], "faces: found int64 of shape (12, 2), expected"),
        (CENTERS, FACES[0], "faces: found int64 of shape (3,), expected"),
        (CENTERS.astype("U4"), FACES, "vertices: found <U4 of shape (20, 3), expected numbers"),
    ],
)
def test_meshes_of_other_shapes(npz, vertices, faces, words):
    np.savez(npz, vertices=vertices, faces=faces)
    assert failure(npz).startswith(words)


@pytest.mark.parametrize("dtype", ["u1", "u2", ">u2", "f4", "f8"])
def test_colors_of_the_files_own(npz, dtype, small_blocks):
    full = {"u1": 255, "u2": 65535, ">u2": 65535}.get(dtype, 1)
    rgb = (np.array([[1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 1, 1]]) * full).astype(dtype)
    np.savez(npz, centers=CENTERS[:4], colors=rgb)
    assert colors(convert(npz, radius=1, color_by="rgb")) == [
        tuple(map(float, row)) for row in (rgb / full).tolist()
    ]
    np.savez(npz, vertices=CENTERS[:4], faces=FACES[:4] % 4, rgb=rgb)
    assert len(colors(convert(npz, color_by="rgb"))) == 4
    np.savez(npz, triangles=TRIANGLES[:4], color=rgb)
    assert colors(convert(npz, color_by="rgb"))[0] == (1, 0, 0)


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize(
    ("arrays", "asked"),
    [
        ({"positions": CENTERS, "radii": RADII, "mass": MASS}, {"color_by": "mass"}),
        ({"vertices": CENTERS, "faces": FACES, "mass": MASS}, {"color_by": "mass"}),
        ({"vertices": CENTERS, "faces": FACES, "heat": MASS[:12]}, {"color_by": "heat"}),
        ({"triangles": TRIANGLES, "heat": MASS[:9]}, {"color_by": "heat"}),
    ],
)
def test_blocks_of_any_size_make_the_same_store(npz, save, arrays, asked, monkeypatch):
    save(npz, **arrays)
    whole = convert(npz, **asked).checksum
    for size in (3, 19):
        monkeypatch.setattr(arrays_module, "POINTS_AT_ONCE", size)
        assert convert(npz, **asked).checksum == whole
    monkeypatch.undo()
    monkeypatch.setattr(arrays_module, "BLOCK_BYTES", 50)
    assert convert(npz, **asked).checksum == whole


def test_colors_are_the_same_for_blocks_of_any_size(npz, monkeypatch):
    np.savez(npz, centers=CENTERS, rgb=RNG.random((20, 3)))
    whole = objects_of(convert(npz, radius=1, color_by="rgb"))
    monkeypatch.setattr(arrays_module, "POINTS_AT_ONCE", 3)
    assert objects_of(convert(npz, radius=1, color_by="rgb")) == whole


def test_faces_of_many_corners_come_in_smaller_blocks(npz):
    """A face of a thousand corners takes what many of three take."""
    corners = np.tile(np.arange(1000), (4000, 1))
    vertices = np.column_stack([np.cos(corners[0]), np.sin(corners[0]), np.zeros(1000)])
    np.savez(npz, vertices=vertices.astype("f4"), faces=corners.astype("u2"))
    tracemalloc.start()
    try:
        assert convert(npz).objects == 4000
        assert tracemalloc.get_traced_memory()[1] < 700 << 20
    finally:
        tracemalloc.stop()


# --- broken zips ---------------------------------------------------------------------------------


def patched(data, local, central, value):
    """A zip with bytes of every local header and of every one in its directory replaced."""
    data = bytearray(data)
    for mark, offset in ((b"PK\x03\x04", local), (b"PK\x01\x02", central)):
        at = data.find(mark)
        while at >= 0:
            data[at + offset : at + offset + len(value)] = value
            at = data.find(mark, at + 4)
    return bytes(data)


@pytest.mark.parametrize(
    ("local", "central", "value", "words"),
    [
        (6, 8, b"\x01\x00", "encrypted"),
        (6, 8, b"\x20\x00", "patched"),
        (8, 10, b"\x63\x00", "compression method"),
        (8, 10, b"\x0c\x00", "expected"),  # bzip2, which this is not
        (8, 10, b"\x0e\x00", "expected"),  # nor LZMA
    ],
)
def test_zips_that_cannot_be_read(npz, local, central, value, words):
    np.savez_compressed(npz, centers=CENTERS)
    npz.write_bytes(patched(npz.read_bytes(), local, central, value))
    assert words in failure(npz, radius=1)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_zips_of_other_compressions(npz, method):
    with zipfile.ZipFile(npz, "w", method) as archive:
        buffer = io.BytesIO()
        np.save(buffer, CENTERS)
        archive.writestr("centers.npy", buffer.getvalue())
        archive.writestr("notes.txt", "not an array")
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)


@pytest.mark.parametrize("save", SAVES)
def test_a_zip_cut_at_any_byte(npz, save):
    save(npz, centers=CENTERS, radii=RADII)
    data = npz.read_bytes()
    for size in range(0, len(data), 23):
        npz.write_bytes(data[:size])
        failure(npz)


@pytest.mark.parametrize("save", SAVES)
def test_a_flipped_bit_of_the_data_is_noticed_or_changes_nothing(npz, save):
    save(npz, centers=CENTERS, radii=RADII)
    data = npz.read_bytes()
    good = convert(npz).checksum
    with zipfile.ZipFile(npz) as archive:
        info = archive.getinfo("radii.npy")
    last = data.find(b"PK\x01\x02")
    noticed = 0
    for place in range(last - info.compress_size, last, 11):
        bad = bytearray(data)
        bad[place] ^= 1 << place % 8
        npz.write_bytes(bad)
        try:
            assert convert(npz).checksum == good  # the bits behind a stream's end
        except SceneError:
            noticed += 1
    assert noticed >= info.compress_size // 11 - 1


@given(
    st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4),
    st.sampled_from(SAVES),
)
@settings(max_examples=40)
@pytest.mark.filterwarnings("ignore:Reading", "ignore:Duplicate")
def test_flipped_bytes_of_zips(tmp_path_factory, flips, save):
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    save(path, vertices=CENTERS, faces=FACES, heat=MASS)
    data = bytearray(path.read_bytes())
    for place, value in flips:
        data[int(place * len(data))] = value
    path.write_bytes(data)
    outcome(path, color_by="heat")


def test_what_is_no_zip(npz):
    for data in (b"", b"PK", b"PK\x05\x06" + bytes(18), bytes(1000)):
        npz.write_bytes(data)
        failure(npz)


def test_a_broken_array_that_nobody_needs(npz):
    with zipfile.ZipFile(npz, "w") as archive:
        for name, array in (("centers", CENTERS), ("broken", MASS)):
            buffer = io.BytesIO()
            np.save(buffer, array)
            data = buffer.getvalue()
            archive.writestr(f"{name}.npy", data if name == "centers" else data[:90])
    assert shapes_of(convert(npz, radius=1)) == spheres(CENTERS, 1)
    assert failure(npz, radius=1, color_by="broken").startswith("broken: found 'EOF")


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
        convert(path, radius=1, progress=done.append)
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
        ({"color_by": "mass", "colormap": "no"}, "colormap: found 'no', expected cubehelix"),
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
