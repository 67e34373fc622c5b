"""The command ``bfrt``.

::

    command ─► convert, render, spd, store, viewshed, clean     each with its options, and its work
                     │
                     ▼
               options, view, bars             what commands have in common

Exit status: 0 for success, 1 for bad input, 2 for wrong use or a refused budget, 129, 130 and 143
for SIGHUP, an interrupt and SIGTERM, 141 where nobody reads what is printed.
"""

from bfrt.cli.command import main, parser

__all__ = ["main", "parser"]
