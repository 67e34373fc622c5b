"""The file of a sharded scene: what it says, and one sentence for whatever else stands there."""

from __future__ import annotations

import copy
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sharded_scenes import both

import bfrt
from bfrt.errors import BfrtError, SettingError, StoreError
from bfrt.shards.joining import check_new_scene, join
from bfrt.shards.manifest import parse_manifest, read_manifest
from bfrt.store.header import header_text


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return both(tmp_path_factory.mktemp("scene"), 3).sharded.path


@pytest.fixture(scope="module")
def told(scene):
    return json.loads(scene.read_text())


def test_the_file_says_what_documentation_says(scene, told):
    assert sorted(told) == [
        "background", "bounds", "camera", "checksum", "lights", "magic", "origin", "shards",
        "version",
    ]  # fmt: skip
    assert [shard["path"] for shard in told["shards"]] == [f"part{n}.bfrt" for n in range(3)]
    assert [shard["group"] for shard in told["shards"]] == [0, 3, 6]
    assert all(
        shard["header"]["bytes"] == (scene.parent / shard["path"] / "scene.json").stat().st_size
        for shard in told["shards"]
    )
    assert scene.read_bytes() == header_text(told).encode()
    assert read_manifest(scene)[0].text() == scene.read_bytes()


def test_the_checksum_is_of_the_scene_alone(scene):
    manifest, _ = read_manifest(scene)
    other = copy.deepcopy(manifest)
    object.__setattr__(other.shards[1], "path", "elsewhere/x.bfrt")
    assert other.checksum == manifest.checksum
    object.__setattr__(other.shards[1], "checksum", 1)
    assert other.checksum != manifest.checksum


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda told: told.pop("origin"), "expected an object with"),
        (lambda told: told.update(version=2), "found version 2 of a sharded scene, expected 1"),
        (lambda told: told.update(magic="bfrt scene store"), "expected 'bfrt sharded scene'"),
        (lambda told: told.update(shards=[]), "shards: found none"),
        (lambda told: told["shards"][1].update(group=4), "expected one or more from 3 on"),
        (lambda told: told["shards"][0].update(path="/etc"), "found '/etc', expected a relative"),
        (lambda told: told["shards"][0].update(path=""), "found '', expected a relative path"),
        (lambda told: told["shards"][0].update(path="a\0"), "expected a path without NUL"),
        (lambda told: told["shards"][0]["streams"].append([0, 1]), "expected those of its groups"),
        (lambda told: told["shards"][0]["streams"].append([15, 1]), "found 15, expected a whole"),
        (lambda told: told["bounds"][0].__setitem__(0, -1e6), "around all shards"),
        (lambda told: told["camera"].update(angle=200.0), "expected 0 < angle < 180"),
    ],
)
def test_what_is_wrong_is_said(scene, told, change, says):
    wrong = copy.deepcopy(told)
    change(wrong)
    with pytest.raises(StoreError, match=rf"^{scene}: .*{says}"):
        parse_manifest(scene, header_text(wrong).encode())


@pytest.mark.parametrize(
    ("place", "shown"),
    [
        ("a\nb.bfrt", r"a\nb.bfrt: not a scene store"),
        ("\x1b[31m'\"\x07.bfrt", r"\x1b[31m'" '"' r"\x07.bfrt: not a scene store"),
        ("\u202etrfb.a", r"\u202etrfb.a: not a scene store"),
        ("\ud800", r"found '\ud800', expected a path that can be encoded"),
        ("x" * 5000, "x..., expected 4096 letters or fewer"),
        ("..", ": not a scene store"),
        ("part0.bfrt/scene.json", "scene.json: not a scene store"),
        ("part0.bfrt/../part0.bfrt", "it is not the one that"),
    ],
)
def test_paths_of_others_are_shown_on_one_line(scene, told, place, shown):
    wrong = copy.deepcopy(told)
    wrong["shards"][1]["path"] = place
    path = scene.with_name("nasty.bfrts")
    path.write_bytes(header_text(wrong).encode())
    with pytest.raises(BfrtError) as caught:
        bfrt.open(path)
    assert shown in str(caught.value) and str(caught.value).isprintable()


@pytest.mark.parametrize("text", [b"", b"{", b"[]", b"\xff", b"[" * 100000, b'{"magic": 1}'])
def test_what_is_no_scene_is_said(tmp_path, text):
    path = tmp_path / "a.bfrts"
    path.write_bytes(text)
    with pytest.raises(StoreError, match=rf"^{path}: not a sharded scene"):
        bfrt.open(path)


def test_a_changed_byte_is_found(scene, told):
    for at in range(0, scene.stat().st_size, 97):
        text = bytearray(scene.read_bytes())
        text[at] ^= 1
        with pytest.raises(StoreError, match=rf"^{scene}: "):
            parse_manifest(scene, bytes(text))


def places(part, way=()):
    """The ways to all values of a JSON text."""
    yield way
    if isinstance(part, (dict, list)):
        for key, inner in part.items() if isinstance(part, dict) else enumerate(part):
            yield from places(inner, (*way, key))


VALUES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False, allow_infinity=False),
    st.text(max_size=5), st.lists(st.integers(), max_size=3), st.just({}),
)  # fmt: skip


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_a_changed_value_is_a_sentence_or_the_same_scene(scene, told, data):
    """The file is signed again, so that no checksum stands in the way."""
    wrong = copy.deepcopy(told)
    way = data.draw(st.sampled_from([way for way in places(told) if way]))
    part = wrong
    for key in way[:-1]:
        part = part[key]
    part[way[-1]] = data.draw(VALUES)
    path = scene.with_name("wrong.bfrts")
    path.write_bytes(header_text(wrong).encode())
    try:
        opened = bfrt.open(path)
    except BfrtError as error:
        assert str(error).isprintable()
        assert len(str(error)) < 1000
    else:
        assert opened.objects == bfrt.open(scene).objects
        opened.close()


@pytest.mark.parametrize("name", ["scene.bfrt", "scene.json", "scene"])
def test_another_suffix_is_refused(tmp_path, name):
    with pytest.raises(SettingError, match=r"expected \.bfrts"):
        check_new_scene(tmp_path / name)


def test_what_is_no_sharded_scene_is_not_replaced(tmp_path, scene):
    path = tmp_path / "mine.bfrts"
    path.write_text("my own")
    with pytest.raises(SettingError, match=r"mine\.bfrts: found a file that is no sharded scene"):
        check_new_scene(path)
    path.write_bytes(scene.read_bytes())
    check_new_scene(path)


def test_no_shard_is_refused(tmp_path):
    with pytest.raises(SettingError, match="found no store"):
        join(tmp_path / "a.bfrts", [])
