"""Opening: the shards of a scene as the groups of one store, and any scene by its path."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bfrt.errors import StoreError
from bfrt.ids import index_of, kind_of, object_id, stream_number, stream_of
from bfrt.paths import is_file, path_of, without_links
from bfrt.records import MATERIAL_BYTES
from bfrt.shards.folders import ShardFolders
from bfrt.shards.manifest import SUFFIX, Manifest, Shard, ShardStream, read_manifest
from bfrt.store.file_facts import FileFacts
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.store import Group, Store, open_store

#: The marks of a shard's group as a part of a whole scene, whose boxes are padded by its bounds.
SHARED_MARKS = "shared-marks"


@dataclass(frozen=True)
class ShardedStore(Store):
    """Holds the headers of a sharded scene: a store whose groups are in several folders.

    Attributes
    ----------
    manifest : Manifest
        What the file says.
    numbers : tuple of int
        The shards that are open, ascending; the others' groups are left out.
    stores : tuple of Store
        They themselves, each with numbers and ids of its own.
    """

    manifest: Manifest
    numbers: tuple[int, ...]
    stores: tuple[Store, ...]

    @property
    def bytes(self) -> int:
        """Return the bytes on disk, without marks."""
        return sum(store.bytes for store in self.stores) + self.header_bytes

    def moved(self, path: Path) -> Store:
        """Refuse to move: the shards are where the file says."""
        raise StoreError(f"{self.path}: found a sharded scene, which cannot take the name {path}")

    def marks_of(self, group: Group) -> Path:
        """Return the path of a group's marks, where we may write to the shard."""
        for number, store in zip(self.numbers, self.stores, strict=True):
            shard = self.manifest.shards[number]
            if shard.group <= group.number < shard.group + shard.groups:
                return store.path / str(group.number - shard.group) / SHARED_MARKS
        raise StoreError(f"{self.path}: found no shard open that has group {group.number}")

    def files(self) -> list[tuple[Path, FileFacts]]:
        """Return every file that the shards' headers list."""
        return [listed for store in self.stores for listed in store.files()]

    def materials(self) -> NDArray[Any]:
        """Return the palettes of all shards, one after another; as `Store.materials`."""
        return np.concatenate([store.materials() for store in self.stores])

    def verify(self) -> None:
        """Read every file of every shard and compare checksums; as `Store.verify`."""
        for store in self.stores:
            store.verify()

    def check_sizes(self) -> None:
        """Refuse files that are missing, or of other sizes than headers say."""
        for store in self.stores:
            store.check_sizes()


def open_any(path: str | os.PathLike[str]) -> Store:
    """Open a scene: a store, or the file of a sharded one with all its shards.

    Raises
    ------
    StoreError
        If it is neither, of another version, damaged or truncated, or a shard is; or is another
        than the file says.
    StreamError
        As the system refuses.
    """
    path = path_of("store", path)
    return open_sharded(path) if path.suffix == SUFFIX and is_file(path) else open_store(path)


def open_sharded(path: Path, numbers: Iterable[int] | None = None) -> ShardedStore:
    """Open a sharded scene, or some of its shards, by their places in the file; as `open_any`."""
    manifest, text = read_manifest(path)
    chosen = tuple(range(len(manifest.shards))) if numbers is None else tuple(sorted(numbers))
    with ExitStack() as opened:
        stores = []
        for number in chosen:
            stores.append(open_shard(path, manifest, number))
            opened.callback(stores[-1].folder.close)
        made = joined(path, text, manifest, chosen, stores)
        opened.pop_all()
    return made


def open_shard(path: Path, manifest: Manifest, number: int) -> Store:
    """Open the store of one shard, with numbers and ids of its own.

    Raises
    ------
    StoreError
        If it is no store, or another than the file says.
    StreamError
        As the system refuses.
    """
    shard = manifest.shards[number]
    # Shards are beside the file, not beside a link to it.
    folder = without_links(path).parent if path.is_symlink() else path.parent
    store = open_store(folder / shard.path)
    with store.folder.closed_on_error():
        found = facts_of(store)
        if found != shard.header:
            raise StoreError(
                f"{store.path}: found a store with a header of CRC-32 {found.crc32:08x}, expected "
                f"{shard.header.crc32:08x}: it is not the one that {path} was made with"
            )
        same = described(store, shard.path, shard.group).fields() == shard.fields()
        if not same or (store.objects and store.origin != manifest.origin):
            raise StoreError(
                f"{path}: found shard {number} to differ from the store {store.path}, expected the "
                "same groups, objects, bounds and origin"
            )
    return store


def facts_of(store: Store) -> FileFacts:
    """Return length and checksum of a store's header."""
    return FileFacts(len(store.folder.header), zlib.crc32(store.folder.header))


def described(store: Store, path: str, group: int) -> Shard:
    """Return what the file says of a store that is a shard.

    Parameters
    ----------
    path : str
        Where it is, from the folder of the file on.
    group : int
        Number of its first group in the scene.
    """
    streams = (
        ShardStream(stream_number(group + stream.group, stream.kind), stream.count)
        for stream in store.streams
    )
    return Shard(
        path,
        facts_of(store),
        store.checksum,
        group,
        len(store.groups),
        store.palette.bytes // MATERIAL_BYTES,
        store.bounds,
        tuple(streams),
    )


def joined(
    path: Path, text: bytes, manifest: Manifest, numbers: tuple[int, ...], stores: list[Store]
) -> ShardedStore:
    """Return open shards as one store, whose groups have their numbers in the scene."""
    systems = sorted({store.crs for store in stores if store.crs})
    if len(systems) > 1:
        raise StoreError(
            f"{path}: found shards in {' and in '.join(systems):.200}, expected one reference "
            "system"
        )
    materials = 0
    groups: list[Group] = []
    for number, store in zip(numbers, stores, strict=True):
        first = manifest.shards[number].group
        groups.extend(renumbered(group, first, materials) for group in store.groups)
        materials += store.palette.bytes // MATERIAL_BYTES
    palettes = b"".join(store.palette.crc32.to_bytes(4, "little") for store in stores)
    return ShardedStore(
        folder=ShardFolders(path, text, [store.folder for store in stores]),
        origin=manifest.origin,
        crs="".join(systems),
        colors=tuple(dict.fromkeys(scale for store in stores for scale in store.colors)),
        bounds=manifest.bounds,
        groups=groups,
        camera=manifest.camera,
        lights=list(manifest.lights),
        background=manifest.background,
        palette=FileFacts(materials * MATERIAL_BYTES, zlib.crc32(palettes)),
        hierarchy=stores[0].hierarchy if stores else Hierarchy(),
        hierarchy_seconds=sum(store.hierarchy_seconds for store in stores),
        checksum=manifest.checksum,
        header_bytes=len(text),
        manifest=manifest,
        numbers=numbers,
        stores=tuple(stores),
    )


def renumbered(group: Group, first: int, materials: int) -> Group:
    """Return a shard's group as one of the scene.

    Parameters
    ----------
    first : int
        Number, in the scene, of the shard's group 0.
    materials : int
        Number of the materials of the shards before it.
    """
    number = first + group.number
    streams = [replace(stream, group=number, first_material=materials) for stream in group.streams]
    outliers = [
        object_id(stream_number(number, kind_of(stream_of(id))), index_of(id))
        for id in group.outliers
    ]
    return Group(number, streams, group.grid_bounds, outliers)
