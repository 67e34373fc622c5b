"""What killed processes left in a folder, removed by hand."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from bfrt.errors import SettingError
from bfrt.grid.marks_home import home_in, stale
from bfrt.paths import is_marked, names_in, path_of
from bfrt.settings import folder_of
from bfrt.streams.litter import Litter, bytes_of, clear, restore
from bfrt.streams.ownership import FOLDER, remove
from bfrt.streams.private_folder import is_private


def clean(path: str | os.PathLike[str], *, dry_run: bool = False) -> list[Litter]:
    """Remove what killed processes left: temporary files and folders, half stores, stale marks.

    The next run that writes into a folder does so by itself, there; this does it by hand, and for
    more: the folder, the stores in it, and the user's folder of marks of stores that are read-only,
    where those go whose store is gone or another one, as far as the system says. What a living
    process uses stays. A store whose replacement ended half-way gets its name back.

    Parameters
    ----------
    path : path-like
        The folder; or a store.
    dry_run : bool
        Only look for it.

    Returns
    -------
    list of bfrt.Litter
        What was removed, or would be: ``path`` and ``bytes`` of each.

    Raises
    ------
    SettingError
        If it is no folder.
    """
    given = path_of("clean", path)
    if not dry_run and not given.exists():
        restore(Path(os.path.realpath(given)))
    folder = folder_of("clean", given)
    found = clear(folder, dry=dry_run)
    for place in _stores_in(folder):
        found += clear(place, dry=dry_run)
    for home in _homes(folder):
        for place in (home, *_folders_in(home)):
            if is_private(place, FOLDER):
                found += clear(place, dry=dry_run)
        found += _stale(home, dry_run)
    return found


def _stores_in(folder: Path) -> Iterator[Path]:
    """Yield the folders of the stores that a folder is or has, which have temporary things."""
    for store in (folder, *_folders_in(folder)):
        if is_marked(store):
            if store != folder:
                yield store
            yield from (group for group in _folders_in(store) if group.name.isdecimal())


def _folders_in(folder: Path) -> list[Path]:
    try:
        each = [folder / name for name in names_in(folder)]
        return [path for path in each if path.is_dir() and not path.is_symlink()]
    except OSError:
        return []


def _homes(folder: Path) -> Iterator[Path]:
    """Yield the folders of marks of read-only stores: in the folder, and in the user's cache."""
    for scratch in (folder, None):
        try:
            home = home_in(scratch)
        except SettingError:  # a user without a home
            continue
        if is_private(home, FOLDER):
            yield home


def _stale(home: Path, dry_run: bool) -> list[Litter]:
    found = []
    for folder in stale(home):
        left = Litter(folder, bytes_of(folder))
        if not dry_run:
            remove(folder)
        if dry_run or not folder.exists():
            found.append(left)
    return found
