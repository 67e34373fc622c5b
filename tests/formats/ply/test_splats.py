"""Gaussian splats: told as such, with colors, radii and an opacity of their own."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from meshes import convert, failure, objects_of, shapes_of

import bfrt
from bfrt.errors import BudgetError, SettingError
from bfrt.formats.colors import linear
from bfrt.formats.room import COLORS, check_colors

NAMES = (
    "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2",
    *(f"f_rest_{k}" for k in range(45)), "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
)  # fmt: skip


def splats(count):
    random = np.random.default_rng(1)
    made = np.zeros(count, [(name, "<f4") for name in NAMES])
    for name in NAMES:
        made[name] = random.normal(size=count)
    return made


def write(path, made, more=""):
    kinds = {"f": "float", "u": "uint"}
    head = f"ply\nformat binary_little_endian 1.0\n{more}element vertex {len(made)}\n"
    for name in made.dtype.names:
        head += f"property {kinds[made.dtype[name].kind]} {name}\n"
    head += "end_header\n"
    path.write_bytes(head.encode() + made.tobytes())


def twin(made):
    """Centers and radii, and colors as they are rounded."""
    wide = {name: made[name].astype(np.float64) for name in NAMES}
    rows = np.stack([wide["x"], wide["y"], wide["z"]], -1)
    radii = np.exp((wide["scale_0"] + wide["scale_1"] + wide["scale_2"]) / 3)
    sh = 0.5 / np.sqrt(np.pi)
    colors = np.stack([np.clip(0.5 + sh * wide[f"f_dc_{k}"], 0, 1) for k in range(3)], -1)
    return rows, radii, linear(np.rint(colors * [31, 63, 31]) / [31, 63, 31])


def test_centers_radii_and_colors(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    path = tmp_path / "a.ply"
    made = splats(50)
    write(path, made)
    found = objects_of(convert(path, order="given"))
    rows, radii, colors = twin(made)
    shapes = np.array([each.shape[0] for each in found])
    assert np.array_equal(shapes[:, :3], rows)
    assert shapes[:, 3] == pytest.approx(radii, rel=1e-6)
    assert np.allclose([each.color for each in found], colors, atol=1e-6)
    assert f"{path}: 50 Gaussian splats, as opaque spheres" in caplog.messages


def test_an_opacity(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    path = tmp_path / "a.ply"
    made = splats(50)
    write(path, made)
    opaque = 1 / (1 + np.exp(-made["opacity"].astype(np.float64)))
    for least in (0, 0.5, 0.7, 1):
        shapes = shapes_of(convert(path, order="given", opacity=least))
        rows = twin(made)[0][opaque >= least]
        assert [shape[0][:3] for shape in shapes] == [tuple(row) for row in rows.tolist()]
    assert "50 Gaussian splats, as opaque spheres, those of an opacity of 0.7" in caplog.text
    for least in (-0.1, 1.5, np.nan, True, "0.5"):
        with pytest.raises(SettingError, match=r"^opacity: found .* from 0 to 1$"):
            convert(path, opacity=least)


def test_other_radii_and_colors(tmp_path):
    path = tmp_path / "a.ply"
    write(path, splats(20))
    assert {shape[0][3] for shape in shapes_of(convert(path, radius=2))} == {2}
    assert len({shape[0][3] for shape in shapes_of(convert(path, radius="auto"))}) == 1
    gray = convert(path, color_by="opacity", colormap="gray", radius="scale_0", skip_invalid=True)
    assert all(len(set(each.color)) == 1 for each in objects_of(gray))
    assert failure(path, SettingError, color_by="mass").startswith("found no mass of each splat")


def test_no_splats_have_no_opacity(tmp_path):
    path = tmp_path / "a.ply"
    made = np.zeros(3, [(name, "<f4") for name in NAMES[:-8]])
    write(path, made)
    assert "found opacity=0.5, expected none for .ply" in failure(
        path, SettingError, radius=1, opacity=0.5
    )


def test_colors_that_nobody_asked_for_need_room(tmp_path):
    assert check_colors("a.ply", 1 << 40, COLORS) is None
    with pytest.raises(BudgetError, match="found objects with colors of their own, expected a bud"):
        check_colors("a.ply", 1 << 40, COLORS - 1)
    path = tmp_path / "a.ply"
    write(path, splats(20))
    assert bfrt.convert(path, tmp_path / "a.bfrt", memory="60MiB").objects == 20


def test_an_opacity_that_is_no_number(tmp_path, caplog):
    path = tmp_path / "a.ply"
    made = splats(5)
    made["opacity"] = [9, np.nan, -9, np.inf, -np.inf]
    write(path, made)
    assert failure(path, opacity=0.5) == ("vertex 1: found an opacity of nan, expected a number")
    found = shapes_of(convert(path, order="given", opacity=0.5, skip_invalid=True))
    assert [shape[0][:3] for shape in found] == [tuple(row) for row in twin(made)[0][[0, 3]]]
    assert f"{path}: 1 invalid objects were dropped" in caplog.messages
    assert len(shapes_of(convert(path))) == 5


def test_packed_splats_are_told_as_such(tmp_path):
    path = tmp_path / "a.compressed.ply"
    names = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
    chunk = "element chunk 0\nproperty float min_x\n"
    write(path, np.zeros(3, [(name, "<u4") for name in names]), chunk)
    said = "found Gaussian splats that are packed (packed_position), expected x, y and z of each"
    assert failure(path, radius=1).startswith(said)


def test_flat_splats_have_two_lengths(tmp_path):
    path = tmp_path / "a.ply"
    made = splats(9)
    write(path, made[[name for name in NAMES if name != "scale_2"]].astype(
        [(name, "<f4") for name in NAMES if name != "scale_2"]))  # fmt: skip
    wide = made["scale_0"].astype(np.float64) + made["scale_1"]
    radii = [shape[0][3] for shape in shapes_of(convert(path, order="given"))]
    assert radii == pytest.approx(np.exp(wide / 2), rel=1e-6)
