"""Where a store is, and which: all that travels of one."""

from __future__ import annotations

import os
from dataclasses import dataclass

from bfrt.errors import StoreError
from bfrt.shards.store import open_any
from bfrt.store.store import Store


@dataclass(frozen=True)
class Place:
    """Says where a store is, for other processes, which open it themselves.

    Attributes
    ----------
    path : str
        The store, an absolute path: the same on every machine.
    checksum : int
        The store's.
    """

    path: str
    checksum: int

    @classmethod
    def of(cls, store: Store) -> Place:
        """Return the place of an open store."""
        return cls(os.path.abspath(store.path), store.checksum)  # noqa: PTH100  # links stay

    def open(self) -> Store:
        """Open the scene: a store, or a sharded one.

        Raises
        ------
        StoreError
            If it cannot be, or is another than the one that was meant.
        StreamError
            As the system refuses.
        """
        store = open_any(self.path)
        if store.checksum != self.checksum:
            raise StoreError(
                f"{self.path}: found the store {store.checksum:08x}, expected "
                f"{self.checksum:08x}, which was opened under this name"
            )
        return store
