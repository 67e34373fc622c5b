"""The datasets of an HDF5 file by their names, links followed: `bfrt.formats.table.Arrays`.

The file is opened by its name and read by HDF5 itself. Its reads do not go through Python: HDF5
opens further files, of virtual datasets and external links, in the way in which the first is open,
which for a file of Python's is the end of the process.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5g, h5i, h5l, h5o
from numpy.typing import NDArray

from bfrt.errors import BfrtError, SceneError
from bfrt.formats.hdf5.attributes import Constant, attributes_of, is_constant
from bfrt.formats.hdf5.origins import Limits, Origins, close, opened, refusal_of
from bfrt.formats.naming import within
from bfrt.formats.source import Source, printable
from bfrt.formats.table import Array, Column, Listed, Path, frame_of, paths_of


def failure(
    source: Source, error: Exception, expected: str, place: str = ""
) -> BfrtError | MemoryError:
    """Return the exception for an error of HDF5: the system's refusal, where one caused it."""
    return refusal_of(error) or source.failure(error, expected, place)


class Dataset:
    """Reads an HDF5 dataset: a `bfrt.formats.table.Array`.

    Parameters
    ----------
    source : Source
        The file that it is in, or is linked to.
    name : str
        Its path.
    dataset : h5py.Dataset
    origins : Origins
        The files that it is made of.
    frame : int, optional
        A frame along the first dimension, which the array then does not have.
    """

    def __init__(
        self,
        source: Source,
        name: str,
        dataset: Any,
        origins: Origins,
        frame: int | None = None,
    ) -> None:
        self.name = f"{source.name}: {printable(name)}"
        self._path = name
        self._place = f"{printable(name)}: "
        self._source = source
        self._dataset = dataset
        self._origins = origins
        self._frame = frame
        try:
            shape: tuple[int, ...] = dataset.shape
            self.dtype: np.dtype[Any] = dataset.dtype
        except Exception as error:
            expected = "numbers of a type that NumPy has"
            raise failure(source, error, expected, self._place) from error
        self.shape = shape if frame is None else shape[1:]

    def blocks(self, rows: int) -> Iterator[NDArray[Any]]:
        """Yield all rows, `rows` at a time."""
        for first in range(0, self.shape[0], rows):
            part = slice(first, first + rows)
            try:
                block: NDArray[Any] = self._dataset[
                    part if self._frame is None else (self._frame, part)
                ]
            except Exception as error:
                self._check_filters()
                place = f"{self._place}row {first}: "
                expected = "rows that can be read"
                raise failure(self._source, error, expected, place) from error
            self._origins.check_sizes()
            yield block

    def frame(self, number: int) -> Dataset:
        """Return a frame of (frames, n, 3), as (n, 3)."""
        place = frame_of(number, self.shape[0], self.name)
        return Dataset(self._source, self._path, self._dataset, self._origins, place)

    def shallow(self) -> Dataset:
        """Return the last frame of (frames, n, 3), as (n, 3)."""
        return self.frame(-1)

    def _check_filters(self) -> None:
        """Raise an error that names a missing filter, where rows cannot be read for lack of it."""
        plist = self._dataset.id.get_create_plist()
        for k in range(plist.get_nfilters()):
            number, _, _, name = plist.get_filter(k)
            if not h5py.h5z.filter_avail(number):
                called = printable(os.fsdecode(name)) or "no name"
                raise SceneError(
                    f"{self.name}: found rows compressed by filter {number} ({called}), expected "
                    "one that HDF5 has here: a plugin for it, in HDF5_PLUGIN_PATH"
                )


class Datasets(Listed):
    """Maps paths to the arrays of a file: its datasets, the fields of their records, and constants.

    Listed is each dataset once, by hard links as HDF5 visits them, then what only soft and external
    links lead to, and links that lead nowhere; any other path that leads to one may be asked for.

    Parameters
    ----------
    source : Source
    limits : Limits

    Raises
    ------
    SceneError
        If it is no HDF5 file, or one that is broken.
    StreamError
        If the system refuses to read it.
    """

    def __init__(self, source: Source, limits: Limits) -> None:
        self._source = source
        self._origins = Origins(limits)
        try:
            self._file = opened(source.name)
        except Exception as error:  # h5py has them of every kind for files that are broken
            raise failure(source, error, "an HDF5 file") from error
        self._listed: dict[str, None] = {}
        super().__init__(self._listed)
        try:
            self._list()
        except Exception as error:
            self.close()
            raise failure(source, error, "datasets") from error

    def close(self) -> None:
        """Close all files."""
        self._origins.close()
        close(self._file)

    def __contains__(self, name: object) -> bool:
        if super().__contains__(name):
            return True
        try:
            return isinstance(name, str) and self._found(name) is not None
        except SceneError:  # a link leads nowhere, which is told of when it is followed
            return True

    def __getitem__(self, name: str) -> Array:
        found = self._found(name)
        if found is None:
            raise KeyError(name)
        dataset, path = found
        if isinstance(dataset, h5g.GroupID):
            return self._constant(name, dataset)
        whole = name.removesuffix("/".join(path)).rstrip("/") if path else name
        place = printable(whole)
        try:
            self._origins.add(dataset, f"{self._source.name}: {place}")
        except Exception as error:
            raise failure(self._source, error, "all that it is made of", f"{place}: ") from error
        array = Dataset(self._source, whole, h5py.Dataset(dataset), self._origins)
        return Column(array, path) if path else array

    def attributes(self, path: str, *names: str) -> dict[str, Any] | None:
        """Return those attributes of some names that an object has; None if there is no object.

        Raises
        ------
        SceneError
            If one is neither text nor a number, nor some of them.
        """
        try:
            thing = self._opened(path, follows=True)
            return None if thing is None else attributes_of(thing, names)
        except Exception as error:
            expected, place = "texts or numbers", f"{printable(path) or '/'}: "
            raise failure(self._source, error, expected, place) from error

    def _constant(self, name: str, group: Any) -> Constant:
        """Return a constant record component."""
        try:
            return Constant(self._source, name, group)
        except Exception as error:
            expected, place = "a constant", f"{printable(name)}: "
            raise failure(self._source, error, expected, place) from error

    def _list(self) -> None:
        """Find the names of all datasets; datasets that only links lead to come last."""
        seen: set[tuple[int, int]] = set()
        files: dict[int, Any] = {}  # open, so that one that is linked twice is the same
        hard = [""]
        linked: deque[str] = deque()
        while hard or linked:
            path, follows = (hard.pop(), False) if hard else (linked.popleft(), True)
            thing = self._opened(path, follows)
            info = None if thing is None else h5o.get_info(thing)
            if info is None:
                self._listed[path] = None
            elif (info.fileno, info.addr) not in seen:
                seen.add((info.fileno, info.addr))
                files.setdefault(info.fileno, h5i.get_file_id(thing))
                inner, outer = links_of(thing)
                hard.extend(within(path, name) for name in reversed(inner))
                linked.extend(within(path, name) for name in outer)
                self._listed.update(dict.fromkeys(names_of(path, thing)))

    def _opened(self, path: str, follows: bool) -> Any:
        """Open the object at a path; None where a link to follow leads nowhere."""
        try:
            return h5o.open(self._file.id, os.fsencode(path or "/"))
        except Exception:  # of every kind
            if follows:
                return None
            raise

    def _found(self, name: str) -> tuple[Any, Path] | None:
        """Find the dataset at a path, and the way on to a field of it.

        Raises
        ------
        SceneError
            If a link on the way leads nowhere.
        """
        try:
            return self._followed(name.split("/"))
        except Exception as error:
            expected, place = "a dataset", f"{printable(name)}: "
            raise failure(self._source, error, expected, place) from error

    def _followed(self, parts: list[str]) -> tuple[Any, Path] | None:
        """Find the dataset at a path cut at its slashes, and the way on to a field of it."""
        at = h5o.open(self._file.id, b"/")
        for k, part in enumerate(parts):
            if isinstance(at, h5d.DatasetID):
                return field_at(at, "/".join(parts[k:]))
            name = os.fsencode(part)
            if not isinstance(at, h5g.GroupID) or not name or b"\0" in name:
                return None
            if not at.links.exists(name):
                return None
            at = self._step(at, name, "/".join(parts[: k + 1]))
        return (at, ()) if isinstance(at, h5d.DatasetID) or is_constant(at) else None

    def _step(self, group: Any, name: bytes, path: str) -> Any:
        """Open the member of a group by its name."""
        try:
            return h5o.open(group, name)
        except Exception as error:
            if group.links.get_info(name).type == h5l.TYPE_HARD or refusal_of(error):
                raise
            raise SceneError(
                f"{self._source.name}: {printable(path)}: found a link to "
                f"{target_of(group.links.get_val(name))}, which leads nowhere, expected a dataset"
            ) from error


def target_of(link: bytes | tuple[bytes, bytes]) -> str:
    """Return the target of a soft or an external link, for an error."""
    if isinstance(link, tuple):
        file, path = map(os.fsdecode, link)
        return f"{path!r} in the file {file!r}"
    return repr(os.fsdecode(link))


def field_at(dataset: Any, name: str) -> tuple[Any, Path] | None:
    """Return a dataset and the way to its field of this name, if it has one."""
    fields = {"/".join(path): path for path in fields_of(dataset)}
    return (dataset, fields[name]) if name in fields else None


def fields_of(dataset: Any) -> list[Path]:
    """Return the fields of a dataset's records; none for plain numbers and unknown types."""
    try:
        return paths_of(dataset.dtype)
    except Exception:  # it may be in nobody's way
        return []


def links_of(thing: Any) -> tuple[list[str], list[str]]:
    """Return the names of a group's hard links, and of all others; none for what is no group."""
    inner: list[str] = []
    outer: list[str] = []
    for name in thing if isinstance(thing, h5g.GroupID) else ():
        is_hard = thing.links.get_info(name).type == h5l.TYPE_HARD
        (inner if is_hard else outer).append(os.fsdecode(name))
    return inner, outer


def names_of(path: str, thing: Any) -> list[str]:
    """Return the names of a dataset's arrays: its own, or one for each field.

    A virtual one is not asked for its shape, for which HDF5 might look into other files.
    """
    if not isinstance(thing, h5d.DatasetID):
        return [path] if is_constant(thing) else []
    if thing.get_create_plist().get_layout() != h5d.VIRTUAL and not thing.shape:
        return []  # one number, or nothing
    fields = fields_of(thing)
    return [within(path, "/".join(field)) for field in fields] or [path]
