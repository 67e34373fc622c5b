"""The file of a sharded scene: what it says of the scene, and of each shard.

The text is JSON as `bfrt.store.header.header_text` makes it, with its own checksum: sorted keys,
one space a level. All coordinates are relative to the origin, but for those of camera and lights.

::

    magic       "bfrt sharded scene"
    version     1
    origin      [x, y, z]                    of all shards
    bounds      [[x, y, z], [x, y, z]]       around all shards; null where there is no object
    camera, lights, background               as in a store's header: the first shard's
    shards      [{path         "scene.shards/00000-….bfrt", from the folder of the file on
                  header       {bytes, crc32}: the store's header, which vouches for its other files
                  checksum     the store's own, of the scene alone
                  group        number of its first group
                  groups       how many it has
                  materials    how many its palette has
                  bounds       as above, around its objects
                  streams      [[number, objects] …]: number as in ``geometry_ids``}, …]
    checksum    CRC-32 of the text without this line

The ids of a stream's objects are ``number << 48`` and on: `bfrt.ids`.
"""

from __future__ import annotations

import functools
import itertools
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

from bfrt.errors import StoreError
from bfrt.ids import MOST_GROUPS
from bfrt.paths import path_of
from bfrt.records import INDEX_BITS, KIND_BITS, STREAM_BITS, Kind
from bfrt.refusals import calling
from bfrt.store.extent import Bounds
from bfrt.store.file_facts import FileFacts
from bfrt.store.header import (
    FACTS,
    bounds,
    camera,
    fields,
    header_text,
    light,
    listed,
    optional,
    vector,
    whole,
)
from bfrt.store.model import Camera, Light, Vector
from bfrt.store.store import bounds_from, bounds_to
from bfrt.streams.atomic_write import write_parts

#: The suffix of a sharded scene.
SUFFIX = ".bfrts"

#: Letters of the path of a shard: no system takes more.
MOST_LETTERS = 4096

MAGIC = "bfrt sharded scene"
VERSION = 1


class ShardStream(NamedTuple):
    """Says how many objects a shard has of one kind in one group.

    Attributes
    ----------
    number : int
        The stream's number in the scene, as in ``geometry_ids``.
    objects : int
        How many it has.
    """

    number: int
    objects: int

    @property
    def group(self) -> int:
        """Return the number of the group."""
        return self.number >> KIND_BITS


@dataclass(frozen=True)
class Shard:
    """Describes a shard, as the file of its scene does.

    Attributes
    ----------
    path : str
        Where the store is, from the folder of the file on, with slashes.
    header : FileFacts
        Length and checksum of the store's header.
    checksum : int
        The store's own checksum of its scene.
    group : int
        Number of its first group in the scene.
    groups : int
        Number of its groups.
    materials : int
        Number of its materials.
    bounds : Bounds
        Around its objects, relative to the scene's origin.
    streams : tuple of ShardStream
        Ascending by number.
    """

    path: str
    header: FileFacts
    checksum: int
    group: int
    groups: int
    materials: int
    bounds: Bounds
    streams: tuple[ShardStream, ...]

    @property
    def objects(self) -> int:
        """Return the number of objects."""
        return sum(stream.objects for stream in self.streams)

    def fields(self) -> dict[str, Any]:
        """Return what the file says of it, for JSON."""
        return {
            "path": self.path,
            "header": {"bytes": self.header.bytes, "crc32": self.header.crc32},
            "checksum": self.checksum,
            "group": self.group,
            "groups": self.groups,
            "materials": self.materials,
            "bounds": bounds_to(self.bounds),
            "streams": [list(stream) for stream in self.streams],
        }


@dataclass(frozen=True)
class Manifest:
    """Holds what the file of a sharded scene says.

    Attributes
    ----------
    origin : tuple of 3 float
        Of all shards, world coordinates.
    bounds : Bounds
        Around all objects, relative to the origin.
    camera : Camera, optional
    lights : tuple of Light
    background : tuple of 3 float
    shards : tuple of Shard
        In the order of their groups.
    """

    origin: Vector
    bounds: Bounds
    camera: Camera | None
    lights: tuple[Light, ...]
    background: Vector
    shards: tuple[Shard, ...]

    @property
    def objects(self) -> int:
        """Return the number of objects."""
        return sum(shard.objects for shard in self.shards)

    @property
    def checksum(self) -> int:
        """Return a checksum of the scene alone, wherever its shards are."""
        known = self.fields()
        for shard in known["shards"]:
            del shard["path"], shard["header"]
        return zlib.crc32(json.dumps(known, sort_keys=True).encode())

    def fields(self) -> dict[str, Any]:
        """Return what the file says, but for its checksum, for JSON."""
        return {
            "magic": MAGIC,
            "version": VERSION,
            "origin": list(self.origin),
            "bounds": bounds_to(self.bounds),
            "camera": None if self.camera is None else dict(vars(self.camera)),
            "lights": [[list(each.position), list(each.color)] for each in self.lights],
            "background": list(self.background),
            "shards": [shard.fields() for shard in self.shards],
        }

    def text(self) -> bytes:
        """Return the file's only text."""
        return header_text(self.fields()).encode()


def read_manifest(path: Path) -> tuple[Manifest, bytes]:
    """Read the file of a sharded scene; return what it says, and its text.

    Raises
    ------
    StoreError
        If it is none, of another version, or damaged: one line with what was found.
    StreamError
        As the system refuses.
    """
    with calling(path, "reading"):
        text = path.read_bytes()
    return parse_manifest(path, text), text


def write_manifest(path: Path, manifest: Manifest) -> None:
    """Write the file of a sharded scene, whole or not at all.

    Raises
    ------
    DiskFullError, StreamError
        As the system refuses.
    """
    write_parts(path, [manifest.text()])


def is_manifest(path: Path) -> bool:
    """Tell whether a file is that of a sharded scene of any version, which another may replace."""
    try:
        with calling(path, "reading"):
            return bool(json.loads(path.read_bytes())["magic"] == MAGIC)
    except (ValueError, KeyError, TypeError, RecursionError):
        return False


def parse_manifest(path: Path, text: bytes) -> Manifest:
    """Return what a text says; `path` is where errors place it. `StoreError` as `read_manifest`."""
    try:
        given = json.loads(text)
        magic, version = given["magic"], given["version"]
    except (ValueError, KeyError, TypeError, RecursionError):
        raise StoreError(f"{path}: not a sharded scene: expected a JSON file of bfrt") from None
    if magic != MAGIC:
        raise StoreError(f"{path}: found {magic!r:.80}, expected {MAGIC!r}")
    if version != VERSION:
        raise StoreError(
            f"{path}: found version {version!r:.40} of a sharded scene, expected {VERSION}: "
            "convert the files again with this version of bfrt"
        )
    try:
        whole_text = header_text(given).encode() == text
    except (ValueError, RecursionError):  # NaN, or nested without end
        whole_text = False
    if not whole_text:
        raise StoreError(f"{path}: the file is damaged: its checksum does not match")
    try:
        return _manifest(MANIFEST(given))
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"{path}: {error}") from None


def _manifest(found: dict[str, Any]) -> Manifest:
    shards = tuple(_shard(each) for each in found["shards"])
    _check_groups(shards)
    around = bounds_to(functools.reduce(Bounds.union, [shard.bounds for shard in shards]))
    if around != bounds_to(bounds_from(found["bounds"])):
        raise ValueError(f"bounds: found {found['bounds']}, expected {around} around all shards")
    return Manifest(
        found["origin"],
        bounds_from(found["bounds"]),
        found["camera"],
        found["lights"],
        found["background"],
        shards,
    )


def _shard(found: dict[str, Any]) -> Shard:
    return Shard(
        found["path"],
        FileFacts(**found["header"]),
        found["checksum"],
        found["group"],
        found["groups"],
        found["materials"],
        bounds_from(found["bounds"]),
        tuple(itertools.starmap(ShardStream, found["streams"])),
    )


def _check_groups(shards: Sequence[Shard]) -> None:
    """Refuse shards whose groups are not one after another, or that have others' streams."""
    if not shards:
        raise ValueError("shards: found none, expected one or more")
    following = 0
    for number, shard in enumerate(shards):
        if shard.group != following or not shard.groups:
            raise ValueError(
                f"shards: found {shard.groups} groups from {shard.group} on in shard {number}, "
                f"expected one or more from {following} on"
            )
        following += shard.groups
        numbers = [stream.number for stream in shard.streams]
        if any(not shard.group <= stream.group < following for stream in shard.streams) or any(
            a >= b for a, b in itertools.pairwise(numbers)
        ):
            raise ValueError(
                f"shards: found streams {numbers!r:.60} in shard {number}, expected those of its "
                "groups, ascending"
            )
    if following > MOST_GROUPS:
        raise ValueError(f"shards: found {following} groups, expected {MOST_GROUPS} or fewer")


def place(value: Any) -> str:
    """Check where a shard is: a path from the folder of the file on."""
    if not isinstance(value, str) or not value or PurePosixPath(value).is_absolute():
        raise ValueError(f"found {value!r:.60}, expected a relative path")
    if len(value) > MOST_LETTERS:
        raise ValueError(f"found {value!r:.60}..., expected {MOST_LETTERS} letters or fewer")
    return str(path_of("path", value))


def shard_stream(value: Any) -> tuple[int, int]:
    """Check the number of a stream, which has a kind that there is, and its objects."""
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError(f"found {value!r:.60}, expected a stream's number and its objects")
    number, count = whole(1 << STREAM_BITS)(value[0]), whole(1 << INDEX_BITS)(value[1])
    whole(len(Kind))(number & (1 << KIND_BITS) - 1)
    return number, count


MANIFEST = fields(
    magic=lambda value: value,
    version=whole(1 << 31),
    origin=vector,
    bounds=optional(bounds),
    camera=optional(camera),
    lights=listed(light),
    background=vector,
    shards=listed(
        fields(
            path=place,
            header=FACTS,
            checksum=whole(1 << 32),
            group=whole(MOST_GROUPS),
            groups=whole(MOST_GROUPS + 1),
            materials=whole(1 << 32),
            bounds=optional(bounds),
            streams=listed(shard_stream),
        )
    ),
    checksum=whole(1 << 32),
)
