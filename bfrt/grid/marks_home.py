"""Where marks lie, and whose are believed.

Marks belong into their store. Those of a store that is read-only lie in a folder of the user's
own::

    HOME/NAME-CHECKSUM/store        where the store is
    HOME/NAME-CHECKSUM/GROUP.marks

HOME is ``bfrt`` in the user's cache folder (``XDG_CACHE_HOME``, or ``~/.cache``), or where a
scratch folder is asked for, ``bfrt-USER`` in it. There others can foretell every name. So HOME and
what is in it have to be ours, and to be such that only we may write to it; whatever else is there
is not believed, and no link is followed.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path

from bfrt.errors import BfrtError
from bfrt.paths import is_folder, names_in, without_links
from bfrt.refusals import refused
from bfrt.shards.store import open_any
from bfrt.store.store import Group, Store
from bfrt.streams.atomic_write import atomic_own_file, put
from bfrt.streams.ownership import FILE, FOLDER, parsed, stem_of
from bfrt.streams.private_folder import cache_folder, is_private, make_private, user

#: The file that says where a store is.
PLACE = "store"


def home_in(scratch: Path | None) -> Path:
    """Return the folder for the marks of read-only stores."""
    return cache_folder() if scratch is None else scratch / f"bfrt-{user()}"


def marks_path(store: Store, group: Group, scratch: Path | None) -> Path:
    """Return the path of a group's marks: in the store, or outside if that is read-only.

    A store that has another's name by now has them outside too: they are not to be the other's.

    Parameters
    ----------
    scratch : Path, optional
        The scratch folder, if one is asked for.
    """
    path = store.marks_of(group)
    home = path.parent if is_folder(path.parent) else path.parent.parent
    if store.folder.in_place and os.access(home, os.W_OK):
        return path
    name = stem_of(without_links(store.path).name)
    return home_in(scratch) / f"{name}-{store.checksum:08x}" / f"{group.number}.marks"


def is_inside(path: Path, store: Store) -> bool:
    """Tell whether marks lie in their store, which vouches for them."""
    return any(path == store.marks_of(group) for group in store.groups)


def is_believed(path: Path, store: Store) -> bool:
    """Tell whether marks are there that may be read: a file, no link, and outside a store ours."""
    if is_inside(path, store):
        try:
            return not stat.S_ISLNK(path.lstat().st_mode)
        except FileNotFoundError:
            return False
        except OSError as error:
            raise refused(path, 0, error, "reading") from error
    folders = path.parent.parent, path.parent
    return all(is_private(folder, FOLDER) for folder in folders) and is_private(path, FILE)


def prepare_home(path: Path, store: Store) -> None:
    """Make the folders of marks outside their store.

    Raises
    ------
    SettingError
        If one is there that is not ours alone.
    DiskFullError, StreamError
        If the system refuses.
    """
    if is_inside(path, store):
        return
    for folder in (path.parent.parent, path.parent):
        make_private(folder)
    place = path.parent / PLACE
    with atomic_own_file(place, 0o600) as file:
        put(file, os.fsencode(without_links(store.path)), place)


def stale(home: Path) -> Iterator[Path]:
    """Yield the folders in HOME whose store is gone, or is another one now."""
    try:
        folders = [home / name for name in names_in(home)] if is_private(home, FOLDER) else []
    except OSError:
        return
    for folder in folders:
        if parsed(folder.name) is None and is_private(folder, FOLDER) and not _has_store(folder):
            yield folder


def _has_store(folder: Path) -> bool:
    """Tell whether the store is there whose marks a folder has, as far as the system says.

    Only what is not there counts as not there: a store that the system refuses to read may be.
    True of other folders.
    """
    try:
        place = Path(os.fsdecode((folder / PLACE).read_bytes()))
        return folder.name.endswith(f"-{open_any(place).checksum:08x}")
    except OSError:
        return True
    except (BfrtError, ValueError):
        return False
