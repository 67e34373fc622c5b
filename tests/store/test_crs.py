"""The reference system that a store may have: told, kept, and no part of stores without one."""

from __future__ import annotations

import json

import numpy as np
import pytest

import bfrt
from bfrt.errors import SceneError, StoreError
from bfrt.store.header import header_text

TRIANGLE = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], np.float32)


def written(path, crs=None):
    with bfrt.SceneWriter(path) as writer:
        if crs is not None:
            writer.crs(crs)
        writer.triangles(TRIANGLE)
    return bfrt.open(path)


@pytest.mark.parametrize("crs", ["EPSG:32632", 'PROJCS["eine Karte", "Größe"]'])
def test_it_is_kept(tmp_path, crs):
    scene = written(tmp_path / "a.bfrt", crs)
    assert scene.crs == scene.store.crs == crs
    scene.verify()


def test_a_store_without_one_is_as_it_was(tmp_path):
    assert written(tmp_path / "a.bfrt").crs == ""
    header = json.loads((tmp_path / "a.bfrt" / "scene.json").read_text())
    assert "crs" not in header and header["version"] == 5


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("crs", "", "crs: found '', expected a text"),
        ("crs", 3, "crs: found 3, expected a text"),
        ("crs", None, "crs: found None, expected a text"),
        ("datum", "EPSG:1", "expected an object with magic, version"),
    ],
)
def test_others_are_damaged(tmp_path, field, value, words):
    written(tmp_path / "a.bfrt")
    file = tmp_path / "a.bfrt" / "scene.json"
    file.write_text(header_text({**json.loads(file.read_text()), field: value}))
    with pytest.raises(StoreError, match=words):
        bfrt.open(tmp_path / "a.bfrt")


@pytest.mark.parametrize("crs", ["", None, 7, "x" * (1 << 20)])
def test_what_is_none(tmp_path, crs):
    with pytest.raises(SceneError, match="crs: found"), bfrt.SceneWriter(tmp_path / "a") as writer:
        writer.crs(crs)
    assert not any(tmp_path.iterdir())


def test_there_is_one(tmp_path):
    writer = bfrt.SceneWriter(tmp_path / "a.bfrt")
    writer.crs("EPSG:1")
    writer.crs("EPSG:1")
    with pytest.raises(SceneError, match="found EPSG:2, expected EPSG:1, as of what was before"):
        writer.crs("EPSG:2")
    writer.abandon()
