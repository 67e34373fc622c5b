"""Stores whose bytes were changed anywhere: opened, rendered small, and asked.

::

    input   how (2 bytes), files of the store (fuzz.packing)

``how`` says what is done, and whether the header is signed anew.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fast
import numpy as np
from faults.work import tight
from fuzz.packing import files_in, packed, put, unpacked
from fuzz.readers import TYPES, saved
from fuzz.trial import Harness, of_bytes, of_files
from injected import dividing
from scenes import random_objects
from signing import sign_store
from treelets import small_treelets

import bfrt
from bfrt.records import Kind

MEMORY = "96MiB"
VIEW = bfrt.Camera((0.0, 0.0, 15.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), resolution=(12, 12))
RAYS = 40

Scene = bfrt.Scene
Doing = Callable[[Scene, Path], object]


def rendering(refine: str) -> Doing:
    def do(scene: Scene, folder: Path) -> object:
        return scene.render(
            camera=VIEW, refine=refine, memory=MEMORY, threads=1, scratch=folder / "tmp"
        )

    return do


def asking(query: str, refine: str) -> Doing:
    rng = np.random.default_rng(3)
    origins = rng.uniform(-6, 6, (RAYS, 3))

    def do(scene: Scene, folder: Path) -> object:
        return getattr(scene, query)(
            origins, -origins, refine=refine, memory=MEMORY, threads=1, scratch=folder / "tmp"
        )

    return do


def verifying(scene: Scene, _: Path) -> object:
    return scene.verify()


#: What is done with a store.
DOING = (
    *(rendering(refine) for refine in ("base", "sg", "sgb", "sgb", "tree", "tree", "tree")),
    asking("cast_rays", "tree"), asking("list_intersections", "tree"),
    asking("cast_rays", "sgb"), asking("count_intersections", "sgb"), asking("occluded", "base"),
    verifying,
)  # fmt: skip

SIGNED, WIDE = 1, 2

#: Bytes that say how.
HEAD = 2


def build(path: Path, order: Any, dtype: str, groups: int = 1) -> dict[str, bytes]:
    """The files of a small store of all kinds, with marks where it has a grid."""
    with (
        small_treelets(),
        bfrt.SceneWriter(path, order=order, dtype=dtype, hierarchy=fast.DEEP) as writer,
    ):
        writer.camera(VIEW)
        writer.light(bfrt.Light((1.0, 2.0, 30.0)))
        shiny = writer.material(bfrt.Material(ks=0.5, transmittance=0.3))
        for group in range(groups):
            objects = random_objects(np.random.default_rng(group), 60)
            writer.append(Kind.SPHERE, objects.spheres, shiny, group=group)
            writer.append(Kind.CONE, objects.cones, group=group)
            writer.append(Kind.TRIANGLE, objects.triangles, group=group)
            writer.append(Kind.PATCH, objects.patches, shiny, group=group)
            writer.append_polygons(objects.vertices, objects.counts, group=group)
    if order == "given":
        bfrt.render(path, refine="sgb", memory=MEMORY, threads=1)
    return files_in(path)


def resign(path: Path) -> None:
    """Sign a header anew, if it is one, and have it tell the sizes of the files."""
    with contextlib.suppress(ValueError, LookupError, TypeError, AttributeError, OSError,
                             OverflowError, RecursionError):  # fmt: skip
        header = json.loads((path / "scene.json").read_bytes())
        header["palette"]["bytes"] = (path / "palette").stat().st_size
        for number, group in enumerate(header["groups"]):
            for stream in group["streams"]:
                folder = path / str(number) / Kind(stream["kind"]).label
                for name, facts in stream["files"].items():
                    facts["bytes"] = (folder / name).stat().st_size
        sign_store(path, header)


def store(home: Path) -> Harness:
    made = [
        build(home / "given.bfrt", "given", "float32"),
        build(home / "groups.bfrt", "given", "float64", 2),
        build(home / "ordered.bfrt", "spatial", "float32"),
        build(home / "wide.bfrt", "spatial", "float64"),
    ]
    names = sorted({name for files in made for name in files})

    def run(data: bytes, folder: Path) -> None:
        path = folder / "in" / "a.bfrt"
        how, chosen, *_ = (*data[:HEAD], 0, 0)
        put(unpacked(data[HEAD:], names), path)
        if how & SIGNED:
            resign(path)
        scene = bfrt.open(path)
        with scene if how & WIDE else dividing(scene, tight) as opened, np.errstate(all="ignore"):
            DOING[chosen % len(DOING)](opened, folder)

    seeds = [
        bytes([how, chosen]) + packed(files, names)
        for files in made
        for how in range(SIGNED | WIDE + 1)
        for chosen in range(len(DOING))
    ]
    return of_files(seeds, (b"null", b"true", b"[]", b"{}", b'"', b"1e999"), run, names, HEAD)


def rays(home: Path) -> Harness:
    """Files of rays, which queries take."""
    build(home / "given.bfrt", "given", "float32")
    rng = np.random.default_rng(3)
    points = rng.uniform(-6, 6, (RAYS, 3))
    np.save(home / "directions.npy", -points)

    def run(data: bytes, folder: Path) -> None:
        (folder / "in" / "a.npy").write_bytes(data)
        with bfrt.open(home / "given.bfrt") as scene:
            scene.cast_rays(
                folder / "in" / "a.npy", home / "directions.npy", memory=MEMORY, threads=1,
                scratch=folder / "tmp", out=folder / "out" / "answer",
            )  # fmt: skip

    arrays = (points, points.astype(">f4"), np.asfortranarray(points), (points * 9).astype("i2"))
    return of_bytes([saved(array) for array in arrays], TYPES, run)
