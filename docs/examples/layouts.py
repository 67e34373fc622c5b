"""A snapshot in each layout of HDF5, side by side: layouts.py [FOLDER [PIXELS]]."""

from __future__ import annotations

import sys
from pathlib import Path

import h5py
import numpy as np

import bfrt

COUNT, STEPS, AXES = 40_000, 3, "xyz"
ROOT = {"openPMD": "1.1.0", "basePath": "/data/%T/", "particlesPath": "p/"}


def ring(step: int) -> np.ndarray:
    """Columns (4, n): places around a ring that grows, and how hot each particle is."""
    random = np.random.default_rng(step)
    turn, around = 2 * np.pi * random.random((2, COUNT))
    tube = 0.45 * np.sqrt(random.random(COUNT)) * (1 + 0.35 * np.cos(5 * turn))
    far = 0.7 + 0.2 * step + tube * np.cos(around)
    place = [far * np.cos(turn), far * np.sin(turn), tube * np.sin(around)]
    return np.array([*place, np.cos(5 * turn + around)], "f4")


def datasets_in(layout: str) -> dict[str, np.ndarray]:
    """The steps as a layout has them, by path; a table of records has the last alone."""
    frames = [ring(step) for step in range(STEPS)]
    if layout == "table":
        return {"gas": np.rec.fromarrays(list(frames[-1]), names=[*AXES, "heat"])}
    if layout == "h5md":  # all frames in one array
        value = {"position": [f[:3].T for f in frames], "heat": [f[3] for f in frames]}
        return {f"particles/gas/{name}/value": np.stack(each) for name, each in value.items()}
    folder = {"h5part": "Step#{}/", "openpmd": "data/{}/p/gas/"}[layout]
    inner = "position/" if layout == "openpmd" else ""
    paths = [*(folder + inner + axis for axis in AXES), f"{folder}heat"]
    return {path.format(k): c for k, f in enumerate(frames) for path, c in zip(paths, f)}  # noqa: B905


def main(folder: Path, pixels: int = 512) -> None:
    parts = []
    for layout in ("openpmd", "h5md", "h5part", "table"):
        with h5py.File(folder / f"{layout}.h5", "w") as file:
            file.attrs.update(ROOT if layout == "openpmd" else {})
            for path, data in datasets_in(layout).items():
                file[path] = data
                file[path].attrs["unitSI"] = 1.0  # of openPMD
        how = {"radius": 0.02, "color_by": "heat", "memory": "256MiB"}
        scene = bfrt.convert(folder / f"{layout}.h5", folder / f"{layout}.bfrt", **how)
        view = bfrt.Camera((0.6, -3.9, 2.9), (0, 0, -0.1), angle=44, resolution=(pixels // 2,) * 2)
        seen = scene.render(camera=view, memory="256MiB").channels
        parts.append(np.stack([seen[name] for name in "RGBA"]))
    rgba = np.concatenate([np.concatenate(parts[k : k + 2], axis=2) for k in (0, 2)], axis=1)
    bfrt.Image(dict(zip("RGBA", rgba, strict=True))).save(folder / "layouts.png")


if __name__ == "__main__":
    main(Path(*sys.argv[1:2]), *map(int, sys.argv[2:3]))
