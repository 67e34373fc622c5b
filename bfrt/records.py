"""Every record that touches disk or crosses a phase, declared once.

All are little-endian and packed. ``records.pxd`` has the C twins; ``tests/test_records.py`` holds
the two together. Positions and directions are float64, because all arithmetic is. On disk geometry
is float32 or float64, and boxes are float32, rounded outwards: they make up most of what is read.

===========  =====  ==========================================================================
record       bytes  what it is
===========  =====  ==========================================================================
RAY             72  a ray in flight: origin, direction, nearest hit so far, where its walk is
PATH            24  what a ray is for: film element, sample, weight, kind; power is a query's
QUEUED          72  a ray that waits in a queue, on disk where memory ends
HIT             88  an intersection that waits for shading
CANDIDATE        8  voxel (30 bits), ray (21), face (3): a ray stored in a voxel
MATERIAL        32  a material of the palette
PARENT          32  a box of a hierarchy's level: around its children, and where they end
TREELET         48  a treelet: the box around it, its objects and its nodes
NODE            80  a node of a treelet's tree, or of the tree above: eight quantised boxes
QUERY_PATH      24  a PATH of a ray that somebody asks about: its number, hits counted
QUERY_RAY       88  a HIT with a QUERY_PATH
CROSSING        24  a place where a ray in flight crosses an object
DELAYED         24  a ray in flight that has met a box, and waits for the object's geometry
===========  =====  ==========================================================================
"""

from __future__ import annotations

import enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Kind(enum.IntEnum):
    """Numbers the kinds of primitives, in the order of object ids.

    What a store and its readers know of a kind is in `FACTS`; its shape has a file of its own,
    and a case in the switch of bfrt/geometry/shape.pxd. ``records.pxd`` numbers the kinds alike.
    """

    SPHERE = 0
    CONE = 1
    TRIANGLE = 2
    PATCH = 3
    POLYGON = 4

    @property
    def label(self) -> str:
        """Return the name, small."""
        return self.name.lower()

    @property
    def scalars(self) -> int:
        """Return the coordinates of one record."""
        return FACTS[self].scalars

    @property
    def boxed(self) -> bool:
        """Tell whether boxes are stored beside records, which are larger."""
        return FACTS[self].boxed

    @property
    def counted(self) -> bool:
        """Tell whether an object has records of a number of its own: vertices."""
        return FACTS[self].counted


class KindFacts(NamedTuple):
    """Holds what is stored of a kind."""

    scalars: int
    boxed: bool
    counted: bool


FACTS = {
    Kind.SPHERE: KindFacts(4, boxed=False, counted=False),
    Kind.CONE: KindFacts(8, boxed=True, counted=False),
    Kind.TRIANGLE: KindFacts(9, boxed=True, counted=False),
    Kind.PATCH: KindFacts(18, boxed=True, counted=False),
    Kind.POLYGON: KindFacts(3, boxed=True, counted=True),
}


class RayKind(enum.IntEnum):
    """Numbers the reasons for which a ray is sent."""

    EYE = 0
    REFLECTION = 1
    REFRACTION = 2
    SHADOW = 3


KINDS = len(Kind)

#: Coordinates of one record; a polygon's is one vertex.
SCALARS = {kind: kind.scalars for kind in Kind}

_LINE = [(name, "<f8") for name in ("ox", "oy", "oz", "dx", "dy", "dz")]
_NEAREST = [("t", "<f8"), ("id", "<u8")]
_PATH = [
    ("pixel", "<u4"),
    ("sample", "<u4"),
    ("red", "<f4"),
    ("green", "<f4"),
    ("blue", "<f4"),
    ("kind", "<u2"),
    ("power", "<i2"),
]
_QUERY_PATH = [
    ("number", "<u8"),
    ("moved", "<f8"),
    ("count", "<u4"),
    ("kind", "<u2"),
    ("power", "<i2"),
]

LINE = np.dtype(_LINE)
RAY = np.dtype(
    [
        *_LINE,
        *_NEAREST,
        ("voxel", "<u4"),
        ("face", "u1"),
        ("kind", "u1"),
        ("lock", "u1"),
        ("state", "u1"),
    ]
)
PATH = np.dtype(_PATH)
QUEUED = np.dtype(_LINE + _PATH)
HIT = np.dtype(_LINE + _NEAREST + _PATH)
QUERY_PATH = np.dtype(_QUERY_PATH)
QUERY_RAY = np.dtype(_LINE + _NEAREST + _QUERY_PATH)
CROSSING = np.dtype([("t", "<f8"), ("id", "<u8"), ("ray", "<u4"), ("unused", "<u4")])
DELAYED = np.dtype([("id", "<u8"), ("first", "<i8"), ("count", "<u4"), ("ray", "<u4")])
MATERIAL = np.dtype(
    [
        ("red", "<f4"),
        ("green", "<f4"),
        ("blue", "<f4"),
        ("kd", "<f4"),
        ("ks", "<f4"),
        ("shine", "<f4"),
        ("transmittance", "<f4"),
        ("ior", "<f4"),
    ]
)

_SIDES = [(name, "<f4") for name in ("lox", "loy", "loz", "hix", "hiy", "hiz")]
PARENT = np.dtype([*_SIDES, ("end", "<i8")])
TREELET = np.dtype([*_SIDES, ("first", "<u8"), ("node", "<u8"), ("count", "<u4"), ("nodes", "<u4")])
NODE = np.dtype(
    [
        ("low", "<f4", 3),
        ("exponent", "i1", 3),
        ("inner", "u1"),
        ("child", "<u4"),
        ("first", "<u4"),
        ("count", "u1", 8),
        ("lo", "u1", (3, 8)),
        ("hi", "u1", (3, 8)),
    ]
)

RAY_BYTES = 72
PATH_BYTES = 24
QUEUED_BYTES = 72
HIT_BYTES = 88
QUERY_PATH_BYTES = 24
QUERY_RAY_BYTES = 88
CROSSING_BYTES = 24
DELAYED_BYTES = 24
CANDIDATE_BYTES = 8
MATERIAL_BYTES = 32
PARENT_BYTES = 32
TREELET_BYTES = 48
NODE_BYTES = 80
BOX_BYTES = 24
CODE_BYTES = 6  # a box quantised in its parent's
OFFSET_BYTES = 4  # a polygon's end, counted in vertices
FILM_BYTES = 32  # four 64-bit sums: R G B A
AOV_BYTES = 24  # Z, N, 64-bit id
POSITION_BYTES = 12  # P.X P.Y P.Z, where it is asked for
ALBEDO_BYTES = 12  # albedo.R albedo.G albedo.B, likewise

#: What the film and the image keep of the first sample only where it is asked for, by the name
#: that asks for it, and its bytes a film element or a pixel: three float32 channels.
ON_REQUEST = {"position": POSITION_BYTES, "albedo": ALBEDO_BYTES}

VOXEL_BITS = 30
RAY_BITS = 21
FACE_BITS = 3

#: Of an id (bfrt/ids.py): those of an object's place in its stream; of a stream's number: of its
#: kind.
INDEX_BITS = 48
KIND_BITS = 4
STREAM_BITS = 64 - INDEX_BITS
NO_HIT = (1 << 64) - 1

for _dtype, _bytes in (
    (RAY, RAY_BYTES),
    (PATH, PATH_BYTES),
    (QUEUED, QUEUED_BYTES),
    (HIT, HIT_BYTES),
    (QUERY_PATH, QUERY_PATH_BYTES),
    (QUERY_RAY, QUERY_RAY_BYTES),
    (CROSSING, CROSSING_BYTES),
    (DELAYED, DELAYED_BYTES),
    (MATERIAL, MATERIAL_BYTES),
    (PARENT, PARENT_BYTES),
    (TREELET, TREELET_BYTES),
    (NODE, NODE_BYTES),
):
    if _dtype.itemsize != _bytes:
        raise TypeError(f"{_dtype} has {_dtype.itemsize} bytes, not {_bytes}")


def plain(records: NDArray[Any]) -> NDArray[Any]:
    """View records as plain bytes, to copy: NumPy copies field by field, ten times slower."""
    return records.view(f"V{records.dtype.itemsize}")
