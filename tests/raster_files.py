"""Rasters as tests write them with rasterio, and what a reader makes of them, said simply."""

from __future__ import annotations

import json
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed: bfrt[raster]")

from bfrt.formats.raster import child, remote  # noqa: E402
from bfrt.formats.remote import serving  # noqa: E402

RNG = np.random.default_rng(3)
HEIGHTS = (RNG.integers(0, 4000, (7, 9)) / 4).astype(np.float32)
UTM = rasterio.Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 5_400_000.0)
CRS = "EPSG:32632"


def write(
    path: Path, heights: Any = HEIGHTS, transform: Any = UTM, crs: Any = CRS, **profile: Any
) -> Path:
    """A GeoTIFF of one band, or of as many as `heights` has axes of three."""
    bands = heights if heights.ndim == 3 else heights[None]
    facts = {
        "driver": "GTiff", "count": len(bands), "height": bands.shape[1], "width": bands.shape[2],
        "dtype": bands.dtype, "transform": transform, "crs": crs,
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path, "w", **{**facts, **profile}) as file:
            file.write(bands)
    return path


def origin_of(shape: tuple[int, int], transform: Any) -> tuple[float, float]:
    x, y = transform @ (shape[1] / 2, shape[0] / 2)
    return float(round(x)), float(round(y))


def triangles(heights: Any, there: Any, transform: Any) -> list[Any]:
    """What `meshes.shapes_of` gives for a raster: two triangles a cell, with their normals up."""
    rows, columns = heights.shape
    ox, oy = origin_of(heights.shape, transform)

    def corner(i: int, j: int) -> tuple[float, float, float]:
        x, y = transform @ (j + 0.5, i + 0.5)
        return (
            float(np.float32(x - ox)) + ox, float(np.float32(y - oy)) + oy,
            float(np.float32(heights[i, j])),
        )  # fmt: skip

    found = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            places = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
            if not all(there[place] for place in places):
                continue
            a, b, c, d = (corner(*place) for place in places)
            for one in ((a, b, c), (a, c, d)):
                u, v = np.subtract(one[1], one[0]), np.subtract(one[2], one[0])
                up = u[0] * v[1] - u[1] * v[0] > 0
                found.append(one if up else (one[0], one[2], one[1]))
    return found


class Here:
    """Stands for `bfrt.formats.remote.process.RemoteFile`: no process is begun."""

    def __init__(self, path: str, limits: Any, library: Any) -> None:
        self._env = rasterio.Env(**child.CONFIGURATION)
        self._env.__enter__()
        try:
            self._server = child.Server(path, *limits)
            self.facts = json.loads(json.dumps([*self._server.facts()]))
        except BaseException:
            self.close()
            raise

    def numbers(self, request: list[Any], dtype: Any, most: int) -> Any:
        words, block = self._server.verbs[request[0]](*request[1:])
        assert json.loads(json.dumps(words)) == words
        if block is None:
            return None
        assert block.dtype == dtype and block.size <= most
        return block

    def close(self) -> None:
        if hasattr(self, "_server"):
            self._server._file.close()
        self._env.__exit__(None, None, None)


@contextmanager
def in_this_process() -> Any:
    """Rasters are read here: quicker, where what is read matters and not how."""
    assert serving.answer
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(remote, "RemoteFile", Here)
        yield patch
