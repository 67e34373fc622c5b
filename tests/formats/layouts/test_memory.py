"""Files larger than their budgets are read within these: steps of particles, normals of meshes."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from capped import memory_cap
from layout_files import h5py, species_of
from layout_files import openpmd as write_openpmd
from memory_cap import run_in
from meshes import failure

import bfrt
from bfrt.errors import BudgetError
from bfrt.memory import parse_memory

#: Particles of a step, and vertices along a side.
ROWS = 1_500_000
SIDE = 700


def openpmd(path):
    rows = np.random.default_rng(1).random((ROWS, 3)).astype("f4")
    cells = np.arange(3 * ROWS, dtype="i8").reshape(-1, 3) % 1000
    own = species_of(rows, 0.5, cells, 0.5, weighting=((2.0, ROWS), 1.0))
    write_openpmd(path, {0: {"e": own}, 1: {"e": own}})
    assert path.stat().st_size > 100 << 20
    return ROWS, {"radius": "0.1", "frame": "0"}


def h5md(path):
    with h5py.File(path, "w") as made:
        frames = np.random.default_rng(1).random((6, ROWS, 3)).astype("f4")
        made["particles/all/position/value"] = frames
    return ROWS, {"radius": "0.1", "frame": "2"}


def grid():
    """Squares of a plane that is not flat, (n, 3) vertices with as many normals, and faces."""
    y, x = np.divmod(np.arange(SIDE * SIDE), SIDE)
    z = np.random.default_rng(0).random(SIDE * SIDE)
    vertices = np.stack([x, y, z], axis=1).astype("f4")
    a = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).reshape(-1)
    return vertices, vertices + 1, np.stack([a, a + 1, a + SIDE + 1, a + SIDE], axis=1)


def ply(path):
    vertices, normals, faces = grid()
    corners = np.empty(len(faces), [("n", "u1"), ("v", "<i4", 4)])
    corners["n"], corners["v"] = 4, faces
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    rows = np.hstack([vertices, normals]).tobytes()
    path.write_bytes("\n".join([*head, "end_header", ""]).encode() + rows + corners.tobytes())
    return 2 * len(faces), {"smooth": None}


def obj(path):
    vertices, normals, faces = grid()
    with path.open("w") as file:
        file.writelines(f"v {x} {y} {z}\n" for x, y, z in vertices.tolist())
        file.writelines(f"vn {x} {y} {z}\n" for x, y, z in normals.tolist())
        for face in (faces + 1).tolist():
            file.write(" ".join(["f", *(f"{corner}//{corner}" for corner in face)]) + "\n")
    return 2 * len(faces), {"smooth": None}


@pytest.mark.slow
@pytest.mark.parametrize(("write", "suffix"), [(openpmd, "h5"), (h5md, "h5"), (ply, "ply"),
                                               (obj, "obj")])  # fmt: skip
def test_the_least_is_enough(tmp_path, write, suffix):
    """In a cgroup of just that, everything counted."""
    path, made = tmp_path / f"a.{suffix}", tmp_path / "a.bfrt"
    count, options = write(path)
    settings = {name: True if of is None else float(of) for name, of in options.items()}
    said = failure(path, BudgetError, memory=1, **{**settings, "frame": None})
    least = said.partition("expected ")[2].split()[0]
    command = [sys.executable, "-m", "bfrt", "convert", str(path), "-o", str(made)]
    command += ["--memory", least, "--quiet"]
    command += [f"--{name}" if of is None else f"--{name}={of}" for name, of in options.items()]
    with memory_cap(parse_memory(least)) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        ended = run_in(group, command, tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert bfrt.open(made).objects == count
