"""Ambient occlusion: how much of the sky each place sees. visibility.py [FOLDER [PIXELS]]."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import bfrt

FINE = 2  # places an axis of each pixel, which are averaged
TONE = np.array([1.0, 0.93, 0.8], np.float32)
SKY = np.array([0.55, 0.75, 1.0], np.float32)


def openness(scene: bfrt.Scene, camera: bfrt.Camera) -> np.ndarray:
    """How open the places are that a camera sees, and 1 where it sees none, (h, w)."""
    rays = bfrt.camera_rays(camera)
    hits = scene.cast_rays(rays, outputs=["positions"], memory="256MiB")
    n, seen = hits["primitive_normals"], np.isfinite(hits["t_hit"])
    toward = (n * rays[..., 3:]).sum(axis=-1, keepdims=True) < 0
    n = np.where(toward, n, -n)  # of the side that is seen
    found = np.ones(seen.shape, np.float32)
    found[seen] = scene.visibility(
        hits["positions"][seen], n[seen], rays=16, cosine=True, memory="256MiB"
    )["visibility"]
    return np.where(seen, found, np.nan)


def main(folder: Path, pixels: int = 512) -> None:
    scene = bfrt.spd.rings(3).write(folder / "visibility.bfrt", order="spatial")
    camera = replace(scene.camera, resolution=(FINE * pixels, FINE * pixels))
    found = openness(scene, camera)[..., None]
    color = np.where(np.isnan(found), SKY, found * TONE)
    color = color.reshape(pixels, FINE, pixels, FINE, 3).mean(axis=(1, 3))
    channels = dict(zip("RGB", np.moveaxis(color, -1, 0), strict=True))
    image = bfrt.Image({**channels, "A": np.ones((pixels, pixels), np.float32)})
    image.save(folder / "visibility.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
