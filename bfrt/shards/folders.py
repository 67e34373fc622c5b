"""The folders of a sharded scene's stores, and the file that names them, as one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from bfrt.errors import StoreError
from bfrt.paths import is_there
from bfrt.refusals import calling
from bfrt.store.folder import StoreFolder


class ShardFolders(StoreFolder):
    """Watches over the file of a sharded scene and the folders of its shards.

    Files are opened in the shards' own folders, which their streams know; this one opens none. It
    is pickled as they are: by paths and texts, which another process has to find the same.

    Parameters
    ----------
    path : Path
        The file.
    text : bytes
        Its text.
    shards : sequence of StoreFolder

    Attributes
    ----------
    path : Path
    header : bytes
        The text.
    """

    def __init__(self, path: Path, text: bytes, shards: Sequence[StoreFolder]) -> None:
        self.path = path
        self.header = text
        self._shards = tuple(shards)

    def __reduce__(self) -> tuple[Any, ...]:
        return ShardFolders, (self.path, self.header, self._shards)

    def close(self) -> None:
        """Open no more files of the shards."""
        for shard in self._shards:
            shard.close()

    @property
    def in_place(self) -> bool:
        """Tell whether the paths lead to these shards still."""
        return self._found_text() == self.header and all(shard.in_place for shard in self._shards)

    def fault(self) -> StoreError | None:
        """Return what has become of the scene since it was opened; None if it is as it was."""
        for shard in self._shards:
            error = shard.fault()
            if error is not None:
                return error
        return self._own_fault()

    def check(self) -> None:
        """Refuse shards that have other headers by now, or none.

        Raises
        ------
        StoreError
            If one has.
        """
        for shard in self._shards:
            shard.check()

    @contextmanager
    def session(self) -> Iterator[None]:
        """See to it that all that is read meanwhile is of the shards that were opened.

        Raises
        ------
        StoreError
            If one was replaced or removed; it names the shard.
        """
        with ExitStack() as sessions:
            for shard in self._shards:
                sessions.enter_context(shard.session())
            yield

    def _own_fault(self) -> StoreError | None:
        found = self._found_text()
        if found == self.header:
            return None
        what = "removed" if found is None else "replaced"
        return StoreError(f"{self.path}: the sharded scene was {what} while it was open")

    def _found_text(self) -> bytes | None:
        """Read the file; None where there is none."""
        with contextlib.suppress(FileNotFoundError), calling(self.path, "reading"):
            return self.path.read_bytes() if is_there(self.path) else None
        return None
