"""What a state must be like, whoever wrote it: nothing in it leads outside of what there is.

Checksums tell what was damaged; these checks hold where they have been made anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import CheckpointError
from bfrt.ids import index_of, stream_of
from bfrt.records import HIT, NO_HIT, PATH, QUERY_PATH, QUERY_RAY, QUEUED, RAY, RayKind
from bfrt.stats import counters_of
from bfrt.store.header import (
    FACTS,
    SOME_HAVE,
    Check,
    bounds,
    camera,
    fields,
    light,
    listed,
    named,
    optional,
    real,
    stream,
    string,
    truth,
    vector,
    whole,
)
from bfrt.store.store import Store

#: What a ray's walk may be: new, on, over; and the faces by which it may have come.
STATES = 3
FACES = 7

#: More than any count.
MANY = 1 << 63


def text(value: Any) -> str:
    """Check a text that is not long."""
    if not isinstance(value, str) or len(value) > 200:
        raise ValueError(f"found {value!r:.60}, expected a text")
    return value


def moment(value: Any) -> int:
    """Check a time, in nanoseconds since 1970 or before."""
    if type(value) is not int or abs(value) >= MANY:
        raise ValueError(f"found {value!r:.60}, expected a time")
    return value


def place(value: Any) -> int:
    """Check an object's place in the order, or -1 where it has none so far."""
    if type(value) is not int or not -1 <= value < MANY:
        raise ValueError(f"found {value!r:.60}, expected a place")
    return value


def files(value: Any) -> dict[str, Any]:
    """Check what a header says of files, whose names are in the folder."""
    found: dict[str, Any] = named(FACTS)(value)
    for name in found:
        if name != Path(name).name or name in ("", ".", ".."):
            raise ValueError(f"found {name!r:.60}, expected a file's name")
    return found


def dict_of(value: Any) -> dict[str, Any]:
    """Check a JSON object."""
    return named(lambda item: item)(value)  # type: ignore[no-any-return]


def counts(value: Any) -> Any:
    """Check counters, or a part of them."""
    if not isinstance(value, dict):
        return real(value)
    return {name: counts(item) for name, item in value.items()}


def counters(value: Any) -> Any:
    """Check all counters of a depth."""
    try:
        return counters_of(counts(value))
    except (KeyError, TypeError, AttributeError):
        raise ValueError(f"found {value!r:.60}, expected counters") from None


def channel(value: Any) -> str:
    """Check the dtype of a picture's channel."""
    if value not in ("<f4", "<u4"):
        raise ValueError(f"found {value!r:.60}, expected <f4 or <u4")
    return str(value)


TRACER_FACTS = fields(group=whole(1 << 16), where=text, quota=whole(1 << 31))
STATS_FACTS = fields(marks_reused=truth, total=counters, depths=listed(counters))
RENDER_FACTS = fields(
    band=whole(1 << 17),
    depth=whole(MANY),
    rows=whole(1 << 17),
    row=whole(1 << 17),
    eye_rays=optional(whole(MANY)),
    image=named(channel),
    shading=truth,
    tracer=optional(TRACER_FACTS),
    done=whole(MANY),
    total=whole(MANY),
    bad=whole(MANY),
    stats=STATS_FACTS,
)
RAYS_FACTS = fields(taken=whole(MANY), bad=whole(MANY), checksums=listed(whole(1 << 32), 4))
QUERY_FACTS = fields(rays=RAYS_FACTS, tracer=TRACER_FACTS, done=whole(MANY), stats=STATS_FACTS)

#: What is known of a group of a store that is made, and of each of its streams.
COLUMN_FACTS = fields(
    count=whole(MANY),
    first=whole(1 << 32),
    width=whole(5),
    bytes=whole(MANY),
    crc32=whole(1 << 32),
)
ORDERED_FACTS = fields(
    done=whole(MANY),
    vertices=whole(MANY),
    treelets=whole(MANY),
    nodes=whole(MANY),
    treelet_bytes=whole(MANY),
    files=files,
    materials=COLUMN_FACTS,
)
ORDERING_FACTS = fields(places=listed(place), files=ORDERED_FACTS)
STREAM_FACTS = fields(header=stream, local=truth, made=truth, ordering=optional(ORDERING_FACTS))
GROUP_FACTS = fields(
    streams=listed(STREAM_FACTS),
    bounds=optional(bounds),
    grid_bounds=optional(bounds),
    outliers=listed(whole(1 << 64)),
    surface=real,
    seconds=real,
)
VIEW_FACTS = fields(SOME_HAVE, camera=optional(camera), lights=listed(light), background=vector)
CONVERSION_FACTS = fields(
    inputs=listed(optional(fields(bytes=whole(MANY), changed=moment))),
    uses=fields(names=listed(string), known=listed(string)),
    view=VIEW_FACTS,
    origin=optional(vector),
    palette=FACTS,
    groups=listed(GROUP_FACTS),
    whole=optional(whole(1 << 32)),
)

#: The header beside magic, format and checksum, which are looked at first.
HEADER_FACTS = fields(
    magic=text, format=whole(1 << 31), identity=dict_of, facts=dict_of, files=files
)


def check_facts(path: Path, facts: Any, check: Check) -> None:
    """Refuse facts of which one is missing, or is something else than it has to be."""
    try:
        check(facts)
    except ValueError as error:
        raise CheckpointError(f"{path}: {error}") from None


def expect(path: Path, name: str, found: object, *, right: bool) -> None:
    """Refuse a number that is not right."""
    if not right:
        raise CheckpointError(f"{path}: {name}: found {found!r:.60}, expected one of this work")


class Sound(NamedTuple):
    """Checks records, whose numbers lead to objects, to film elements, and to rays.

    Attributes
    ----------
    store : Store
        Ids are those of its objects.
    elements : tuple of 2 int, optional
        Film elements [first, last) that rays are for, in a render.
    rays : int
        Rays of a query, which are numbered from 0.
    """

    store: Store
    elements: tuple[int, int] | None = None
    rays: int = 0

    def check(self, path: Path, records: NDArray[Any]) -> None:
        """Refuse records of which one leads outside.

        Raises
        ------
        CheckpointError
            If one does; it names the file.
        """
        wrong = self._wrong(records) if len(records) else None
        if wrong is not None:
            raise CheckpointError(f"{path}: found a record whose {wrong} is not of this work")

    def _wrong(self, records: NDArray[Any]) -> str | None:
        """Return the name of a field that has a wrong value."""
        if self.elements is None and records.dtype in (HIT, PATH):
            records = records.view(QUERY_RAY if records.dtype == HIT else QUERY_PATH)
        names = records.dtype.names or ()
        if "kind" in names and (records["kind"] > max(RayKind)).any():
            return "kind"
        if "id" in names and not self._there(records["id"]).all():
            return "object"
        if "number" in names and (records["number"] >= self.rays).any():
            return "ray"
        if records.dtype in (HIT, PATH, QUEUED) and self.elements is not None:
            first, last = self.elements
            if ((records["pixel"] < first) | (records["pixel"] >= last)).any():
                return "pixel"
        if records.dtype == RAY and (
            records["lock"].any() or (records["state"] >= STATES).any()
            or (records["face"] >= FACES).any()
        ):  # fmt: skip
            return "walk"
        return None

    def _there(self, ids: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Tell which ids are of objects, or of none."""
        streams = self.store.streams
        counted = np.zeros(1 + max((s.number for s in streams), default=0), np.uint64)
        counted[[s.number for s in streams]] = [s.count for s in streams]
        numbers = stream_of(ids)
        known = numbers < len(counted)
        there = index_of(ids) < counted[np.where(known, numbers, 0).astype(np.int64)]
        found: NDArray[np.bool_] = (ids == NO_HIT) | (known & there)
        return found
