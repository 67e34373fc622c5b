"""Carriers: workers of a cluster with the shards that each of them answers for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from bfrt.cluster.place import Place
from bfrt.errors import BfrtError, SettingError, StoreError
from bfrt.image.color_scale import ColorScale
from bfrt.shards.manifest import Manifest, read_manifest
from bfrt.shards.store import ShardedStore, open_shard, open_sharded


@dataclass(frozen=True)
class ShardPlace(Place):
    """Says where a sharded scene is, and which of its shards are meant.

    Attributes
    ----------
    numbers : tuple of int
        The shards, by their places in the file.
    """

    numbers: tuple[int, ...]

    def open(self) -> ShardedStore:
        """Open these shards; as `Place.open`."""
        store = open_sharded(Path(self.path), self.numbers)
        if store.checksum != self.checksum:
            raise StoreError(
                f"{self.path}: found the scene {store.checksum:08x}, expected "
                f"{self.checksum:08x}, which was opened under this name"
            )
        return store


class Carrier(NamedTuple):
    """Names some shards, and the workers that have them.

    Attributes
    ----------
    numbers : tuple of int
        The shards.
    workers : tuple of str
        Addresses: the first one answers, and the others where it has ended.
    """

    numbers: tuple[int, ...]
    workers: tuple[str, ...]


class Sight(NamedTuple):
    """Tells what a worker sees of a scene.

    Attributes
    ----------
    numbers : tuple of int
        The shards that it can open.
    fault : str
        What is wrong with the first of the others; "" where all can be opened.
    colors : tuple
        What the colors of each of these shards say: a tuple of ColorScale.
    """

    numbers: tuple[int, ...]
    fault: str
    colors: tuple[tuple[ColorScale, ...], ...] = ()


def seen(path: str) -> Sight:
    """Return what this process sees of a scene."""
    try:
        manifest, _ = read_manifest(Path(path))
    except (BfrtError, OSError) as error:
        return Sight((), str(error))
    numbers, colors, fault = [], [], ""
    for number in range(len(manifest.shards)):
        try:
            store = open_shard(Path(path), manifest, number)
            store.folder.close()
        except (BfrtError, OSError) as error:
            fault = fault or str(error)
        else:
            numbers.append(number)
            colors.append(store.colors)
    return Sight(tuple(numbers), fault, tuple(colors))


def sights_of(client: Any, path: str) -> dict[str, Sight]:
    """Return what each worker, by its address, sees of a scene."""
    found: dict[str, Any] = client.run(seen, path, on_error="return")
    return {worker: _sight(each) for worker, each in found.items()}


def colors_of(sights: Mapping[str, Sight]) -> tuple[ColorScale, ...]:
    """Return what the colors of all shards say, in their order, each once."""
    of_shard: dict[int, tuple[ColorScale, ...]] = {}
    for sight in sights.values():
        of_shard.update(zip(sight.numbers, sight.colors, strict=True))
    return tuple(dict.fromkeys(scale for number in sorted(of_shard) for scale in of_shard[number]))


def _sight(found: Any) -> Sight:
    """Return what a worker sees: nothing, where it cannot look, or has ended meanwhile."""
    return found if isinstance(found, Sight) else Sight((), f"{type(found).__name__}: {found}")


def shared_out(manifest: Manifest, sights: Mapping[str, Sight]) -> list[Carrier]:
    """Part the shards of a scene among the workers that see them, by numbers of objects.

    Parameters
    ----------
    sights : mapping
        What each worker, by its address, sees.

    Raises
    ------
    StoreError
        If a shard is seen by none; the message names a worker and the shard.
    SettingError
        If there is no worker.
    """
    if not sights:
        raise SettingError(
            "client: found no worker, expected one or more, as client.wait_for_workers(1) waits for"
        )
    loads = dict.fromkeys(sights, 0)
    own: dict[str, list[int]] = {worker: [] for worker in sights}
    shards = manifest.shards
    for number in sorted(range(len(shards)), key=lambda n: (-shards[n].objects, n)):
        able = [worker for worker, sight in sights.items() if number in sight.numbers]
        if not able:
            worker, sight = next(iter(sights.items()))
            raise StoreError(f"{worker}: shard {number} cannot be opened: {sight.fault}")
        least = min(able, key=lambda worker: (loads[worker], worker))
        loads[least] += shards[number].objects + 1
        own[least].append(number)
    return [
        Carrier(tuple(sorted(numbers)), (worker, *_others(worker, numbers, sights)))
        for worker, numbers in own.items()
        if numbers
    ]


def _others(worker: str, numbers: Iterable[int], sights: Mapping[str, Sight]) -> list[str]:
    """Return the other workers that see all of some shards."""
    return [
        each
        for each, sight in sights.items()
        if each != worker and set(numbers) <= set(sight.numbers)
    ]
