"""Packages that import what they offer when it is first asked for: a program loads what it uses.

The ``__init__.pyi`` beside such a package says the same to type checkers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping


def offering(package: str, offered: Mapping[str, str]) -> Callable[[str], object]:
    """Return the ``__getattr__`` of a package, which imports what is asked for and keeps it.

    Parameters
    ----------
    package : str
        Name of the package.
    offered : mapping of str
        Where each name lies, ``module:name``, or ``module`` for a module.
    """

    def imported(name: str) -> object:
        if name not in offered:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        from importlib import import_module

        home, _, inside = offered[name].partition(":")
        module = import_module(home)
        found = getattr(module, inside) if inside else module
        setattr(sys.modules[package], name, found)
        return found

    return imported
