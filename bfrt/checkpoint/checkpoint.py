"""The folder that holds the state of one piece of work: one generation, or two for a moment."""

from __future__ import annotations

import logging
import math
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType

from bfrt.checkpoint.identity import Identity, check_same
from bfrt.checkpoint.pace import ASSUMED_EACH, Pace
from bfrt.checkpoint.soundness import check_facts
from bfrt.checkpoint.state import HEADER, Facts, SavedState, StateWriter
from bfrt.errors import BfrtError, CheckpointError, SettingError
from bfrt.paths import check_folder, names_in
from bfrt.refusals import calling, give_up, refused
from bfrt.settings import number_of
from bfrt.store.header import Check
from bfrt.streams.atomic_write import sync_folder
from bfrt.streams.ownership import own_folder
from bfrt.streams.removal import insist, remove_file, remove_folder

log = logging.getLogger(__name__)

#: Seconds between saves, unless another number is asked for.
EVERY = 60.0

#: Names of generations; while one is written, with `PART` behind.
GENERATION = re.compile(r"state\.([0-9]{1,18})(\.part)?")
PART = ".part"

#: Files of marks that are made: what their names begin with, and how they go on, after the
#: number of the group (`bfrt.grid.marks_log`).
MARKS = "bfrt-marks"
MARKS_FILES = ("layers", "index")
MARKS_FILE = re.compile(rf"{MARKS}\.[0-9]+\.({'|'.join(MARKS_FILES)})")


class Checkpoint:
    """Keeps the state of one piece of work in a folder, complete or not at all.

    As a context it owns the folder: a lock, which the system takes back from a killed process,
    keeps another run out. What a killed run was just writing is removed.

    Parameters
    ----------
    folder : path-like
        It need not be there.
    every : float
        Seconds between two saves at the least. Where saving takes long it is done less often: it
        costs no more than a fiftieth of the time. 0 means after every pass, whatever it costs.
    each : float
        Seconds that a save is taken to need until one has been timed.

    Attributes
    ----------
    folder : Path
    found : SavedState, optional
        The state that work goes on from, once `find` has looked.

    Raises
    ------
    SettingError
        If the folder cannot be one that is written to, is in use, or `every` is no such number.
    """

    def __init__(
        self, folder: str | os.PathLike[str], every: float = EVERY, each: float = ASSUMED_EACH
    ) -> None:
        seconds = number_of(every)
        if not 0.0 <= seconds < math.inf:
            raise SettingError(f"every: found {every!r:.80}, expected seconds, 0 or more")
        self.folder = check_folder("checkpoint", folder, ())
        self.found: SavedState | None = None
        self._pace = Pace(seconds, each)
        self._identity: Identity = {}
        self._number = 0
        self._lock = -1

    def __enter__(self) -> Checkpoint:
        with calling(self.folder, "creating"):
            lock = own_folder(self.folder)
        if lock is None:
            raise SettingError(
                f"checkpoint: {self.folder}: found another run at work with it, expected a folder "
                "for each"
            )
        self._lock = lock
        try:
            self._remove(lambda _, part: part)
        except BaseException:
            self._release()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if (refusal := insist(self._remove_empty)) is not None:
            log.debug("%s: is left as it is: %s", self.folder, refusal)
        self._release()

    def _remove_empty(self) -> None:
        """Remove the folder if it has no state; others may have put something in."""
        place = Path(os.path.realpath(self.folder))  # a link to it stays
        if not self._generations():
            place.rmdir()

    def _release(self) -> None:
        lock, self._lock = self._lock, -1
        give_up(lock)

    def find(self, identity: Identity, facts: Check) -> SavedState | None:
        """Return the state to go on from, if there is one; begin the work that `identity` says.

        Its facts must pass the check `facts`.

        Of two complete generations, as a kill leaves them, it is the later one; if that is damaged,
        the one before.

        Raises
        ------
        SettingError
            If it is the state of other work.
        CheckpointError
            If there is none that is whole.
        StreamError
            If the system refuses to read it.
        """
        self._identity = identity
        self.found = self._latest(identity)
        if self.found is not None:
            check_facts(self.found.folder / HEADER, self.found.facts, facts)
        return self.found

    def _latest(self, identity: Identity) -> SavedState | None:
        """Return the latest state that is whole."""
        numbers = self._generations()
        self._number = max(numbers, default=0)
        damage: CheckpointError | None = None
        for number in sorted(numbers, reverse=True):
            try:
                state = SavedState(self._path(number))
            except CheckpointError as error:
                damage = damage or error
                continue
            check_same(self.folder, state.identity, identity)
            if damage is not None:
                log.warning("%s; the state before it is whole, and is used", damage)
            return state
        if damage is not None:
            raise damage
        return None

    def went_on(self, where: str) -> None:
        """Say that work went on from the state found."""
        log.info("%s: goes on where it was left: %s", self.folder, where)

    def between_passes(
        self, write: Callable[[StateWriter], Facts], size: int, tell: Callable[[], None]
    ) -> None:
        """Save a state of about `size` bytes if that is due, and tell how far the work is.

        Where that ends the work the state is saved before, if nobody would have to wait for it.
        """
        due = self.save_if_due(write, size)
        try:
            tell()
        except BaseException:
            if not due and self._pace.at_once(size):
                self._save_last(write)
            raise

    def save_if_due(self, write: Callable[[StateWriter], Facts], size: int) -> bool:
        """Save a state of about `size` bytes if that is due; return whether it was."""
        due = self._pace.due(size)
        if due:
            self.save(write)
        return due

    def _save_last(self, write: Callable[[StateWriter], Facts]) -> None:
        """Save a state while work ends for a reason of its own, which is the one to hear about."""
        try:
            self.save(write)
        except BfrtError as error:
            log.warning("%s: the last state could not be saved: %s", self.folder, error)

    def save(self, write: Callable[[StateWriter], Facts]) -> None:
        """Save a state, in place of the one before.

        Parameters
        ----------
        write : callable
            Puts the files of the state, and returns its facts, for JSON.

        Raises
        ------
        DiskFullError, StreamError
            If the system refuses; the state before is still there.
        """
        start = time.perf_counter()
        number = self._number + 1
        part = self.folder / f"{self._path(number).name}{PART}"
        try:
            part.mkdir(mode=0o700)
            writer = StateWriter(part)
            writer.complete(self._identity, write(writer))
            part.rename(self._path(number))
            sync_folder(self.folder)
        except BaseException as error:
            remove_folder(part)
            if isinstance(error, OSError):
                raise refused(part, 0, error, "saving") from error
            raise
        self._number = number
        self._remove(lambda other, _: other != number)
        seconds = time.perf_counter() - start
        self._pace.saved(writer.bytes, seconds)
        log.debug("%s: saved %d bytes in %.3f s", self.folder, writer.bytes, seconds)

    @property
    def has_state(self) -> bool:
        """Tell whether there is a state, of whatever work."""
        return bool(self._generations())

    def remove(self) -> None:
        """Remove the state: the work is finished."""
        self._remove(lambda number, part: True)
        for name in self._names():
            if MARKS_FILE.fullmatch(name):
                remove_file(self.folder / name)

    def _path(self, number: int) -> Path:
        return self.folder / f"state.{number}"

    def _generations(self) -> list[int]:
        """Return the numbers of the complete generations."""
        matches = [GENERATION.fullmatch(name) for name in self._names()]
        return [int(match[1]) for match in matches if match and not match[2]]

    def _names(self) -> list[str]:
        try:
            return names_in(self.folder)
        except OSError as error:
            raise refused(self.folder, 0, error, "reading") from error

    def _remove(self, unwanted: Callable[[int, bool], bool]) -> None:
        """Remove generations, of which their number tells, and whether they are parts."""
        for name in self._names():
            match = GENERATION.fullmatch(name)
            if match and unwanted(int(match[1]), bool(match[2])):
                path = self.folder / f"{match[0].removesuffix(PART)}{PART}"
                # A kill leaves no generation that has lost some of its files.
                refusal = None if match[2] else insist(partial((self.folder / name).rename, path))
                refusal = refusal or remove_folder(path)
                if refusal is not None:
                    log.warning("%s: could not be removed: %s", self.folder / name, refusal)


@contextmanager
def keeping(
    checkpoint: str | os.PathLike[str] | Checkpoint | None,
    every: float,
    each: float = ASSUMED_EACH,
) -> Iterator[Checkpoint | None]:
    """Yield the checkpoint that a caller asks for, open; it is removed if the work ends well.

    One that is open already is the caller's to remove, when what was made is saved too.
    """
    if checkpoint is None or isinstance(checkpoint, Checkpoint):
        yield checkpoint
        return
    with Checkpoint(checkpoint, every, each) as kept:
        yield kept
        kept.remove()
