"""The files that the rows of an HDF5 dataset come from: its own, or those of a virtual one.

::

    virtual ──► part0.h5: a ──► numbers
            └─► part1.h5: a ──► virtual ──► ...

HDF5 reads what is missing there as zeros, and what is made of itself until the stack ends. So all
that rows come from is opened before the first is read, and is open until the last: nothing is
missing then.
"""

from __future__ import annotations

import errno
import itertools
import math
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
from h5py import h5d, h5f, h5i, h5o, h5s

from bfrt.errors import BudgetError, SceneError, ShortReadError, StreamError
from bfrt.formats.remote.serving import SECONDS
from bfrt.memory import format_memory
from bfrt.refusals import calling

#: Virtual datasets over virtual ones, at the most.
DEEPEST = 16

#: The variable that has the folders where HDF5 looks for such files first, and the one that has the
#: folder of files of external storage.
PREFIXES = "HDF5_VDS_PREFIX"
RAW_PREFIX = "HDF5_EXTFILE_PREFIX"

#: HDF5 unpacks a chunk whole: it holds what is packed, what is not, and what each filter makes.
CHUNKS_AT_ONCE = 4


def opened(file: str) -> Any:
    """Open an HDF5 file for reading without a lock, so that another process may write it."""
    return h5py.File(os.fsencode(file), "r", locking=False)


#: What HDF5 says where the system refuses to open or to read a file.
REFUSED = {
    "opening": r"unable to open file: name = '(.*?)', errno = (\d+),()",
    "reading": r"file read failed: .*filename = '(.*?)', .* errno = (\d+), .* offset = (\d+)",
}

#: What it says where the system refuses to close one.
CLOSING = r"unable to close file, errno = \d+"


def close(held: Any) -> None:
    """Close what HDF5 has open; a file that was only read has nothing to lose by a refusal."""
    try:
        held.close()
    except (RuntimeError, OSError) as error:
        if not re.search(CLOSING, str(error)):
            raise


def refusal_of(error: Exception) -> StreamError | None:
    """Return the system's refusal that caused an error of HDF5, or None."""
    said = " ".join(map(str, error.args))
    for doing, pattern in REFUSED.items():
        if found := re.search(pattern, said, re.DOTALL):
            file, errno, offset = found.groups()
            return StreamError(file, int(offset or 0), int(errno), doing)
    return None


class Opened(NamedTuple):
    """Holds a file that rows come from, and its size at the time of opening."""

    name: str
    size: int
    id: Any


class Part(NamedTuple):
    """Describes a part of a virtual dataset: where its rows are, and how many there have to be.

    Attributes
    ----------
    shape : tuple of int
        The least shape that the rows' dataset must have; empty for any.
    """

    file: str
    name: str
    shape: tuple[int, ...]


class Limits(NamedTuple):
    """Says what of a dataset is read.

    Attributes
    ----------
    taken : int
        Bytes of a budget that are not for chunks, for errors.
    room : int
        Bytes that HDF5 may take for chunks.
    external_storage : bool
        Whether rows may be in files that are no HDF5.
    seconds : int
        Seconds of the processor that an answer may take: HDF5 goes round for ever in some files
        that are damaged.
    """

    taken: int
    room: int
    external_storage: bool = False
    seconds: int = SECONDS


class Origins:
    """Keeps the files that datasets are made of open.

    Parameters
    ----------
    limits : Limits
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._files: dict[int, Opened] = {}
        self._named: dict[str, Any] = {}
        self._whole: set[tuple[int, int]] = set()

    def add(self, dataset: Any, place: str, outer: tuple[tuple[int, int], ...] = ()) -> None:
        """Open all that a dataset's rows come from.

        Parameters
        ----------
        dataset : h5py.h5d.DatasetID
        place : str
            Name of the dataset, for errors.
        outer : tuple
            The virtual datasets that are made of this one.

        Raises
        ------
        SceneError
            If something is missing, or it is made of itself, or of files that are no HDF5 and
            are not asked for.
        BudgetError
            If it has chunks that are larger than the room for them.
        OSError
            If the system refuses to open or read what is there.
        """
        info, plist = h5o.get_info(dataset), dataset.get_create_plist()
        key = info.fileno, info.addr
        check_chunks(dataset, plist, place, self._limits)
        if plist.get_external_count() and not self._limits.external_storage:
            raise SceneError(
                f"{place}: found rows kept outside of HDF5 (external storage), expected them in "
                "HDF5 files, or external_storage=True"
            )
        if key in outer or len(outer) == DEEPEST:
            raise SceneError(
                f"{place}: found a virtual dataset over itself, or over more than {DEEPEST} "
                "others, one over another, expected fewer, and numbers in the last"
            )
        if key in self._whole:
            return
        home = self._hold(h5i.get_file_id(dataset))
        if plist.get_layout() == h5d.VIRTUAL:
            for k in range(plist.get_virtual_count()):
                self._add_parts(plist, k, home, place, (*outer, key))
        for k in range(plist.get_external_count()):
            self._add_raw(plist.get_external(k), home, place)
        self._whole.add(key)

    def check_sizes(self) -> None:
        """Refuse a file that has become shorter: HDF5 reads missing bytes as zeros.

        Raises
        ------
        ShortReadError
        """
        for descriptor, file in self._files.items():
            with calling(file.name, "examining"):
                left = os.fstat(descriptor).st_size
            if left < file.size:
                raise ShortReadError(file.name, left, file.size - left, 0)

    def close(self) -> None:
        """Close all files."""
        for held in (*self._named.values(), *(file.id for file in self._files.values())):
            close(held)
        self._named.clear()
        self._files.clear()

    def _hold(self, file: Any) -> Opened:
        """Keep a file open; return its name, size and id."""
        descriptor = file.get_vfd_handle()
        if descriptor not in self._files:
            name = os.fsdecode(h5f.get_name(file))
            with calling(name, "examining"):
                size = os.fstat(descriptor).st_size
            self._files[descriptor] = Opened(name, size, file)
        return self._files[descriptor]

    def _add_raw(self, raw: tuple[bytes, int, int], home: Opened, place: str) -> None:
        """Open a file that has rows as they are, from a byte on."""
        name, offset, size = raw
        folder = os.environ.get(RAW_PREFIX, "").replace("${ORIGIN}", str(Path(home.name).parent))
        path = os.path.join(folder, os.fsdecode(name))  # noqa: PTH118
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        file = os.fdopen(descriptor, "rb", buffering=0)
        there = os.fstat(descriptor)
        self._files[descriptor] = Opened(path, there.st_size, file)
        if not stat.S_ISREG(there.st_mode):
            raise SceneError(f"{place}: found rows in {path!r}, which is no file, expected one")
        if size != h5s.UNLIMITED and there.st_size < offset + size:
            raise ShortReadError(path, offset, size, max(0, there.st_size - offset))

    def _add_parts(self, plist: Any, k: int, home: Opened, place: str, outer: Any) -> None:
        """Open the files that a mapping leads to."""
        for number, part in enumerate(parts_of(plist, k)):
            found = self._found(part, home)
            if found is None and number:
                return
            if found is None:
                raise SceneError(
                    f"{place}: found no dataset {part.name!r} in an HDF5 file {part.file!r}, "
                    "expected one, which its rows are of"
                )
            self.add(found, place, outer)
            check_shape(found, part, place)

    def _found(self, part: Part, home: Opened) -> Any:
        """Find the dataset that has a part's rows, or None."""
        file = home.id if part.file == "." else self._file(part.file, home.name)
        try:
            found = None if file is None else h5o.open(file, os.fsencode(part.name))
        except KeyError as error:
            if refusal_of(error):
                raise
            return None
        return found if isinstance(found, h5d.DatasetID) else None

    def _file(self, name: str, home: str) -> Any:
        """Open the file that HDF5 finds by a name, or return None."""
        refused = None
        for path in paths_of(name, home):
            if path not in self._named:
                try:
                    self._named[path] = opened(path)
                except OSError as error:  # HDF5 looks on too
                    if error.errno not in (None, errno.ENOENT):
                        refused = error
                    continue
            return self._named[path].id
        if refused is not None:
            raise refused
        return None


def check_chunks(dataset: Any, plist: Any, place: str, limits: Limits) -> None:
    """Refuse a dataset whose packed chunks are larger than the room for them.

    Of chunks that are not packed HDF5 reads what is asked for.
    """
    if plist.get_layout() != h5d.CHUNKED or not plist.get_nfilters():
        return
    size = math.prod(plist.get_chunk()) * dataset.get_type().get_size()
    takes = CHUNKS_AT_ONCE * size
    if takes > limits.room:
        raise BudgetError(
            f"{place}: found packed chunks of {size} bytes, which HDF5 reads whole, expected "
            f"smaller ones, or memory={format_memory(limits.taken + 2 * takes)} or more"
        )


def check_shape(dataset: Any, part: Part, place: str) -> None:
    """Refuse a dataset that has fewer rows than a part needs."""
    shape = dataset.shape
    same = len(part.shape) in (0, len(shape))
    if not same or any(there < least for there, least in zip(shape, part.shape, strict=False)):
        raise SceneError(
            f"{place}: found {part.name!r} of shape {shape} in {part.file!r}, expected "
            f"{part.shape} or more, which its rows are of"
        )


def parts_of(plist: Any, k: int) -> Iterator[Part]:
    """Yield the parts of a mapping: one, or any number for a pattern of names."""
    file, name = plist.get_virtual_filename(k), plist.get_virtual_dsetname(k)
    if "%b" in file + name:
        for block in itertools.count():
            yield Part(numbered(file, block), numbered(name, block), ())
    else:
        yield Part(file, name, least_shape(plist, k))


def numbered(pattern: str, block: int) -> str:
    """Fill a block's number into a pattern, as HDF5 does."""
    return "%".join(piece.replace("%b", str(block)) for piece in pattern.split("%%"))


def least_shape(plist: Any, k: int) -> tuple[int, ...]:
    """Return the least shape of the dataset that has a part's rows; empty for any."""
    space = plist.get_virtual_srcspace(k)
    if space.get_select_type() not in (h5s.SEL_HYPERSLABS, h5s.SEL_POINTS):
        return ()
    if space.is_regular_hyperslab() and h5s.UNLIMITED in itertools.chain(
        *space.get_regular_hyperslab()
    ):
        return ()
    return tuple(last + 1 for last in space.get_select_bounds()[1])


def paths_of(name: str, home: str) -> Iterator[str]:
    """Yield the paths where HDF5 looks for a file that the file `home` names, in its order."""
    folder = Path(home).absolute().parent
    if Path(name).is_absolute():
        yield name
        name = Path(name).name
    for prefix in filter(None, os.environ.get(PREFIXES, "").split(os.pathsep)):
        yield str(Path(prefix.replace("${ORIGIN}", str(folder))) / name)
    yield str(folder / name)
    yield name
    yield str(Path(home).resolve().parent / name)
