"""Checks of all fields of a store's header, which no checksum replaces.

A check takes a value as JSON has it, and gives it back as the store uses it, or raises ValueError
with where it is, what was found and what was expected.
"""

from __future__ import annotations

import itertools
import json
import math
import zlib
from collections.abc import Callable, Mapping
from typing import Any

from bfrt.errors import SceneError
from bfrt.image.color_scale import ColorScale
from bfrt.records import INDEX_BITS, Kind
from bfrt.store._hierarchy import MOST_LEVELS
from bfrt.store.model import Camera, Light, Vector
from bfrt.streams.writer import FileWriter

#: The largest number of float32.
LARGEST = (2.0 - 2.0**-23) * 2.0**127

Check = Callable[[Any], Any]


def header_text(header: dict[str, Any]) -> str:
    """Return the only text of a header: sorted, indented, with its own checksum."""
    body = {key: value for key, value in header.items() if key != "checksum"}
    text = json.dumps(body, indent=1, sort_keys=True, allow_nan=False)
    body["checksum"] = zlib.crc32(text.encode())
    return json.dumps(body, indent=1, sort_keys=True, allow_nan=False) + "\n"


def facts_of(file: FileWriter) -> dict[str, int]:
    """Return what the header says of a file that was written."""
    return {"bytes": file.bytes, "crc32": file.checksum}


def digest_of(header: dict[str, Any]) -> int:
    """Return a checksum of the scene alone, the same whatever hierarchy the store has."""
    own = ("hierarchy", "checksum")
    scene = {key: value for key, value in header.items() if key not in own}
    scene["groups"] = [
        {**group, "streams": [_without_levels(stream) for stream in group["streams"]]}
        for group in header["groups"]
    ]
    return zlib.crc32(json.dumps(scene, sort_keys=True).encode())


def _without_levels(stream: dict[str, Any]) -> dict[str, Any]:
    files = {
        name: f
        for name, f in stream["files"].items()
        if name != "quantised" and not name.startswith("level")
    }
    return {**stream, "levels": [], "quantised": False, "files": files}


def _wrong(value: Any, expected: str) -> ValueError:
    return ValueError(f"found {value!r:.60}, expected {expected}")


def whole(end: int) -> Check:
    """Return a check for a whole number in [0, end)."""

    def check(value: Any) -> int:
        if type(value) is not int or not 0 <= value < end:
            raise _wrong(value, f"a whole number from 0 to {end - 1}")
        return value

    return check


def truth(value: Any) -> bool:
    """Check a value that is true or false."""
    if not isinstance(value, bool):
        raise _wrong(value, "true or false")
    return value


def string(value: Any) -> str:
    """Check a text, of whatever length."""
    if not isinstance(value, str):
        raise _wrong(value, "a text")
    return value


def real(value: Any) -> float:
    """Check a finite number."""
    if type(value) not in (int, float) or not abs(value) < math.inf:
        raise _wrong(value, "a finite number")
    try:
        return float(value)
    except OverflowError:
        raise _wrong(value, "a number that fits float64") from None


def listed(check: Check, length: int | None = None) -> Check:
    """Return a check for a list, of `length` things where that is given."""

    def check_all(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or length not in (None, len(value)):
            raise _wrong(value, "a list" if length is None else f"a list of {length}")
        return tuple(check(item) for item in value)

    return check_all


def named(check: Check) -> Check:
    """Return a check for a JSON object whose values all pass `check`."""

    def check_all(value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise _wrong(value, "an object")
        return {name: _field(name, check, item) for name, item in value.items()}

    return check_all


def fields(maybe: Mapping[str, Check] | None = None, /, **checks: Check) -> Check:
    """Return a check for a JSON object with these fields, perhaps some more, and no others."""
    more = maybe or {}
    known = {**checks, **more}

    def check_all(value: Any) -> dict[str, Any]:
        if not isinstance(value, dict) or set(value) - set(more) != set(checks):
            raise _wrong(value, f"an object with {', '.join(checks)}")
        return {name: _field(name, known[name], item) for name, item in value.items()}

    return check_all


def optional(check: Check) -> Check:
    """Return a check for null, or what `check` takes."""
    return lambda value: None if value is None else check(value)


def _field(name: str, check: Check, value: Any) -> Any:
    try:
        return check(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None


def crs(value: Any) -> str:
    """Check a reference system: a text, of which there is none where it is empty."""
    if not isinstance(value, str) or not value:
        raise _wrong(value, "a text")
    return value


def bounds(value: Any) -> tuple[Vector, Vector]:
    """Check the corners of a box, which are of boxes of float32."""
    lo, hi = listed(vector, 2)(value)
    if max(map(abs, (*lo, *hi))) > LARGEST:
        raise _wrong(value, f"coordinates that float32 has, up to {LARGEST:.3g}")
    if not all(a <= b for a, b in zip(lo, hi, strict=True)):
        raise _wrong(value, "a lower and a higher corner")
    return lo, hi


def camera(value: Any) -> Camera:
    """Check a camera, its ranges included."""
    try:
        return Camera(**CAMERA(value))
    except SceneError as error:
        raise ValueError(str(error)) from None


def scale(value: Any) -> ColorScale:
    """Check what colors say."""
    found = ColorScale(**SCALE(value))
    if not found.lo <= found.hi or (found.log and found.lo <= 0.0):
        raise _wrong(value, "a range, above 0 where it is of ratios")
    return found


def light(value: Any) -> Light:
    return Light(*listed(vector, 2)(value))


def stream(value: Any) -> dict[str, Any]:
    """Check one stream, whose numbers have to agree."""
    found: dict[str, Any] = STREAM(value)
    levels = found["levels"]
    if len(levels) > MOST_LEVELS or not all(
        0 < above <= below for below, above in itertools.pairwise([found["count"], *levels])
    ):
        raise _wrong(value["levels"], f"up to {MOST_LEVELS} levels, none larger than the one below")
    if found["quantised"] and not levels:
        raise _wrong(value["quantised"], "levels where boxes are quantised")
    if found["degenerate"] > found["count"] or found["material_bytes"] not in (0, 1, 2, 4):
        raise _wrong(value, "counts and widths that agree")
    if found["id_bytes"] not in (0, 4, 8):
        raise _wrong(value["id_bytes"], "0, 4 or 8")
    if found["treelets"] > found["nodes"] or (found["nodes"] and not found["id_bytes"]):
        raise _wrong(value["nodes"], "a node or more for each treelet, where there are ids")
    return found


def group(value: Any) -> dict[str, Any]:
    """Check one group: streams of ascending kinds; its number is its place, so ids pass."""
    found: dict[str, Any] = GROUP(value)
    for name, order in (
        ("streams", [s["kind"] for s in found["streams"]]),
        ("outliers", found["outliers"]),
    ):
        if any(a >= b for a, b in itertools.pairwise(order)):
            raise _wrong(value[name], f"{name} in ascending order")
    return found


vector = listed(real, 3)
FACTS = fields(bytes=whole(1 << 63), crc32=whole(1 << 32))
STREAM = fields(
    kind=whole(len(Kind)),
    count=whole(1 << INDEX_BITS),
    wide=truth,
    degenerate=whole(1 << INDEX_BITS),
    material=whole(1 << 32),
    material_bytes=whole(5),
    vertices=whole(1 << 32),
    largest=whole(1 << 32),
    levels=listed(whole(1 << INDEX_BITS)),
    quantised=truth,
    id_bytes=whole(9),
    treelets=whole(1 << INDEX_BITS),
    nodes=whole(1 << INDEX_BITS),
    treelet_bytes=whole(1 << INDEX_BITS),
    files=named(FACTS),
)
GROUP = fields(
    streams=listed(stream), grid_bounds=optional(bounds), outliers=listed(whole(1 << 64))
)
HIERARCHY = fields(s=real, n=whole(1 << 63), l=whole(MOST_LEVELS + 1), t=real, bits=whole(9))
CAMERA = fields(
    eye=vector,
    at=vector,
    up=vector,
    angle=real,
    hither=real,
    resolution=listed(whole(1 << 16), 2),
)

SCALE = fields(name=string, colormap=string, lo=real, hi=real, log=truth)

#: What only some scenes have: where they are, and what their colors say. The others have the header
#: that stores had before there were these fields.
SOME_HAVE = {"crs": crs, "colors": listed(scale)}

#: The header beside magic and version, which are looked at first.
HEADER_FIELDS = fields(
    SOME_HAVE,
    magic=lambda value: value,
    version=whole(1 << 31),
    origin=vector,
    bounds=optional(bounds),
    groups=listed(group),
    camera=optional(camera),
    lights=listed(light),
    background=vector,
    palette=FACTS,
    hierarchy=HIERARCHY,
    checksum=whole(1 << 32),
)

#: What was measured while a store was made: beside the header, which the same scene makes the same.
MADE_FIELDS = fields(hierarchy_seconds=real, local=listed(string), checksum=whole(1 << 32))
