"""Breadth-first ray tracing of scenes larger than memory.

>>> import bfrt
>>> bfrt.convert("scene.nff", "scene.bfrt")
>>> image = bfrt.render("scene.bfrt", memory="256MiB")
>>> image.save("scene.exr")
"""

from __future__ import annotations

from bfrt.version import VERSION

TYPE_CHECKING = False  # known to type checkers; `typing` takes long to import
if TYPE_CHECKING:
    from bfrt.api import *  # noqa: F403
    from bfrt.api import __all__ as __all__

__version__ = VERSION


def __getattr__(name: str) -> object:
    """Import `bfrt.api` when something of it is first asked for.

    The command can then be interrupted while it is imported, which takes most of its start.
    """
    if name != "__all__" and name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    offered = import_module("bfrt.api")
    if hasattr(offered, name):
        return getattr(offered, name)
    if name in globals():  # a module that was imported with it
        return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__getattr__("__all__")})  # type: ignore[misc]
