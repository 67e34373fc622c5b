"""The files of a store that is kept while it is made: held to a state, or removed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from bfrt.checkpoint.soundness import expect
from bfrt.checkpoint.state import HEADER as STATE
from bfrt.checkpoint.state import Facts, SavedState, check_file
from bfrt.errors import CheckpointError
from bfrt.ids import stream_number, stream_of
from bfrt.paths import HEADER, is_file, is_folder, walk
from bfrt.records import Kind
from bfrt.refusals import calling, refused
from bfrt.store.file_facts import checksum_of
from bfrt.store.ordering.files import ordered_folder, ordered_names, replace_folder
from bfrt.store.store import MADE, PALETTE
from bfrt.streams.removal import remove_folder


def hold_to_state(folder: Path, state: SavedState, *, whole: bool) -> None:
    """Have a folder hold what a state says and nothing else; compare all of it with its checksums.

    Parameters
    ----------
    folder : Path
        The store's.
    state : SavedState
    whole : bool
        Whether the store has its header already.

    Raises
    ------
    CheckpointError
        If a file is missing, or differs from what was written.
    StreamError
        If the system refuses.
    """
    if is_link(folder) or not is_folder(folder):
        raise CheckpointError(f"{folder}: found no folder, expected the store that is made")
    groups = state.facts["groups"]
    for number, group in enumerate(groups):
        for stream in group["streams"]:
            place = place_of(folder, number, stream["header"])
            check_ordering(state, stream, number, group["outliers"])
            settle_ordered(place, stream)
            if not has_column(place, stream):
                stream["ordering"] = None  # it is ordered from the beginning
    files = dict(files_of(folder, groups))
    own = [folder / PALETTE, *([folder / HEADER, folder / MADE] if whole else [])]
    folders = {folder, *(path.parent for path in files)}
    folders |= {folder / str(number) for number in range(len(groups))}
    remove_others(folder, {*files, *own}, folders)
    cut(folder / PALETTE, state.facts["palette"])
    for path, facts in files.items():
        if path.parent.name.endswith(".ordered"):
            cut(path, facts)
    for path, facts in (*files.items(), (folder / PALETTE, state.facts["palette"])):
        check_file(path, facts)


def place_of(folder: Path, number: int, header: Facts) -> Path:
    """Return the folder of a stream."""
    return folder / str(number) / Kind(header["kind"]).label


def files_of(folder: Path, groups: list[Facts]) -> Iterator[tuple[Path, Facts]]:
    """Yield the files of all streams, with their length and checksum."""
    for number, group in enumerate(groups):
        for stream in group["streams"]:
            place = place_of(folder, number, stream["header"])
            for name, facts in stream["header"]["files"].items():
                yield place / name, facts
            yield from under_way(place, stream)


def check_ordering(state: SavedState, stream: Facts, number: int, outliers: list[int]) -> None:
    """Refuse a stream on the way into order that has other files than it should, or places."""
    if stream["ordering"] is None:
        return
    ordering, path = stream["ordering"], state.folder / STATE
    kind = Kind(stream["header"]["kind"])
    names, places = sorted(ordering["files"]["files"]), len(ordering["places"])
    own = sum(stream_of(id) == stream_number(number, kind) for id in outliers)
    done, width = ordering["files"]["done"], ordering["files"]["materials"]["width"]
    expect(path, "files", names, right=names == sorted(ordered_names(kind)))
    expect(path, "places", places, right=places == own)
    expect(path, "done", done, right=done <= stream["header"]["count"])
    expect(path, "width", width, right=width in (0, 1, 2, 4))


def has_column(place: Path, stream: Facts) -> bool:
    """Tell whether materials of a stream on the way into order are as they were.

    They have another file where they have become wider since. When all are there the file gets its
    last name, which is taken from it again.
    """
    if stream["ordering"] is None or not stream["ordering"]["files"]["materials"]["width"]:
        return True
    facts = stream["ordering"]["files"]["materials"]
    path = ordered_folder(place) / f"materials.{facts['width']}"
    last = path.with_suffix("")
    if is_file(path) or not is_file(last):
        return is_file(path)
    with calling(path, "renaming to it"):
        last.rename(path)
    cut(path, facts)
    return checksum_of(path) == (facts["crc32"], facts["bytes"])


def under_way(place: Path, stream: Facts) -> Iterator[tuple[Path, Facts]]:
    """Yield the files of a stream that is on the way into order, as `files_of` does."""
    if stream["ordering"] is not None:
        files, folder = stream["ordering"]["files"], ordered_folder(place)
        column = files["materials"]
        for name, facts in files["files"].items():
            yield folder / name, facts
        if column["width"]:
            yield folder / f"materials.{column['width']}", column


def settle_ordered(place: Path, stream: Facts) -> None:
    """Put a stream that is in order into its place, if that was still to be done."""
    other = ordered_folder(place)
    if stream["made"] and stream["header"]["id_bytes"] and is_folder(other):
        replace_folder(place, other)


def remove_others(folder: Path, files: set[Path], folders: set[Path]) -> None:
    """Remove what is in a folder, but for some files and folders; links are none of them."""

    with calling(folder, "listing"):
        for place, below, names in walk(folder):
            for name in list(below):
                if place / name not in folders:
                    removed(place / name)
                    below.remove(name)
            for path in [place / name for name in names]:
                if path not in files or is_link(path):
                    with calling(path, "removing"):
                        path.unlink()


def is_link(path: Path) -> bool:
    """Tell whether a path is a link; `StreamError` where the system refuses to say it."""
    with calling(path, "examining"):
        return path.is_symlink()


def removed(folder: Path) -> None:
    """Remove a folder, which need not be there, with all that is in it.

    Raises
    ------
    StreamError
        If the system refuses.
    """
    refusal = remove_folder(folder)
    if refusal is not None:
        raise refused(folder, 0, refusal, "removing") from refusal


def cut(path: Path, facts: Facts) -> None:
    """Cut off what a file has got since it was as long as facts say."""
    with calling(path, "cutting", facts["bytes"]):
        if path.is_file() and path.stat().st_size > facts["bytes"]:
            os.truncate(path, facts["bytes"])
