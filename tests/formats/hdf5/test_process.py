"""HDF5 is read in a process of its own: it may end, and be ended, and takes what it is given."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hdf5_files import CENTERS, snapshot, write
from meshes import convert, failure, open_files, shapes_of, spheres

from bfrt.errors import BudgetError
from bfrt.formats.hdf5.remote import RemoteArrays
from bfrt.formats.remote import process as remote
from bfrt.formats.remote.messages import type_of_words, words_of_type
from bfrt.formats.room import need_of

h5py = pytest.importorskip("h5py", reason="h5py is not installed: bfrt[hdf5]")

LIMITS = (0, 1 << 30, False)

#: A process that ends in the way that a broken file makes HDF5 end.
CRASH = """
import json, os, sys
sys.path[:] = sys.argv[2:]
from bfrt.formats.hdf5 import child
from bfrt.formats.remote import serving
served = serving.answer
def crash(verbs, verb, *words):
    if verb == {verb!r}:
        os.kill(os.getpid(), {signal})
    return served(verbs, verb, *words)
serving.answer = crash
child.main(*json.loads(sys.argv[1]))
"""


@pytest.mark.parametrize("verb", ["open", "begin", "next"])
@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGABRT, signal.SIGKILL])
def test_what_ends_hdf5_is_one_sentence(file, monkeypatch, verb, number):
    monkeypatch.setattr(remote, "SERVE", CRASH.format(verb=verb, signal=int(number)))
    write(file, snapshot())
    said = f"found what ends HDF5 itself (status -{int(number)}), expected datasets that are whole"
    assert failure(file, radius=1) == said


@pytest.mark.parametrize(
    "junk", [b"", b"x", b"\xff" * 40, b"\x02\0\0\0" + bytes(8) + b"{}", bytes(100)]
)
def test_what_is_no_answer_is_the_same(file, monkeypatch, junk):
    monkeypatch.setattr(remote, "SERVE", f"import os; os.write(1, {junk!r}); os._exit(3)")
    write(file, snapshot())
    said = "found what ends HDF5 itself (status 3), expected datasets that are whole"
    assert failure(file, radius=1) == said


def test_an_error_of_ours_shows_where(file, monkeypatch):
    broken = CRASH.replace("os.kill(os.getpid(), {signal})", "raise ZeroDivisionError('here')")
    monkeypatch.setattr(remote, "SERVE", broken.format(verb="open", signal=0))
    write(file, snapshot())
    with pytest.raises(RuntimeError, match=r"in crash\n(.*\n)?ZeroDivisionError: here"):
        convert(file, radius=1)


def test_it_has_no_modules_of_the_working_folder(file, monkeypatch):
    """Such as sources of bfrt that are not built."""
    write(file, snapshot())
    (file.parent / "bfrt").mkdir()
    (file.parent / "bfrt" / "__init__.py").write_text("raise ImportError('not built')\n")
    monkeypatch.chdir(file.parent)
    assert shapes_of(convert(file, radius=1)) == spheres(CENTERS, 1)


# --- its end -------------------------------------------------------------------------------------


def is_running(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{process}/stat")
    return not stat.exists() or stat.read_text().rsplit(")", 1)[1].split()[0] != "Z"


def test_it_ends_with_what_it_is_for(file):
    write(file, snapshot())
    before = open_files()
    arrays = RemoteArrays(str(file), LIMITS)
    process = arrays._file._process
    assert process.poll() is None
    arrays.close()
    assert process.poll() is not None
    assert open_files() == before


KILLED = """
import os, signal, sys
from bfrt.formats.hdf5.remote import RemoteArrays
arrays = RemoteArrays(sys.argv[1], (0, 1 << 30, False))
blocks = arrays["big"].blocks(1 << 16)
next(blocks)
if sys.argv[2] == "writing":
    arrays._file._channel.send(["next", 0])  # more than a pipe holds: it waits to be read
print(arrays._file._process.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("at", ["asked", "writing"])
def test_it_ends_when_the_other_process_is_killed(file, tmp_path, at):
    write(file, {"big": np.zeros((1 << 18, 3))})
    work = [sys.executable, "-c", KILLED, str(file), at]
    ended = subprocess.run(work, cwd=tmp_path, capture_output=True, text=True)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    until = time.monotonic() + 20
    while is_running(int(ended.stdout)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not is_running(int(ended.stdout))


# --- its memory ----------------------------------------------------------------------------------


def test_a_chunk_that_is_larger_than_memory_allows(file, monkeypatch):
    rows = np.zeros((1 << 21, 3), np.float32)
    rows[: len(CENTERS)] = CENTERS
    with h5py.File(file, "w") as made:
        made.create_dataset("Coordinates", data=rows, chunks=rows.shape, compression="gzip")
    least = need_of(str(file)).least
    size = rows.nbytes
    enough = need_of(str(file)).blocks + 8 * size
    said = (
        f"Coordinates: found packed chunks of {size} bytes, which HDF5 reads whole, expected "
        f"smaller ones, or memory={enough >> 20}MiB or more"
    )
    for memory in (least, enough - 1):
        assert failure(file, BudgetError, radius=1, memory=memory) == said
    assert convert(file, radius=1, memory=enough).objects == len(rows)


def test_chunks_of_what_a_virtual_dataset_is_over(file):
    other = file.with_name("b.h5")
    with h5py.File(other, "w") as made:
        made.create_dataset("rows", (1 << 21, 3), "f4", chunks=(1 << 21, 3), compression="gzip")
    layout = h5py.VirtualLayout((1 << 21, 3), "f4")
    layout[:] = h5py.VirtualSource("b.h5", "rows", (1 << 21, 3))
    with h5py.File(file, "w") as made:
        made.create_virtual_dataset("Coordinates", layout)
    said = failure(file, BudgetError, radius=1, memory=need_of(str(file)).least)
    assert said.startswith("Coordinates: found packed chunks of 25165824 bytes, which HDF5 reads")


@pytest.mark.parametrize("packing", [{}, {"compression": "gzip", "shuffle": True}])
def test_what_a_chunk_takes(file, packing):
    """Packed as badly as can be; a chunk that is not packed is read as far as it is asked for."""
    rows = np.random.default_rng(1).normal(size=(1 << 20, 3))
    with h5py.File(file, "w") as made:
        made.create_dataset("big", data=rows, chunks=rows.shape, **packing)
        made["small"] = CENTERS
    peaks = []
    for name, expected in (("small", CENTERS), ("big", rows)):
        arrays = RemoteArrays(str(file), LIMITS)
        np.testing.assert_array_equal(next(arrays[name].blocks(7)), expected[:7])
        status = Path(f"/proc/{arrays._file._process.pid}/status").read_text()
        peaks.append(int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) << 10)
        arrays.close()
    took = peaks[1] - peaks[0]
    assert took < (4 * rows.nbytes if packing else 1 << 21)


# --- its words -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "dtype",
    [
        "f4", ">f8", "u1", "?", "V7", "S3", "O", "c16", "M8[ns]", "(2,3)i4",
        [("a", "f4"), ("b", [("c", "O"), ("d\udcff", "i8", (2,))])],
        {"names": ["b", "a"], "formats": ["i4", "f8"], "offsets": [12, 0], "itemsize": 20},
    ],
)  # fmt: skip
def test_types_in_words(dtype):
    given = np.dtype(dtype)
    assert type_of_words(words_of_type(given)) == given
