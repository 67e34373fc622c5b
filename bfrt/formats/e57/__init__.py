"""E57: scans, by libE57Format (pye57), one after the other, a block of points at a time.

::

    reader ─► RemoteTable ──────── words and blocks ──────── child: scans ─► libE57Format
                 │                 (bfrt.formats.remote)
              points (bfrt.formats.columns)

The library runs in a process of its own, which files that are broken may end; each scan's pose is
applied there.
"""
