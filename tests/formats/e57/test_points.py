"""E57 in, spheres out: scans, poses, colors; and files that are broken."""

from __future__ import annotations

import os
import struct

import numpy as np
import pytest
from e57_files import places, scan, write
from fuzz.e57 import bare, paged
from hypothesis import given, settings
from hypothesis import strategies as st
from meshes import convert, failure, objects_of, outcome, shades, shapes_of

from bfrt.errors import SceneError, SettingError
from bfrt.formats.colors import linear
from bfrt.formats.e57 import reader as reader_module
from bfrt.formats.remote import process

TURNED = ((0.5, 0.5, -0.5, 0.5), (5e5, 5.4e6, 300))


def centers(path, **asked):
    shapes = shapes_of(convert(path, order="given", radius=1, **asked))
    return np.array([shape[0][:3] for shape in shapes]).reshape(-1, 3)


@pytest.mark.parametrize("spherical", [False, True])
@pytest.mark.parametrize("invalid", [False, True])
def test_scans_and_poses(tmp_path, spherical, invalid):
    path = tmp_path / "a.e57"
    scans = [scan(n, n, spherical=spherical, invalid=invalid) for n in (70_000, 3, 0, 40)]
    poses = [TURNED, None, None, ((2, 0, 0, 1), (5e5, 5.4e6, 0))]
    write(path, scans, poses)
    found = centers(path)
    twin = np.concatenate([places(s, p) for s, p in zip(scans, poses, strict=True)])
    assert found.shape == twin.shape
    assert np.abs(found - twin).max() < 1e-8


quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(st.integers(1, 50), quaternions, st.integers(0, 99), st.booleans())
@settings(max_examples=8)
def test_round_trip(tmp_path_factory, count, quaternion, seed, spherical):
    path = tmp_path_factory.mktemp("e57") / "a.e57"
    made = scan(count, seed, spherical=spherical)
    pose = (quaternion, (1, -2, 3))
    write(path, [made], [pose])
    assert np.abs(centers(path) - places(made, pose)).max() < 1e-9


def test_colors_and_intensity(tmp_path):
    path = tmp_path / "a.e57"
    made = scan(20)
    for name, values in (("Red", 255), ("Green", 0), ("Blue", 51)):
        made[f"color{name}"][:] = values
    write(path, [made])
    (color,) = {each.color for each in objects_of(convert(path, radius=1, color_by="rgb"))}
    assert np.allclose(color, linear(np.array([1, 0, 6 / 31])), atol=1e-6)
    found = shades(convert(path, radius=1, color_by="intensity", colormap="gray"))
    assert np.argsort(found, kind="stable").tolist() == np.argsort(made["intensity"]).tolist()
    assert failure(path, SettingError, radius=1, color_by="mass").startswith(
        "found no column 'mass', expected one of x y z red green blue cartesianX"
    )


def test_scans_have_what_all_of_them_have(tmp_path):
    path = tmp_path / "a.e57"
    write(path, [scan(5), scan(5, colored=False, spherical=True)])
    assert len(centers(path)) == 10
    said = failure(path, SettingError, radius=1, color_by="rgb")
    assert said == "found no column 'red', expected one of x y z intensity"


def test_no_scan_and_no_position(tmp_path):
    path = tmp_path / "a.e57"
    write(path, [])
    assert len(centers(path)) == 0
    write(path, [{"intensity": np.ones(3, np.float32)}])
    assert failure(path, radius=1).startswith("scan 0: found fields intensity, expected cartes")


def test_without_the_library(tmp_path, monkeypatch):
    path = tmp_path / "a.e57"
    write(path, [scan(1)])
    monkeypatch.setattr(reader_module, "is_installed", lambda name: False)
    with pytest.raises(SettingError, match=r"a\.e57: E57 needs pye57: install bfrt\[e57\]$"):
        convert(path, radius=1)


# --- files that are broken -----------------------------------------------------------------------


@pytest.fixture
def whole(tmp_path):
    path = tmp_path / "a.e57"
    write(path, [scan(300)], [TURNED])
    return path.read_bytes()


def test_every_cut_of_the_header_is_refused(tmp_path, whole):
    path = tmp_path / "a.e57"
    for size in [*range(49), 1023, 1024, len(whole) - 1024, len(whole) - 1]:
        path.write_bytes(whole[:size])
        assert "truncated" in outcome(path, radius=1)


@pytest.mark.parametrize(
    ("at", "form", "value", "said"),
    [
        (0, "8s", b"ASTM-E58", "found 'ASTM-E58', expected ASTM-E57"),
        (16, "Q", 1 << 40, "byte 16: found"),
        (24, "Q", 1 << 40, "byte 24: found"),
        (32, "Q", 1 << 40, "byte 24: found"),
        (40, "Q", 4096, "byte 40: found pages of 4096 bytes, expected 1024"),
        (8, "I", 77, "found 'checksum mismatch"),
    ],
)
def test_headers_that_are_wrong(tmp_path, whole, at, form, value, said):
    path = tmp_path / "a.e57"
    data = bytearray(whole)
    struct.pack_into(f"<{form}", data, at, value)
    path.write_bytes(data)
    assert failure(path, SceneError, radius=1).lower().startswith(said.lower()[:20])


def test_xml_that_is_too_long(tmp_path, whole, monkeypatch):
    path = tmp_path / "a.e57"
    path.write_bytes(whole)
    monkeypatch.setattr(reader_module, "MOST_XML", 100)
    assert failure(path, radius=1).endswith("bytes of XML, expected 100 or fewer")


def test_xml_that_may_name_other_files(tmp_path, whole):
    path = tmp_path / "a.e57"
    data = bare(whole)
    head = b'<?xml version="1.0" encoding="UTF-8"?>'
    assert head in data
    entity = b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'
    long = data.replace(head, head + b" " * len(entity), 1)
    for text, said in (
        (
            long.replace(head + b" " * len(entity), head + entity),
            "found '<?xml' and a DOCTYPE",
        ),
        (long.replace(head, head.replace(b"<?xml", b"<?XML")), "found '<?XML', expected <?xml wi"),
        (long, "300 objects"),
    ):
        changed = bytearray(text)
        struct.pack_into("<Q", changed, 32, struct.unpack_from("<Q", data, 32)[0] + len(entity))
        path.write_bytes(paged(bytes(changed)))
        assert said in outcome(path, radius=1)


def test_bytes_that_are_wrong_are_found_by_checksums(tmp_path, whole):
    path = tmp_path / "a.e57"
    for at in range(60, len(whole), len(whole) // 12):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        assert "expected an E57 file that is whole" in outcome(path, radius=1)


def test_a_process_that_ends_is_told(tmp_path, whole, monkeypatch):
    path = tmp_path / "a.e57"
    path.write_bytes(whole)
    ending = "import os; os.abort()" if hasattr(os, "abort") else "raise SystemExit(3)"
    monkeypatch.setattr(process, "SERVE", ending)
    said = failure(path, radius=1)
    assert said.startswith("found what ends libE57Format itself (status -6), expected an E57 file")
