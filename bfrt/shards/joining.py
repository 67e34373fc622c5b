"""Joining: stores that are there become the shards of a scene."""

from __future__ import annotations

import functools
import os
import stat
from collections.abc import Sequence
from pathlib import Path, PurePath

from bfrt.errors import SettingError
from bfrt.ids import MOST_GROUPS
from bfrt.paths import check_file, is_there, mode_at, without_links
from bfrt.shards.manifest import SUFFIX, Manifest, Shard, is_manifest, write_manifest
from bfrt.shards.store import described
from bfrt.store.extent import Bounds, check_extent
from bfrt.store.store import Store


def check_new_scene(path: Path) -> None:
    """Refuse a path to which no sharded scene could be written.

    Raises
    ------
    SettingError
        If its suffix is another, or something else is there, which is not ours to replace.
    """
    if path.suffix != SUFFIX:
        raise SettingError(f"{path}: found suffix {path.suffix!r}, expected {SUFFIX}")
    check_file(path)
    if is_there(path) and stat.S_ISREG(mode_at(path)) and not is_manifest(path):
        raise SettingError(
            f"{path}: found a file that is no sharded scene, expected one, or nothing"
        )


def join(path: Path, stores: Sequence[Store]) -> Manifest:
    """Write the file of a sharded scene, whose first shard's view and lights are the scene's.

    Parameters
    ----------
    path : Path
        The file; one of another sharded scene is replaced.
    stores : sequence of Store
        The shards, in the order of their groups.

    Returns
    -------
    Manifest
        What the file says.

    Raises
    ------
    SettingError
        If there is none, if their origins differ, or if they have too many groups.
    SceneError
        If the scene is too small for where it is.
    DiskFullError, StreamError
        As the system refuses.
    """
    if not stores:
        raise SettingError(f"{path}: found no store, expected one or more for a sharded scene")
    first = stores[0]
    given = next((store for store in stores if store.objects), first)
    for store in stores:
        if store.objects and store.origin != given.origin:
            raise SettingError(
                f"{store.path}: found the origin {store.origin}, expected {given.origin} as in "
                f"{given.path}: shards have one origin"
            )
    bounds = functools.reduce(Bounds.union, [store.bounds for store in stores])
    check_extent(bounds, given.origin)
    manifest = Manifest(
        given.origin, bounds, first.camera, tuple(first.lights), first.background,
        tuple(_shards(path, stores)),
    )  # fmt: skip
    write_manifest(path, manifest)
    return manifest


def _shards(path: Path, stores: Sequence[Store]) -> list[Shard]:
    """Return what the file says of each store."""
    folder = without_links(path).parent
    shards: list[Shard] = []
    groups = 0
    for store in stores:
        place = PurePath(os.path.relpath(without_links(store.path), folder)).as_posix()
        shards.append(described(store, place, groups))
        groups += len(store.groups)
    if groups > MOST_GROUPS:
        raise SettingError(f"{path}: found {groups} groups, expected {MOST_GROUPS} or fewer")
    return shards
