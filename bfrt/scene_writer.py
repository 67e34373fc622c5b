"""``bfrt.SceneWriter``: a store that is written object by object, or block by block."""

from __future__ import annotations

from bfrt.scene import Scene
from bfrt.store.writer import StoreWriter


class SceneWriter(StoreWriter):
    __doc__ = StoreWriter.__doc__

    def close(self) -> Scene:
        """Complete the store and give it its name.

        Returns
        -------
        Scene
            The new store, opened.

        Raises
        ------
        SceneError, SettingError
            As for `complete`.
        DiskFullError, StreamError
            If the system refuses a write; nothing is left behind.
        """
        return Scene(self.complete())
