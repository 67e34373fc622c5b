"""The least budget of a conversion, which follows the file, and is enough."""

from __future__ import annotations

import os
import re
import sys

import numpy as np
import pytest
from capped import memory_cap
from memory_cap import run_in
from meshes import convert, failure

import bfrt
from bfrt.errors import BudgetError
from bfrt.formats.room import (
    COLORS,
    FEWEST,
    FORMATS,
    GROWTH,
    MESH,
    SMOOTH,
    need_of,
    rooms_for,
)
from bfrt.memory import BASELINE, parse_memory

SUFFIXES = ("nff", "stl", "npy", "ply", "obj", "off", "xyz", "pcd", "dump")


#: What formats have before lines of points.
WORDS = {
    ".xyz": "# {} points\n",
    ".pcd": "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS {}\nDATA ascii\n",
    ".dump": "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{}\nITEM: BOX BOUNDS\n0 1\n0 1\n0 1\n"
    "ITEM: ATOMS x y z\n",
}


def write(path, side):
    """Squares (points, spheres) in a file of a format, none of them flat."""
    n = side + 1
    rng = np.random.default_rng(0)
    y, x = np.divmod(np.arange(n * n), n)
    vertices = np.stack([x, y, rng.random(n * n)], axis=1).astype(np.float32)
    a = (np.arange(side)[:, None] * n + np.arange(side)).reshape(-1)
    faces = np.stack([a, a + 1, a + n + 1, a + n], axis=1)
    if path.suffix == ".npy":
        np.save(path, vertices)
    elif path.suffix == ".nff":
        path.write_text("".join(f"s {x} {y} {z} 1\n" for x, y, z in vertices.tolist()))
    elif path.suffix in WORDS:
        rows = "".join(f"{x} {y} {z}\n" for x, y, z in vertices.tolist())
        path.write_text(WORDS[path.suffix].format(n * n) + rows)
    elif path.suffix == ".off":
        rows = [f"OFF\n{n * n} {len(faces)} 0\n", *(f"{x} {y} {z}\n" for x, y, z in vertices)]
        rows += ["4 {} {} {} {}\n".format(*face) for face in faces.tolist()]
        path.write_text("".join(rows))
    elif path.suffix == ".stl":
        facets = np.zeros(len(a), [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
        facets["v"] = vertices[faces[:, :3]]
        path.write_bytes(bytes(80) + np.uint32(len(a)).tobytes() + facets.tobytes())
    elif path.suffix == ".obj":
        rows = [f"v {x} {y} {z}\n" for x, y, z in vertices.tolist()]
        rows += ["f {} {} {} {}\n".format(*face) for face in (faces + 1).tolist()]
        path.write_text("".join(rows))
    else:
        corners = np.empty(len(a), [("n", "u1"), ("v", "<i4", 4)])
        corners["n"], corners["v"] = 4, faces
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {n * n}"]
        head += [f"property float {axis}" for axis in "xyz"]
        head += [f"element face {len(a)}", "property list uchar int vertex_indices"]
        text = "\n".join([*head, "end_header", ""]).encode()
        path.write_bytes(text + vertices.tobytes() + corners.tobytes())


def asked(suffix):
    return {"radius": 0.1} if suffix in ("npy", "xyz", "pcd", "dump") else {}


def least_of(path, **settings):
    """What a refusal names."""
    said = failure(path, BudgetError, memory=1, **settings)
    given = r"(?:, or \d+MiB in the order given \(--order given\))?"
    found = re.fullmatch(
        rf"memory: found 0MiB, expected (\d+MiB) or more to convert {re.escape(str(path))}{given}",
        said,
    )
    assert found is not None
    return found[1]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_least_follows_the_file(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    write(path, 1)
    assert least_of(path, **asked(suffix)) == "53MiB"
    assert convert(path, memory="53MiB", **asked(suffix)).objects > 0
    assert "expected 53MiB or more" in failure(path, BudgetError, memory="52MiB", **asked(suffix))
    with path.open("ab") as file:
        file.truncate(1 << 40)  # more than any block
    least = dict.fromkeys(("ply", "obj", "off"), "144MiB") | {"nff": "132MiB"}
    assert least_of(path, order="given", **asked(suffix)) == least.get(suffix, "100MiB")
    ordered = {**least, "stl": "124MiB"}
    assert least_of(path, **asked(suffix)) == ordered.get(suffix, "114MiB")
    if suffix not in least:
        said = failure(path, BudgetError, memory="100MiB", **asked(suffix))
        assert said.endswith(f"convert {path}, or 100MiB in the order given (--order given)")


def room_for(name, memory, size=None, **asked):
    return rooms_for([need_of(name, size, **asked)], memory)[0]


def test_the_least_for_all_files_is_named_at_once():
    needs = [need_of(name) for name in ("-", "a.h5", "a.laz")]
    most = max(need.least for need in needs)
    with pytest.raises(BudgetError, match=r"more to convert a\.h5"):
        rooms_for(needs, BASELINE)
    assert rooms_for(needs, most) == [most - need.blocks for need in needs]


def test_what_is_left_is_for_vertices(tmp_path):
    path = tmp_path / "a.ply"
    write(path, 4)
    size = path.stat().st_size
    assert room_for(str(path), 1 << 30) == (1 << 30) - BASELINE - GROWTH * size
    assert room_for("none.ply", BASELINE) == 0
    assert room_for("spd:balls:3", BASELINE + 640, 10) == 0
    for name, taken in (
        ("-", FORMATS[".nff"]),
        ("a.h5", FORMATS[".h5"]),
        ("a.laz", FORMATS[".laz"]),
    ):
        least = BASELINE + taken.library + taken.blocks + taken.fewest
        assert room_for(name, least) == taken.fewest
        with pytest.raises(BudgetError, match=re.escape(name)):
            room_for(name, least - 1)
    assert MESH.fewest == FEWEST
    least = BASELINE + FORMATS[".nff"].blocks
    assert room_for("-", least) == 0
    with pytest.raises(BudgetError):
        room_for("-", least, colored=True)
    assert room_for("-", least + COLORS, colored=True) == 0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_nobody_knows_what_a_pipe_holds(tmp_path):
    os.mkfifo(tmp_path / "a.nff")
    assert room_for(str(tmp_path / "a.nff"), BASELINE + FORMATS[".nff"].blocks) == 0
    with pytest.raises(BudgetError):
        room_for(str(tmp_path / "a.nff"), BASELINE + FORMATS[".nff"].blocks - 1)


def test_of_several_files_the_one_that_takes_most_counts(tmp_path):
    small, large = tmp_path / "a.stl", tmp_path / "b.stl"
    write(small, 1)
    write(large, 300)
    least = least_of(large)
    assert parse_memory(least) > parse_memory(least_of(small))
    with pytest.raises(BudgetError, match=f"expected {least} or more to convert .*b.stl"):
        bfrt.convert([small, large], tmp_path / "x.bfrt", memory="53MiB")
    scene = bfrt.convert([small, large], tmp_path / "x.bfrt", memory=least)
    assert len(scene.store.groups) == 2


def test_standard_scenes_have_a_least_too(tmp_path):
    said = r"expected 102MiB or more to convert spd:tetra:9, or 100MiB in the order given \(--order"
    with pytest.raises(BudgetError, match=said):
        bfrt.convert("spd:tetra:9", tmp_path / "x.bfrt", memory="101MiB")
    with pytest.raises(BudgetError, match=r"expected 100MiB or more to convert spd:tetra:9$"):
        bfrt.convert("spd:tetra:9", tmp_path / "x.bfrt", memory="99MiB", order="given")
    assert not list(tmp_path.iterdir())
    assert bfrt.convert("spd:tetra:1", tmp_path / "x.bfrt", memory="53MiB").objects == 4


@pytest.mark.parametrize("side", [1, 100, 400])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_least_is_enough(tmp_path, suffix, side):
    """In a cgroup of just that, everything counted."""
    path, made = tmp_path / f"a.{suffix}", tmp_path / "a.bfrt"
    write(path, side)
    least = least_of(path, **asked(suffix))
    command = [sys.executable, "-m", "bfrt", "convert", str(path), "-o", str(made)]
    command += ["--memory", least, "--quiet"]
    command += [f"--{name}={value}" for name, value in asked(suffix).items()]
    with memory_cap(parse_memory(least)) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        ended = run_in(group, command, tmp_path)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert bfrt.open(made).objects >= side * side


@pytest.mark.parametrize("suffix", ["ply", "obj", "npz", "h5"])
def test_patches_take_more(suffix):
    for name in (f"a.{suffix}", "a.stl", "a.laz"):
        more = need_of(name, 1 << 40, smooth=True).least - need_of(name, 1 << 40).least
        assert more == (SMOOTH if name.startswith("a." + suffix) else 0)
    assert need_of("a.ply", 10, smooth=True) == need_of("a.ply", 10)
