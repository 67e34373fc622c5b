"""Copies of stores: every byte is checked, and nothing is copied twice."""

from __future__ import annotations

import shutil

import pytest
from cluster_fixtures import MEMORY, NEEDED, assert_same_picture, build

import bfrt
from bfrt.errors import SettingError, StoreError


@pytest.fixture
def source(tmp_path):
    scene = build(tmp_path / "source.bfrt", "given")
    scene.render(memory=MEMORY, refine="sgb")
    return scene


def files(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if
            path.is_file()}  # fmt: skip


def test_a_copy_is_the_store_with_its_marks(source, tmp_path):
    target = tmp_path / "disk" / "copy.bfrt"
    assert bfrt.copy_store(source.path, target) == str(target)
    assert files(target) == files(source.path)
    copy = bfrt.open(target)
    image = copy.render(memory=MEMORY, refine="sgb")
    assert image.stats.marks_reused
    expected = source.render(memory=MEMORY, refine="sgb")
    image.metadata["scene"] = expected.metadata["scene"]
    assert_same_picture(image, expected)


def test_a_store_is_copied_once(source, tmp_path):
    target = tmp_path / "copy.bfrt"
    bfrt.copy_store(source.path, target)
    before = target.stat().st_ino
    assert bfrt.copy_store(str(source.path), str(target)) == str(target)
    assert target.stat().st_ino == before


@pytest.mark.parametrize("name", ["palette", "0/sphere/geometry", "1/triangle/boxes", "0/marks"])
def test_a_copy_that_is_damaged_is_made_again(source, tmp_path, name):
    target = tmp_path / "copy.bfrt"
    bfrt.copy_store(source.path, target)
    spoil(target / name)
    bfrt.copy_store(source.path, target)
    assert files(target) == files(source.path)


def test_another_store_is_replaced_where_that_is_asked_for(source, tmp_path):
    target = tmp_path / "copy.bfrt"
    build(target, "spatial", size=2)
    before = files(target)
    with pytest.raises(SettingError) as caught:
        bfrt.copy_store(source.path, target)
    assert str(caught.value) == (
        f"{target}: found another store, expected {source.path}, or nothing: overwrite=True "
        "replaces it"
    )
    assert files(target) == before
    bfrt.copy_store(source.path, target, overwrite=True)
    assert files(target) == files(source.path)


@pytest.mark.parametrize("name", ["palette", "0/sphere/geometry", "0/marks"])
def test_a_source_that_is_damaged_is_refused(source, tmp_path, name):
    spoil(source.path / name)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(StoreError, match=name.rpartition("/")[2]):
        bfrt.copy_store(source.path, tmp_path / "copy.bfrt")
    assert sorted(tmp_path.iterdir()) == before


def test_what_is_no_store_is_not_replaced(source, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(SettingError, match="mine"):
        bfrt.copy_store(source.path, tmp_path / "mine")
    assert (tmp_path / "mine" / "letter").read_text() == "dear"


def test_a_store_that_is_not_there(tmp_path):
    with pytest.raises(StoreError, match="not a scene store"):
        bfrt.copy_store(tmp_path / "none.bfrt", tmp_path / "copy.bfrt")
    assert list(tmp_path.iterdir()) == []


def test_all_workers_copy(source, tmp_path, request):
    pytest.importorskip("distributed", reason=NEEDED)
    client = request.getfixturevalue("shared_client")
    target = tmp_path / "copy.bfrt"
    copied = client.run(bfrt.copy_store, str(source.path), str(target))
    assert len(copied) == 2 and set(copied.values()) == {str(target)}
    shutil.rmtree(source.path)
    scene = bfrt.open(target)
    settings = {"memory": MEMORY, "refine": "sgb"}
    image = scene.render(**settings, client=client)
    assert image.stats.marks_reused
    assert_same_picture(image, scene.render(**settings))


def spoil(path):
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
