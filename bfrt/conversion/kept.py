"""Conversions that go on after a kill: the store as far as it is made, and the state of it.

::

    DIR/bfrt-conversion.part/   the store: groups of the sources that are complete, the palette
    DIR/state.N/                what is known of them, and what the writer has in memory
                                    │
    a source is complete     ─► its files are synced ─► a state
    a stream is in order     ─► it is synced beside the one given ─► a state ─► takes its place
    the store has all files  ─► a state ─► the store gets its name ─► the state is removed

Whatever is in the store's folder and not in the state was made after it, and is made again.
"""

from __future__ import annotations

import logging
import stat
import zlib
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.checkpoint.soundness import CONVERSION_FACTS, expect
from bfrt.checkpoint.state import HEADER as STATE
from bfrt.checkpoint.state import Facts, SavedState, StateWriter
from bfrt.conversion.kept_files import hold_to_state, removed
from bfrt.errors import SettingError
from bfrt.formats.reading import Uses
from bfrt.image.color_scale import ColorScale
from bfrt.paths import HEADER, facts_at, is_marked
from bfrt.refusals import calling
from bfrt.scene import PathLike
from bfrt.scene_writer import SceneWriter
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.coordinates import Coordinates
from bfrt.store.hierarchy import Hierarchy
from bfrt.store.making import Making, Order
from bfrt.store.model import Camera, Light
from bfrt.store.palette import KEY_NUMBERS, SavedPalette
from bfrt.store.record_writer import RecordWriter, SavedRecords
from bfrt.store.store import Store, open_store
from bfrt.store.view_writer import ViewWriter
from bfrt.store.writer import check_new_store

log = logging.getLogger(__name__)

#: The store's folder, in that of the checkpoint.
FOLDER = "bfrt-conversion.part"

#: Seconds between two saves, unless another number is asked for: a state is small.
EVERY = 1.0

#: The file of a state that has the materials which are remembered.
MATERIALS = "materials"

#: Bytes of a state for each group, about.
GROUP_BYTES = 2000


class Writing(NamedTuple):
    """Says how a store is written.

    Attributes
    ----------
    target : path-like
    dtype, origin
        As for `SceneWriter`.
    hierarchy : Hierarchy
    order : {"given", "spatial", "auto"}
    """

    target: PathLike
    dtype: Any
    origin: Any
    hierarchy: Hierarchy
    order: Order


class KeptWriter(SceneWriter):
    """Writes a store in a folder that stays where the work ends early.

    Parameters
    ----------
    writing : Writing
    memory : int
        The budget of the whole process, bytes.
    folder : Path
        The store's folder.
    saved : SavedRecords, optional
        What to go on from.
    save : callable
        Saves a state: always if it is given True, else if that is due; tells whether it has.
    """

    def __init__(
        self, writing: Writing, memory: int, folder: Path, saved: SavedRecords | None,
        save: Callable[[bool], bool],
    ) -> None:  # fmt: skip
        self.path = check_new_store(writing.target)
        self._save = save
        origin = writing.origin if saved is None or saved.origin is None else saved.origin
        coordinates = Coordinates(writing.dtype, origin)
        place = AtomicFolder(self.path, True, folder)
        making = Making(writing.hierarchy, writing.order, True, memory)
        ViewWriter.__init__(self)
        RecordWriter.__init__(self, place, coordinates, making, saved)

    def _may_settle(self, last: bool) -> bool:
        return self._save(last)

    def _is_whole(self) -> None:
        self._save(True)


class KeptConversion:
    """Keeps the state of one conversion in a checkpoint, and goes on from what it has.

    As a context it leaves no store where there is no state of it.

    Parameters
    ----------
    checkpoint : Checkpoint
        Open, with the work's state found, if there is one.
    sources : list of str
        What is converted; "" for what is no file.
    uses : Uses
        The settings that sources use; those that are complete are added.

    Attributes
    ----------
    done : int
        Number of sources that are complete.
    """

    def __init__(self, checkpoint: Checkpoint, sources: list[str], uses: Uses) -> None:
        self._checkpoint = checkpoint
        self._sources = sources
        self._uses = uses
        self._inputs: list[Facts | None] = []
        self._reading: Facts | None = None
        self._writer: KeptWriter | None = None
        self._whole: int | None = None
        self._folder = checkpoint.folder / FOLDER
        found = checkpoint.found
        if found is not None:
            self._inputs = found.facts["inputs"]
            place, groups = found.folder / STATE, len(found.facts["groups"])
            expect(place, "inputs", self.done, right=self.done <= len(sources))
            expect(place, "groups", groups, right=groups <= max(1, self.done))
            self._whole = found.facts["whole"]
            uses.names.extend(found.facts["uses"]["names"])
            uses.known.update(found.facts["uses"]["known"])

    @property
    def done(self) -> int:
        return len(self._inputs)

    def __enter__(self) -> KeptConversion:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if not self._checkpoint.has_state:
            removed(self._folder)

    def check_inputs(self) -> None:
        """Refuse sources that are complete and have changed since they were read.

        Raises
        ------
        SettingError
            For the first; the message has what was found and what was expected.
        """
        for name, before in zip(self._sources, self._inputs, strict=False):
            now = input_facts(name) if before is not None else None
            if now != before:
                raise SettingError(
                    f"checkpoint: {self._checkpoint.folder}: {name}: found {shown(now)}, expected "
                    f"{shown(before)} as it was read: name another folder to begin again"
                )

    def named(self, target: PathLike) -> Store | None:
        """Give the store its name, if it was whole when the run before ended; return it then."""
        if self._whole is None:
            return None
        self._checkpoint.went_on("the store is whole, but for its name")
        path = check_new_store(target)
        folder = AtomicFolder(path, True, self._folder)
        if crc_of_header(folder.target) == self._whole:  # the kill came after the name
            removed(self._folder)
            return open_store(path)
        assert self._checkpoint.found is not None
        hold_to_state(self._folder, self._checkpoint.found, whole=True)
        found = crc_of_header(self._folder)
        expect(self._folder / HEADER, "CRC-32", found, right=found == self._whole)
        folder.create()
        try:
            made = open_store(folder.aside)
            with made.folder.closed_on_error():
                folder.take_name()
        except BaseException:
            folder.abandon()
            raise
        return made.moved(path)

    def open(self, writing: Writing, memory: int) -> KeptWriter:
        """Open the writer of the store, which goes on from the state that was found.

        `memory` is the budget of the whole process, in bytes.
        """
        found = self._checkpoint.found
        saved = None
        if found is None:
            removed(self._folder)
        else:
            hold_to_state(self._folder, found, whole=False)
            saved = saved_records(found)
        self._writer = KeptWriter(writing, memory, self._folder, saved, self._save)
        if found is not None:
            restore_view(self._writer, found.facts["view"])
            self._checkpoint.went_on(self._where(found.facts["groups"]))
        return self._writer

    def _where(self, groups: list[Facts]) -> str:
        """Return in words how far the work is."""
        streams = [stream for group in groups for stream in group["streams"]]
        made = sum(stream["made"] for stream in streams)
        made_too = f", {made} of {len(streams)} streams are in order" if made else ""
        return f"{self.done} of {len(self._sources)} sources are complete{made_too}"

    def begin(self) -> None:
        """Note what the next source is like before it is read."""
        self._reading = input_facts(self._sources[self.done])

    def complete(self) -> None:
        """Note that the source that was begun is complete."""
        assert self._writer is not None
        self._writer.complete_group(self.done)
        self._inputs.append(self._reading)
        self._save(False)

    def _save(self, now: bool) -> bool:
        """Save a state, always or if that is due; return whether it was saved."""
        if now:
            self._checkpoint.save(self._write)
            return True
        size = GROUP_BYTES * (1 + self.done)
        return self._checkpoint.save_if_due(self._write, size)

    def _write(self, state: StateWriter) -> Facts:
        assert self._writer is not None
        saved = self._writer.saved()
        state.put(MATERIALS, [saved.palette.keys])
        return {
            "inputs": self._inputs,
            "uses": {"names": self._uses.names, "known": sorted(self._uses.known)},
            "view": self._writer.view,
            "origin": saved.origin,
            "palette": {"bytes": saved.palette.bytes, "crc32": saved.palette.crc32},
            "groups": saved.groups,
            "whole": crc_of_header(self._folder),
        }


def find_state(checkpoint: Checkpoint, identity: Facts) -> None:
    """Have a checkpoint find the state of a conversion."""
    checkpoint.find(identity, CONVERSION_FACTS)


def input_facts(name: str) -> Facts | None:
    """Return the size of a file and when it was changed; None of what is no file."""
    found = facts_at(Path(name)) if name else None
    return None if found is None else {"bytes": found.st_size, "changed": found.st_mtime_ns}


def check_can_be_kept(sources: list[str]) -> None:
    """Refuse sources of which it cannot be told that they are the same when they come again.

    Raises
    ------
    SettingError
        For the first.
    """
    for name in sources:
        found = facts_at(Path(name)) if name else None
        if name == "-" or (found is not None and not stat.S_ISREG(found.st_mode)):
            raise SettingError(
                f"checkpoint: found {name} among the sources, expected files: what comes through a "
                "pipe does not come again"
            )


def shown(facts: Facts | None) -> str:
    """Return a file's facts in words, for an error."""
    if facts is None:
        return "no file"
    seconds, rest = divmod(facts["changed"], 10**9)
    return f"{facts['bytes']} bytes of time {seconds}.{rest:09d}"


def crc_of_header(folder: Path) -> int | None:
    """Return the checksum of a store's header; None where there is none."""
    if not is_marked(folder):
        return None
    with calling(folder / HEADER, "reading"):
        return zlib.crc32((folder / HEADER).read_bytes())


def saved_records(state: SavedState) -> SavedRecords:
    """Return what a state has of the writer's memory."""
    count = state.count(MATERIALS, np.dtype((np.void, 8 * KEY_NUMBERS)))
    keys = np.empty((count, KEY_NUMBERS), np.float64)
    state.fill(MATERIALS, keys)
    facts = state.facts
    origin = facts["origin"] if facts["origin"] is None else tuple(facts["origin"])
    palette = SavedPalette(facts["palette"]["bytes"], facts["palette"]["crc32"], keys)
    return SavedRecords(origin, palette, facts["groups"])


def restore_view(writer: SceneWriter, facts: Facts) -> None:
    """Give a writer the view, the lights, the background and the reference system that it had."""
    if facts["camera"] is not None:
        writer.camera(Camera(**facts["camera"]))
    for position, color in facts["lights"]:
        writer.light(Light(position, color))
    writer.background(facts["background"])
    if "crs" in facts:
        writer.crs(facts["crs"])
    for scale in facts.get("colors", ()):
        writer.color_scale(ColorScale(**scale))
