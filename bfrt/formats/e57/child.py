"""The process that reads an E57 file for another, as long as that asks (bfrt.formats.e57)."""

from __future__ import annotations

import contextlib
import io
import os
import traceback

from bfrt.errors import BfrtError
from bfrt.formats.e57.scans import Scans
from bfrt.formats.hdf5.messages import Channel, Ended


def serve(channel: Channel, path: str) -> None:
    """Say what a file has; then send the columns that are asked for, again and again."""
    scans = Scans(path)
    channel.send(["done", scans.count, *scans.names])
    while True:
        names, _ = channel.receive()
        for block in scans.blocks(names):
            channel.send(["block", len(block)], block)
        channel.send(["end"])


def main(path: str) -> None:
    """Serve by the standard streams, of which nothing else may write into the second."""
    with io.FileIO(0, closefd=False) as source, io.FileIO(os.dup(1), "w") as target:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        channel = Channel(source, target)
        with contextlib.suppress(Ended):
            try:
                serve(channel, path)
            except BfrtError as error:
                channel.send(["SceneError", str(error)])
            except MemoryError:
                channel.send(["MemoryError"])
            except Ended:
                raise
            except Exception:  # ours: the process that asks shows where
                channel.send(["RuntimeError", traceback.format_exc()])
