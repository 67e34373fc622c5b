"""E57 files as tests write them with pye57."""

from __future__ import annotations

import numpy as np
import pytest

pye57 = pytest.importorskip("pye57", reason="pye57 is not installed: bfrt[e57]")
from pye57 import libe57  # noqa: E402


def scan(count, seed=0, colored=True, spherical=False, invalid=False):
    """The columns of a scan, by the standard's names."""
    random = np.random.default_rng(seed)
    columns = {
        f"cartesian{axis}": random.uniform(-9, 9, count).astype(np.float32) for axis in "XYZ"
    }
    if spherical:
        columns = {
            "sphericalRange": random.uniform(1, 9, count),
            "sphericalAzimuth": random.uniform(-3, 3, count),
            "sphericalElevation": random.uniform(-1.5, 1.5, count),
        }
    columns["intensity"] = random.random(count).astype(np.float32)
    if colored:
        for name in ("Red", "Green", "Blue"):
            columns[f"color{name}"] = random.integers(0, 256, count).astype(np.uint8)
    if invalid:
        name = "sphericalInvalidState" if spherical else "cartesianInvalidState"
        columns[name] = (random.random(count) < 0.3).astype(np.int8)
    return columns


def node_of(image, name, column):
    if column.dtype.kind == "f":
        single = column.dtype.itemsize == 4
        precision = libe57.E57_SINGLE if single else libe57.E57_DOUBLE
        return libe57.FloatNode(image, 0.0, precision, -1e9, 1e9)
    return libe57.IntegerNode(image, 0, 0, 255)


def write(path, scans, poses=()):
    """A file of scans, each with its pose: a quaternion and a translation, or None."""
    file = pye57.E57(str(path), "w")
    image = file.image_file
    for number, columns in enumerate(scans):
        add_scan(file, image, columns, poses[number] if number < len(poses) else None)
    file.close()


def add_scan(file, image, columns, pose):
    made = libe57.StructureNode(image)
    made.set("guid", libe57.StringNode(image, "{1}"))
    if pose is not None:
        made.set("pose", libe57.StructureNode(image))
        for name, keys, numbers in zip(("rotation", "translation"), ("wxyz", "xyz"), pose,
                                       strict=True):  # fmt: skip
            part = libe57.StructureNode(image)
            for key, number in zip(keys, numbers, strict=True):
                part.set(key, libe57.FloatNode(image, float(number)))
            made["pose"].set(name, part)
    prototype = libe57.StructureNode(image)
    for name, column in columns.items():
        prototype.set(name, node_of(image, name, column))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    made.set("points", points)
    file.data3d.append(made)
    count = len(next(iter(columns.values())))
    if count:
        buffers = libe57.VectorSourceDestBuffer()
        held = [np.ascontiguousarray(column) for column in columns.values()]
        for name, column in zip(columns, held, strict=True):
            buffers.append(libe57.SourceDestBuffer(image, name, column, count, True, True))
        writer = points.writer(buffers)
        writer.write(count)
        writer.close()


def places(columns, pose=None):
    """The twin: where the valid points of a scan are."""
    if "cartesianX" in columns:
        rows = np.stack([columns[f"cartesian{axis}"].astype(np.float64) for axis in "XYZ"], -1)
    else:
        far, azimuth, elevation = (columns[f"spherical{n}"] for n in ("Range", "Azimuth",
                                                                      "Elevation"))  # fmt: skip
        rows = np.stack(
            [far * np.cos(elevation) * np.cos(azimuth), far * np.cos(elevation) * np.sin(azimuth),
             far * np.sin(elevation)], -1,
        )  # fmt: skip
    if pose is not None:
        w, *v = np.array(pose[0], np.float64) / np.linalg.norm(pose[0])
        v = np.array(v)
        rows = rows + 2 * w * np.cross(v, rows) + 2 * np.cross(v, np.cross(v, rows)) + pose[1]
    for name in ("cartesianInvalidState", "sphericalInvalidState"):
        if name in columns:
            rows = rows[columns[name] == 0]
    return rows
