"""The C twins in records.pxd are records.py's dtypes, field for field."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import bfrt
from bfrt import records
from bfrt.grid.grid import Grid
from bfrt.image.film import Film
from bfrt.phases._shading import Shader
from bfrt.phases._traversal import RayPool
from bfrt.phases.lighting import Lighting
from bfrt.phases.viewpoints import Viewpoints

PXD = (Path(bfrt.__file__).parent / "records.pxd").read_text()

#: What a packed C struct makes of a type.
TYPES = {
    "double": "<f8",
    "float": "<f4",
    "uint8_t": "u1",
    "int16_t": "<i2",
    "uint16_t": "<u2",
    "uint32_t": "<u4",
    "uint64_t": "<u8",
    "int64_t": "<i8",
}
TWINS = {
    "Ray": (records.RAY, 72),
    "Path": (records.PATH, 24),
    "Queued": (records.QUEUED, 72),
    "Hit": (records.HIT, 88),
    "QueryPath": (records.QUERY_PATH, 24),
    "QueryRay": (records.QUERY_RAY, 88),
    "Delayed": (records.DELAYED, 24),
    "Crossing": (records.CROSSING, 24),
    "Material": (records.MATERIAL, 32),
    "Treelet": (records.TREELET, 48),
    "Parent": (records.PARENT, 32),
}


def blocks(head):
    """Name and body lines, without comments, of the declarations that begin with `head`."""
    for name, body in re.findall(rf"^{head} ?(\w*):\n((?:    .*\n|\n)+)", PXD, re.MULTILINE):
        lines = (line.split("#")[0].split() for line in body.splitlines())
        yield name, [line for line in lines if line]


def constants():
    return {name: int(n) for _, lines in blocks("cdef enum") for name, _, n in lines}


def test_every_struct_is_packed_and_has_a_twin():
    assert re.findall(r"struct (\w+)", PXD) == list(TWINS)
    assert PXD.count("cdef packed struct") == len(TWINS)


@pytest.mark.parametrize("name", TWINS)
def test_struct_is_its_dtype(name):
    dtype, size = TWINS[name]
    twin = np.dtype(
        [(field, TYPES[kind]) for kind, field in dict(blocks("cdef packed struct"))[name]]
    )
    assert twin == dtype
    assert twin.fields == dtype.fields  # offsets too
    constant = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).upper()
    assert dtype.itemsize == size == getattr(records, f"{constant}_BYTES")


def test_a_query_s_ray_is_a_hit_with_another_path():
    """What traces the one traces the other: they differ in their last bytes alone."""
    shared = [name for name in records.HIT.names if name not in records.PATH.names]
    assert shared == [*records.LINE.names, "t", "id"]
    for name in [*shared, "kind", "power"]:
        assert records.QUERY_RAY.fields[name] == records.HIT.fields[name]
    start = records.HIT_BYTES - records.PATH_BYTES
    for record, path in (("HIT", records.PATH), ("QUERY_RAY", records.QUERY_PATH)):
        own = getattr(records, record).fields
        assert {name: (kind, start + at) for name, (kind, at) in path.fields.items()} == {
            name: own[name] for name in path.names
        }
    assert all(records.RAY.fields[name] == field for name, field in records.LINE.fields.items())


def settled(hits):
    grid = Grid((0, 0, 0), (1, 1, 1), (1, 1, 1), 0.0)
    RayPool(1, 1).retire(0, 0, grid, Film(1, 1, 1), np.zeros(3), hits)


def test_the_compiler_agrees():
    """A typed memoryview is held against the fields and offsets that the C struct has."""
    settled(np.zeros(0, records.HIT))  # and a pool views its memory as RAY and PATH
    Shader(
        np.zeros(0, records.MATERIAL),
        Lighting(np.zeros((1, 0, 7)), 1.0, 0, 1.0),
        Viewpoints(np.zeros((1, 3)), (), 1),
        np.zeros(3),
        Film(1, 1, 1),
    )
    for wrong in ([*records.HIT.descr[1:], records.HIT.descr[0]], records.HIT.descr[:-1]):
        with pytest.raises(ValueError, match="Buffer dtype mismatch"):
            settled(np.zeros(0, wrong))


def test_enumerations_are_the_same():
    found = constants()
    for kind in records.Kind:
        assert found[kind.name] == kind
    for why in records.RayKind:
        assert found[why.name] == why
    named = ("KINDS", "VOXEL_BITS", "RAY_BITS", "FACE_BITS", "INDEX_BITS", "KIND_BITS",
             "STREAM_BITS", "BOX_BYTES", "TREELET_BYTES", "NODE_BYTES", "CODE_BYTES",
             "OFFSET_BYTES")  # fmt: skip
    for name in named:
        assert found[name] == getattr(records, name)
    assert len(found) == len(records.Kind) + len(records.RayKind) + len(named)


def test_a_candidate_fills_its_bits():
    bits = records.VOXEL_BITS + records.RAY_BITS + records.FACE_BITS
    assert bits <= 8 * records.CANDIDATE_BYTES == 64


def test_no_hit_is_no_object():
    stream, index = divmod(records.NO_HIT, 1 << records.INDEX_BITS)
    assert (stream, index) == ((1 << 16) - 1, (1 << 48) - 1)  # the last of the last stream


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("CANDIDATE_BYTES", 8),
        ("BOX_BYTES", 6 * 4),
        ("CODE_BYTES", 6),
        ("OFFSET_BYTES", 4),
        ("FILM_BYTES", 4 * 8),
        ("AOV_BYTES", 4 + 3 * 4 + 8),
        ("POSITION_BYTES", 3 * 4),
        ("ALBEDO_BYTES", 3 * 4),
    ],
)
def test_bytes_that_a_budget_counts(name, size):
    assert getattr(records, name) == size


def test_scalars_of_each_kind():
    point, radius = 3, 1
    assert {
        records.Kind.SPHERE: point + radius,
        records.Kind.CONE: 2 * (point + radius),
        records.Kind.TRIANGLE: 3 * point,
        records.Kind.PATCH: 6 * point,
        records.Kind.POLYGON: point,
    } == records.SCALARS


def test_disk_records_are_little_endian():
    for dtype, _ in TWINS.values():
        assert all(field.str[0] in "<|" for field, _ in dtype.fields.values())
