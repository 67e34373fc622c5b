"""Text that gzip has packed is the text, in every format that has text."""

from __future__ import annotations

import gzip
import io
import os

import meshes
import nff_files
import numpy as np
import obj_files
import pcd_files
import ply_files
import pytest
import stl_files
from hypothesis import given
from hypothesis import strategies as st
from meshes import failure, objects_of

import bfrt
from bfrt.conversion.views import read_view
from bfrt.errors import SceneError
from bfrt.formats import gzipped as gzipped_module
from bfrt.formats.gzipped import Unpacked, suffix_of

POINTS = np.arange(27, dtype=np.float32).view([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])

FILES = {
    "a.nff": b"f 1 0 0 1 0 0 0 1\ns 1 2 3 4\ns 0 0 0 1\n",
    "text.ply": ply_files.mesh("ascii"),
    "bytes.ply": ply_files.mesh("binary_little_endian"),
    "text.stl": stl_files.text(),
    "bytes.stl": stl_files.binary(),
    "a.obj": obj_files.obj().encode(),
    "a.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "a.xyz": b"1 2 3\n4 5 6\n",
    "text.pcd": pcd_files.pcd(POINTS, "ascii"),
    "packed.pcd": pcd_files.pcd(POINTS, "binary_compressed"),
    "a.dump": b"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS\n0 1\n0 1\n0 1\n"
    b"ITEM: ATOMS x y z\n1 2 3\n",
}
OF_POINTS = ("a.xyz", "text.pcd", "packed.pcd", "a.dump")


def converted(path, name):
    store = meshes.convert(path, **({"radius": 1} if name in OF_POINTS else {}))
    return objects_of(store)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("piece", [7, 1 << 17])
def test_the_same_objects(tmp_path, monkeypatch, name, piece):
    monkeypatch.setattr(gzipped_module, "PACKED_AT_ONCE", piece)
    plain, packed = tmp_path / name, tmp_path / f"b{name}.gz"
    plain.write_bytes(FILES[name])
    packed.write_bytes(gzip.compress(FILES[name]))
    whole = converted(plain, name)
    assert converted(packed, name) == whole != []
    packed.write_bytes(gzip.compress(FILES[name])[:-5])
    said = failure(packed, SceneError, **({"radius": 1} if name in OF_POINTS else {}))
    assert said.endswith("expected more of what gzip has packed: the file is truncated")


def test_the_view_of_packed_nff(tmp_path):
    path = tmp_path / "a.nff.gz"
    path.write_bytes(gzip.compress(nff_files.SCENE))
    plain = tmp_path / "a.nff"
    plain.write_bytes(nff_files.SCENE)
    assert read_view(path) == read_view(plain)


def test_progress_is_of_what_is_packed(tmp_path):
    path = tmp_path / "a.xyz.gz"
    random = np.random.default_rng(0)
    text = io.BytesIO()
    np.savetxt(text, random.random((90_000, 3)))
    path.write_bytes(gzip.compress(text.getvalue(), 1))
    seen = []

    def report(done):
        if done.stage == "reading":
            seen.append((int(done), done.total))

    bfrt.convert(path, tmp_path / "a.bfrt", radius=1, progress=report, durable=False)
    size = path.stat().st_size
    assert {total for _, total in seen} == {size}
    assert max(done for done, _ in seen) == size and len({done for done, _ in seen}) > 3


@given(
    st.lists(st.binary(max_size=2000), max_size=4),
    st.lists(st.tuples(st.integers(0, 9000), st.integers(1, 3000)), max_size=9),
    st.integers(1, 500),
)
def test_any_place_of_the_content(tmp_path_factory, members, asked, piece):
    path = tmp_path_factory.getbasetemp() / "members.gz"
    whole = b"".join(members)
    path.write_bytes(b"".join(map(gzip.compress, members)) or gzip.compress(b""))
    with pytest.MonkeyPatch.context() as patch, io.FileIO(os.fspath(path)) as file:
        patch.setattr(gzipped_module, "PACKED_AT_ONCE", piece)
        unpacked = Unpacked(file, "members.gz")
        assert unpacked.measure() == len(whole)
        for at, size in asked:
            assert unpacked.seek(at) == min(at, len(whole))
            buffer, done = memoryview(bytearray(size)), 0
            while done < size and (got := unpacked.readinto(buffer[done:])):
                done += got
            assert bytes(buffer[:done]) == whole[at : at + size]


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("a.PLY.GZ", ".ply"), ("a.b.nff", ".nff"), ("a.gz", ""), (".gz", ""), ("x/a.XYZ.gz", ".xyz")],
)
def test_suffixes(name, suffix):
    assert suffix_of(name) == suffix
