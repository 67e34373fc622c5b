"""Files into stores, cold, inside 256 MiB; objects a second are those of the JSON over seconds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from capped import CAP
from data import particles, terrain

import bfrt

SIDES = {"quick": 1001, "large": 5001, "huge": 10001}
PARTICLES = {"quick": 2_000_000, "large": 100_000_000, "huge": 100_000_000}
RINGS = {"quick": 36, "large": 94, "huge": 94}

Case = Callable[..., dict[str, Any]]

in_each_order = pytest.mark.parametrize("order", ["given", "spatial"])


@pytest.fixture(scope="session")
def ply(folder: Path, profile: str) -> Path:
    path = folder / "terrain.ply"
    terrain(SIDES[profile], path)
    return path


def stl_of(ply: Path) -> Path:
    """The same triangles as STL."""
    path = ply.with_suffix(".stl")
    with (
        bfrt.convert(ply, ply.with_suffix(".bfrt"))
        .path.joinpath("0", "triangle", "geometry")
        .open("rb") as geometry,
        path.open("wb") as file,
    ):
        count = ply_faces(ply)
        file.write(bytes(80) + count.to_bytes(4, "little"))
        while block := geometry.read(36 << 16):
            rows = np.zeros(len(block) // 36, [("normal", "V12"), ("corners", "V36"), ("a", "V2")])
            rows["corners"] = np.frombuffer(block, "V36")
            file.write(rows.tobytes())
    return path


def ply_faces(ply: Path) -> int:
    with ply.open("rb") as file:
        header = file.read(400).split(b"end_header")[0]
    return int(header.split(b"element face ")[1].split()[0])


def converted(case: Case, folder: Path, path: Path, **settings: str) -> None:
    case(
        "convert", [path], source=str(path), target=str(folder / "c.bfrt"), memory=CAP, **settings
    )  # fmt: skip


@in_each_order
@pytest.mark.benchmark(group="files")
def test_ply(case: Case, folder: Path, ply: Path, order: str) -> None:
    """Vertices fit where the profile is quick; else they are joined on disk."""
    converted(case, folder, ply, order=order)


@in_each_order
@pytest.mark.benchmark(group="files")
def test_stl(case: Case, folder: Path, ply: Path, order: str) -> None:
    stl = stl_of(ply)
    converted(case, folder, stl, order=order)
    stl.unlink()


@in_each_order
@pytest.mark.benchmark(group="files")
def test_hdf5(case: Case, folder: Path, profile: str, order: str) -> None:
    path = folder / "snapshot.h5"
    particles(PARTICLES[profile], path)
    converted(case, folder, path, order=order, radius="SmoothingLength", color_by="Density")
    path.unlink()


@in_each_order
@pytest.mark.benchmark(group="files")
def test_nff(case: Case, folder: Path, profile: str, order: str) -> None:
    path = folder / "rings.nff"
    with path.open("w") as file:
        bfrt.spd.rings(RINGS[profile]).write_nff(file)
    converted(case, folder, path, order=order)
    path.unlink()
