"""Breadth-first ray tracing of scenes larger than memory.

>>> import bfrt
>>> bfrt.convert("scene.nff", "scene.bfrt")
>>> image = bfrt.render("scene.bfrt", memory="256MiB")
>>> image.save("scene.exr")
"""

# Only what Python has at its start is imported here: the command begins behind this module.
import _signal
import os
import sys

#: Where each thing that is offered lies; ``__init__.pyi`` says the same to type checkers.
OFFERED = {
    "Answer": "bfrt.queries.question:Answer",
    "BfrtError": "bfrt.errors:BfrtError",
    "BudgetError": "bfrt.errors:BudgetError",
    "Camera": "bfrt.store.model:Camera",
    "Cancelled": "bfrt.errors:Cancelled",
    "CheckpointError": "bfrt.errors:CheckpointError",
    "DiskFullError": "bfrt.errors:DiskFullError",
    "Hierarchy": "bfrt.store.hierarchy:Hierarchy",
    "Image": "bfrt.image.picture:Image",
    "Images": "bfrt.image.pictures:Images",
    "Light": "bfrt.store.model:Light",
    "Litter": "bfrt.streams.litter:Litter",
    "Material": "bfrt.store.model:Material",
    "Plan": "bfrt.planning.planned:Plan",
    "Progress": "bfrt.progress:Progress",
    "ResourceError": "bfrt.errors:ResourceError",
    "Scene": "bfrt.scene:Scene",
    "SceneError": "bfrt.errors:SceneError",
    "SceneWriter": "bfrt.scene_writer:SceneWriter",
    "SettingError": "bfrt.errors:SettingError",
    "ShardedScene": "bfrt.sharded:ShardedScene",
    "ShortReadError": "bfrt.errors:ShortReadError",
    "StoreError": "bfrt.errors:StoreError",
    "StreamError": "bfrt.errors:StreamError",
    "Sun": "bfrt.store.sun:Sun",
    "camera_rays": "bfrt.queries.camera:camera_rays",
    "cast_rays": "bfrt.scene:cast_rays",
    "clean": "bfrt.cleaning:clean",
    "contains": "bfrt.scene:contains",
    "convert": "bfrt.conversion.convert:convert",
    "copy_store": "bfrt.cluster.copies:copy_store",
    "count_intersections": "bfrt.scene:count_intersections",
    "framing_camera": "bfrt.scene:framing_camera",
    "list_intersections": "bfrt.scene:list_intersections",
    "occluded": "bfrt.scene:occluded",
    "open": "bfrt.sharded:open_scene",
    "plan": "bfrt.scene:plan",
    "render": "bfrt.scene:render",
    "spd": "bfrt.spd",
    "turntable": "bfrt.scene:turntable",
    "viewshed": "bfrt.terrain.viewshed:viewshed",
    "visibility": "bfrt.scene:visibility",
}

__all__ = list(OFFERED)

#: What is there besides, but not by ``*``.
ASKED_FOR = {**OFFERED, "__version__": "bfrt.version:VERSION"}


def _interrupted(number: int, _: object) -> None:
    """Be a command that is interrupted before there is anything to clear up: say so, and end."""
    try:
        os.write(2, b"bfrt: interrupted\n")
    finally:
        os._exit(128 + number)


def _take_interrupts() -> None:
    """Have an interrupt end the process in one line; not where it was started to ignore them."""
    try:
        if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
            _signal.signal(_signal.SIGINT, _interrupted)
    except KeyboardInterrupt:  # which came just before
        _interrupted(_signal.SIGINT, None)


def _command() -> int:
    """Be the command, as its script: return the exit status."""
    _take_interrupts()
    from importlib import import_module

    return import_module("bfrt.__main__").run()


# Python looks for `bfrt.__main__`: the command has begun. For a program nothing is changed.
if sys.argv[:1] == ["-m"] and ("-m", "bfrt") in zip(sys.orig_argv, sys.orig_argv[1:], strict=False):
    _take_interrupts()


def __getattr__(name: str) -> object:
    """Import what is offered when it is first asked for: a program loads what it uses.

    The command can then be interrupted while it is imported, which takes most of its start.
    """
    from bfrt.lazy import imported

    return imported(__name__, ASKED_FOR, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *ASKED_FOR})
