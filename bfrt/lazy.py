"""Packages that import what they offer when it is first asked for: a program loads what it uses.

The ``__init__.pyi`` beside such a package says the same to type checkers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from functools import partial


def imported(package: str, offered: Mapping[str, str], name: str) -> object:
    """Import what a package offers by a name, and keep it there for the next time.

    Parameters
    ----------
    package : str
        Name of the package.
    offered : mapping of str
        Where each name lies, ``module:name``, or ``module`` for a module.
    name : str

    Raises
    ------
    AttributeError
        If it offers nothing of that name.
    """
    if name not in offered:
        raise AttributeError(f"module {package!r} has no attribute {name!r}")
    from importlib import import_module

    home, _, inside = offered[name].partition(":")
    module = import_module(home)
    found = getattr(module, inside) if inside else module
    setattr(sys.modules[package], name, found)
    return found


def offering(package: str, offered: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package, which imports what is asked for: see `imported`."""
    return partial(imported, package, offered)
