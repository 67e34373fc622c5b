"""Conversion to a sharded scene: each shard is a conversion of its own, which any process may do.

::

    sources ─► Part 0, Part 1 ...           some sources each, in order
                 │ ShardTask                names and settings: what a process needs to make one
                 ▼
    scene.shards/00000-IDENTITY.bfrt        a store, named by its sources and settings
                 00000-IDENTITY.json        that it is complete, and which settings it used
                 │ all are there
                 ▼
    scene.bfrts                             written last; then shards that it does not name go

A shard of the same identity that is there is kept: a conversion that was killed goes on, and one
of which some files have changed makes their shards alone.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from bfrt.conversion.kept import Writing, check_can_be_kept, input_facts
from bfrt.conversion.sources import SceneFile, SceneSource, sources_of
from bfrt.conversion.writing import Conversion, bytes_of, write_scene
from bfrt.errors import BfrtError, SettingError
from bfrt.formats.reading import Reading, Uses
from bfrt.memory import default_memory
from bfrt.paths import is_folder, names_in, path_of, without_links
from bfrt.progress import Done, DoneReport, staged
from bfrt.refusals import calling
from bfrt.scene import PathLike, Scene
from bfrt.shards.joining import check_new_scene, join
from bfrt.shards.manifest import SUFFIX
from bfrt.shards.store import open_sharded
from bfrt.store.model import Vector
from bfrt.store.store import Store, open_store
from bfrt.streams.atomic_write import write_parts
from bfrt.streams.removal import remove_file, remove_folder
from bfrt.version import VERSION

#: The folder of a scene's shards has the name of its file, with this suffix.
FOLDER_SUFFIX = ".shards"

#: What is ours in there.
NAMED = re.compile(r"\d{5}-[0-9a-f]{16}\.(bfrt|json)")

#: Digits of a shard's identity.
DIGITS = 16


class Made(NamedTuple):
    """Tells what has come of a shard.

    Attributes
    ----------
    number : int
        Its place in the scene.
    known : list of str
        The settings that its sources use.
    """

    number: int
    known: list[str]


@dataclass(frozen=True)
class ShardTask:
    """Says how to make a shard; it is pickled by names and settings, and no data.

    Attributes
    ----------
    number : int
        The shard's place in the scene.
    first : int
        Number of the sources of shards before it.
    sources : tuple of str
        What becomes its groups.
    reading : Reading
        How files are read.
    memory : int, optional
        The budget of the process that makes it; None is that process's default.
    writing : Writing
        The store to make, and how it is written.
    durable : bool
        Whether the store outlives a loss of power.
    """

    number: int
    first: int
    sources: tuple[str, ...]
    reading: Reading
    memory: int | None
    writing: Writing
    durable: bool

    def run(self, report: DoneReport | None = None) -> Made:
        """Make the shard; errors are those of `bfrt.convert`."""
        uses = Uses(len(self.sources) + 1)  # it cannot tell what no other shard's sources use
        memory = default_memory() if self.memory is None else self.memory
        conversion = Conversion(
            sources_of(self.sources), replace(self.reading, uses=uses), memory, self.writing,
            self.durable,
        )  # fmt: skip
        facts = facts_of(self.sources)
        write_scene(conversion, report).store.folder.close()
        known = sorted(uses.known)
        record = {"known": known, "sources": facts}
        write_parts(record_of(Path(self.writing.target)), [json.dumps(record, indent=1).encode()])
        return Made(self.number, known)


#: Makes shards, one after the other or at once, and yields each as it is complete.
Make = Callable[[Sequence[ShardTask]], Iterator[Made]]


class Sharding:
    """Makes the shards of a scene, and the file that names them.

    Parameters
    ----------
    conversion : Conversion
        Of all sources; its target is the file.
    shards : int, optional
        Number of shards; by default one for each source.
    memory : int, optional
        The budget of each process that makes shards; None is its default.
    """

    def __init__(self, conversion: Conversion, shards: int | None, memory: int | None) -> None:
        self.path = Path(conversion.writing.target)
        check_new_scene(self.path)
        check_can_be_kept(conversion.files)
        self.folder = without_links(self.path).with_suffix(FOLDER_SUFFIX)
        self._conversion = conversion
        self._memory = memory
        self._parts = parts_of(conversion.sources, shards)
        self._stores: list[Store] = []
        self._known: set[str] = set()

    def run(self, make: Make) -> Scene:
        """Make all shards that are not there; return the scene, opened.

        Raises
        ------
        BfrtError
            As `bfrt.convert`; shards that are complete stay, for the same call to go on.
        """
        with calling(self.folder, "making"):
            self.folder.mkdir(exist_ok=True)
        try:
            self._make_all(make)
            self._refuse_unused()
            join(self.path, self._stores)
        finally:
            for store in self._stores:
                store.folder.close()
            with suppress(OSError):
                self.folder.rmdir()  # where nothing is in it
        self._remove_others()
        return Scene(open_sharded(self.path))

    def _make_all(self, make: Make) -> None:
        """Make the shards: those before the first object alone, for it decides the origin."""
        origin = self._conversion.writing.origin
        at = 0
        while origin is None and at < len(self._parts):
            self._complete([self._task(at, None)], make)
            if self._stores[-1].objects:
                origin = self._stores[-1].origin
            at += 1
        self._complete([self._task(n, origin) for n in range(at, len(self._parts))], make)

    def _complete(self, tasks: list[ShardTask], make: Make) -> None:
        """Make those shards of a list that are not there, and open all."""
        found = {task.number: kept(task) for task in tasks}
        missing = [task for task in tasks if found[task.number] is None]
        for made in make(missing):
            found[made.number] = made.known
        for task in tasks:
            self._known.update(found[task.number] or ())
            self._stores.append(open_store(task.writing.target))

    def _task(self, number: int, origin: Vector | None) -> ShardTask:
        whole = self._conversion
        names = tuple(source.name for source in self._parts[number])
        writing = whole.writing._replace(origin=origin)
        name = f"{number:05d}-{identity_of(names, whole, origin)}.bfrt"
        return ShardTask(
            number, sum(map(len, self._parts[:number])), names, whole.reading, self._memory,
            writing._replace(target=self.folder / name), whole.durable,
        )  # fmt: skip

    def _refuse_unused(self) -> None:
        """Refuse settings that no source uses, and leave no shard that was made with them."""
        reading = self._conversion.reading
        reading.uses.names.extend(source.name for source in self._conversion.sources)
        reading.uses.known.update(self._known)
        try:
            reading.refuse_unused(self._conversion.sources[-1].name)
        except SettingError:
            for store in self._stores:
                remove_folder(store.path)
                remove_file(record_of(store.path))
            raise

    def _remove_others(self) -> None:
        """Remove shards that the file does not name."""
        named = {store.path.name for store in self._stores}
        named |= {record_of(store.path).name for store in self._stores}
        with calling(self.folder, "listing"):
            there = names_in(self.folder)
        for name in there:
            if NAMED.fullmatch(name) and name not in named:
                each = self.folder / name
                if is_folder(each):
                    remove_folder(each)
                else:
                    remove_file(each)


def is_sharded(target: PathLike, shards: int | None, client: object) -> bool:
    """Tell whether a target is a sharded scene, as its suffix says.

    Raises
    ------
    SettingError
        If it is not, and a number of shards is asked for, or a cluster.
    """
    path = path_of("store", target)
    if path.suffix != SUFFIX and shards is not None:
        raise SettingError(
            f"shards: found {shards!r:.80} for {path}, expected a target with suffix {SUFFIX}"
        )
    if path.suffix != SUFFIX and client is not None:
        raise SettingError(
            f"client: found one for {path}, expected a target with suffix {SUFFIX}: each worker "
            "makes a store"
        )
    return path.suffix == SUFFIX


def refuse_checkpoint(checkpoint: object) -> None:
    """Refuse a checkpoint of a sharded scene, whose shards are its state."""
    if checkpoint is not None:
        raise SettingError(
            "checkpoint: found one for a sharded scene, expected none: the same call goes on by "
            "itself, with the shards that are complete"
        )


def parts_of(sources: Sequence[SceneSource], shards: int | None) -> list[Sequence[SceneSource]]:
    """Return the sources of each shard: as many as of any other, or one more, in order.

    Raises
    ------
    SettingError
        If there are fewer sources than shards.
    """
    n = len(sources)
    if shards is None:
        shards = n
    if isinstance(shards, bool) or not isinstance(shards, int) or not 1 <= shards <= n:
        raise SettingError(f"shards: found {shards!r:.80}, expected 1 to {n}, one a file at most")
    ends = [n * k // shards for k in range(shards + 1)]
    return [sources[a:b] for a, b in itertools.pairwise(ends)]


def identity_of(names: Sequence[str], whole: Conversion, origin: Vector | None) -> str:
    """Return what tells a shard from others: its sources, and all that changes the store."""
    facts = {
        "version": VERSION,
        "sources": facts_of(names),
        "origin": origin,
        **whole.settings,
    }
    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:DIGITS]


def facts_of(names: Sequence[str]) -> list[dict[str, Any]]:
    """Return what sources are like, for JSON: their paths, sizes and times; names of others."""
    made = []
    for source in sources_of(names):
        if isinstance(source, SceneFile):
            facts = input_facts(source.name) or {}
            made.append({"path": str(without_links(source.name)), **facts})
        else:
            made.append({"path": source.name})
    return made


def record_of(store: Path) -> Path:
    """Return the path of the file that says that a shard is complete."""
    return store.with_suffix(".json")


def kept(task: ShardTask) -> list[str] | None:
    """Return the settings that a shard used which is there, complete; None where there is none."""
    store = Path(task.writing.target)
    try:
        known = json.loads(record_of(store).read_bytes())["known"]
        open_store(store).folder.close()
    except (BfrtError, OSError, ValueError, KeyError, TypeError, RecursionError):
        return None
    sound = isinstance(known, list) and all(isinstance(name, str) for name in known)
    return known if sound else None


def one_by_one(sources: Sequence[SceneSource], report: DoneReport | None) -> Make:
    """Return what makes shards in this process, one after the other.

    Parameters
    ----------
    sources : sequence of SceneSource
        All of the scene's.
    report : callable, optional
        Gets the bytes that are read of all files, and the objects of each shard that are in order.
    """

    def make(tasks: Sequence[ShardTask]) -> Iterator[Made]:
        read = staged(report, "reading", bytes_of(sources) or None)
        for task in tasks:
            done = bytes_of(sources[: task.first])
            yield task.run(None if report is None else shown(report, read, done))

    return make


def shown(report: DoneReport, read: Callable[[int], object] | None, before: int) -> DoneReport:
    """Return the report of one shard: bytes are counted over all files."""

    def show(done: Done) -> object:
        if done.stage != "reading":
            return report(done)
        assert read is not None
        read(before + done)
        return True

    return show
