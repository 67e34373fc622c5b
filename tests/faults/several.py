"""Works on several things at once: the shards of a scene, the pictures of views, a store's copy."""

from __future__ import annotations

import io
import re
from pathlib import Path

from faults.conversions import npy, obj, put
from faults.work import FRAME, Work, scene, write_scene

import bfrt

VIEWS = 3


def sharding() -> Work:
    """A conversion to two shards, which goes on with those that are complete."""

    def prepare(folder: Path) -> None:
        npy(folder)
        obj(folder)

    def run(folder: Path) -> bytes:
        names = [folder / "in" / "a.npy", folder / "in" / "a.obj"]
        target = folder / "out" / "a.bfrts"
        bfrt.convert(names, target, radius=0.1, scratch=folder / "tmp").close()
        return b""

    return Work(prepare, run, resumes=True)


def sharded(folder: Path) -> None:
    """Make a scene of two shards that has a view."""
    text = io.StringIO()
    bfrt.spd.rings(1).write_nff(text)
    small = re.sub(r"resolution \d+ \d+", "resolution {} {}".format(*FRAME), text.getvalue())
    put("a.nff", small, folder)
    put("b.nff", "f 1 1 1 1 0 0 0 0\ns 0 0 0 0.5\np 4\n1 1 0\n2 1 0\n2 2 0\n1 2 0\n", folder)
    names = [folder / "in" / "a.nff", folder / "in" / "b.nff"]
    bfrt.convert(names, folder / "in" / "s.bfrts").close()


def views(name: str, save: str = "save") -> Work:
    """A render of several views, and what their pictures become."""

    def run(folder: Path) -> bytes:
        with bfrt.open(folder / "in" / "s.bfrt") as held:
            images = held.render(
                camera=held.turntable(VIEWS), memory="512MiB", threads=2, scratch=folder / "tmp"
            )
            getattr(images, save)(folder / "out" / name)
            return b"".join(image.channels["G"].tobytes() for image in images)

    def prepare(folder: Path) -> None:
        scene(folder)
        (folder / "out" / name.format(1)).write_bytes(b"a picture that was there")

    return Work(prepare, run)


def copying() -> Work:
    """A store that is copied over another."""

    def prepare(folder: Path) -> None:
        scene(folder)
        bfrt.spd.tetra(1).write(folder / "out" / "a.bfrt").close()

    def run(folder: Path) -> bytes:
        bfrt.copy_store(folder / "in" / "s.bfrt", folder / "out" / "a.bfrt", overwrite=True)
        return b""

    return Work(prepare, run)


def verifying() -> Work:
    """A store that is compared with its checksums, and is asked for its palette."""

    def run(folder: Path) -> bytes:
        with bfrt.open(folder / "in" / "s.bfrt") as held:
            held.verify()
            return bytes(held.materials().tobytes())

    return Work(scene, run)


def writing() -> Work:
    """A scene that a caller writes object by object, over a store."""

    def prepare(folder: Path) -> None:
        bfrt.spd.tetra(1).write(folder / "out" / "a.bfrt").close()

    def run(folder: Path) -> bytes:
        write_scene(folder / "out" / "a.bfrt")
        return b""

    return Work(prepare, run)
