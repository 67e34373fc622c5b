"""Faces of very many corners, and palettes of very many materials, in the budget that is named."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from capped import memory_cap
from memory_cap import run_in

import bfrt
from bfrt.errors import BudgetError
from bfrt.formats import room
from bfrt.formats.room import need_of

VIEW = "v\nfrom 0 0 5\nat 0 0 0\nup 0 1 0\nangle 45\nhither 1\nresolution 8 8\nb 0 0 0\n"


def ring(corners):
    angles = np.arange(corners) * (2 * math.pi / corners)
    return np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)


def write_nff(path, corners):
    with path.open("w") as file:
        file.write(f"{VIEW}f 1 1 1 1 0 0 0 1\np {corners}\n")
        np.savetxt(file, ring(corners), "%.7g")


def write_ply(path, corners):
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {corners}\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list int int vertex_indices\nend_header\n"
    )
    indices = np.arange(-1, corners, dtype="<i4")
    indices[0] = corners
    path.write_bytes(header.encode() + ring(corners).astype("<f4").tobytes() + indices.tobytes())


WRITERS = {".nff": write_nff, ".ply": write_ply}


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_face_that_memory_does_not_hold_is_refused(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(room, "CORNERS", 10)
    monkeypatch.setattr(room, "CORNER_BYTES", 1 << 20)
    path = tmp_path / f"a{suffix}"
    WRITERS[suffix](path, 30)
    enough = need_of(str(path)).least + (20 << 20)
    short = (enough - need_of(str(path)).least) >> 20
    for memory in (need_of(str(path)).least, enough - (1 << 20)):
        with pytest.raises(BudgetError) as caught:
            bfrt.convert(path, tmp_path / "out.bfrt", memory=memory, order="given")
        assert str(caught.value) == (
            f"{path}: found a face of 30 corners, expected a budget of {short}MiB more to "
            "convert it"
        )
        assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
        short = 1
    made = bfrt.convert(path, tmp_path / "out.bfrt", memory=enough, order="given")
    assert made.objects == 1


CONVERT = """
import sys
import bfrt
path, memory = sys.argv[1:]
try:
    print(bfrt.convert(path, path + ".bfrt", memory=memory).objects)
except bfrt.BudgetError as error:
    print(error)
"""


def converted_in(path, memory):
    """What a conversion says in a cgroup of its budget, MiB."""
    with memory_cap(memory << 20) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        work = [sys.executable, "-c", CONVERT, str(path), f"{memory}MiB"]
        ended = run_in(group, work, path.parent)
    assert ended.returncode == 0, (memory, ended.returncode, ended.stderr)
    return ended.stdout


@pytest.mark.slow
@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("memory", [80, 100, 144, 216, 245])
def test_a_million_corners_in_any_budget(tmp_path, suffix, memory):
    path = tmp_path / f"a{suffix}"
    WRITERS[suffix](path, 1 << 20)
    said = converted_in(path, memory)
    assert said == "1\n" or "expected" in said
    assert said == "1\n" or memory < 245


@pytest.mark.slow
def test_a_million_materials_in_the_least_budget(tmp_path):
    path = tmp_path / "a.nff"
    with path.open("w") as file:
        file.write(VIEW)
        for k in range(1_000_000):
            file.write(f"f {k / 1e6:.7f} 1 1 1 0 0 0 1\ns {k} 0 0 0.5\n")
    assert "expected 132MiB or more" in converted_in(path, 80)
    assert converted_in(path, 132) == "1000000\n"
