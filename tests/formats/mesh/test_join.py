"""Meshes joined on disk are those joined in memory."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import Arrays, random_mesh, together
from meshes import FACES, VERTICES, open_files
from properties import examples

from bfrt.errors import BudgetError, SceneError
from bfrt.formats import mesh as mesh_module
from bfrt.formats.mesh import (
    by_window,
    joined,
    joined_in_memory,
    joined_on_disk,
    means,
    once_each,
    parts,
)

#: Bytes that faces of very many corners may take.
ROOM = 1 << 30


@examples(150)
@given(
    seed=st.integers(0, 1 << 30),
    n=st.integers(1, 40),
    faces=st.integers(0, 30),
    most=st.integers(1, 50),
    block=st.integers(1, 12),
    columns=st.integers(3, 6),
    dtype=st.sampled_from([np.float32, np.float64]),
    lookups=st.sampled_from([1, 3, 1 << 17]),
    spread=st.sampled_from([0, 1, 4]),
)
def test_on_disk_as_in_memory(
    tmp_path_factory, seed, n, faces, most, block, columns, dtype, lookups, spread
):
    vertices, lists = random_mesh(np.random.default_rng(seed), n, faces, columns, dtype, (0, 7))
    mesh = Arrays(vertices, lists, block=block)
    scratch = tmp_path_factory.mktemp("join")
    before = open_files()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_module, "LOOKUPS_AT_ONCE", lookups)
        patch.setattr(mesh_module, "SPREAD", spread)
        corners, counts = together(joined_on_disk(mesh, most, ROOM, scratch))
    right, sizes = together(joined_in_memory(mesh, ROOM))
    assert corners.dtype == right.dtype
    assert corners.tobytes() == right.tobytes()
    assert right.tobytes() == vertices[[i for face in lists for i in face]].tobytes()
    assert counts == sizes == [len(face) for face in lists]
    assert open_files() == before
    assert list(scratch.iterdir()) == []


def test_nothing_is_read_before_it_is_asked_for(tmp_path):
    mesh = Arrays(VERTICES, FACES)
    joined_on_disk(mesh, 2, ROOM, tmp_path)
    assert mesh.passes == 0


def test_a_join_that_is_left_gives_its_files_back(tmp_path):
    before = open_files()
    join = joined_on_disk(Arrays(VERTICES, FACES, block=1), 2, ROOM, tmp_path)
    next(join)
    if before:
        assert open_files() > before
    join.close()
    assert open_files() == before
    assert list(tmp_path.iterdir()) == []


@examples(100)
@given(
    indices=st.lists(st.one_of(st.integers(0, 20), st.integers(0, 1 << 40)), max_size=30),
    most=st.integers(1, 1 << 38),
)
def test_windows_of_what_is_needed(indices, most):
    given = np.array(indices, np.int64)
    needed, where = once_each(given)
    assert needed.tolist() == sorted(set(indices))
    assert needed[where].tolist() == indices
    most = max(most, 1 + (max(indices, default=0) >> 12))
    seen = []
    for window, part in by_window(needed, most):
        assert (needed[part] // most == window).all()
        assert part.stop > part.start
        seen += needed[part].tolist()
    assert seen == needed.tolist()


@pytest.mark.parametrize("most", [None, 1, 2, 4])
@pytest.mark.parametrize("bad", [-1, 6, 1 << 40, -(1 << 40)])
@pytest.mark.parametrize("place", [0, 1, 3, 4])
def test_indices_out_of_range(tmp_path, most, bad, place):
    lists = [*FACES, [0, 1, 2]]
    lists.insert(place, [0, 1, bad, 3])
    mesh = Arrays(VERTICES, lists, block=2)
    before = open_files()
    with pytest.raises(SceneError) as caught:
        together(
            joined_in_memory(mesh, ROOM)
            if most is None
            else joined_on_disk(mesh, most, ROOM, tmp_path)
        )
    assert str(caught.value) == f"mesh: face {place}: found vertex {bad}, expected 0 to 5"
    del caught
    assert open_files() == before


class Restless(Arrays):
    """A mesh whose second pass over the faces finds others."""

    others = FACES

    def face_blocks(self):
        if self.passes == 1:
            self.lists = self.others
        return super().face_blocks()


@pytest.mark.parametrize(
    "others",
    [FACES[:-1], FACES[1:], [], [*FACES, [0, 1, 2]], [*FACES[:-1], [0, 1, 2]], [*FACES, [4, 4, 4]]],
)
@pytest.mark.parametrize("most", [1, 2, 4])
def test_a_mesh_that_changes_is_refused(tmp_path, others, most):
    mesh = Restless(VERTICES, FACES, block=1)
    mesh.others = others
    with pytest.raises(SceneError) as caught:
        together(joined_on_disk(mesh, most, ROOM, tmp_path))
    assert str(caught.value) == "mesh: found other faces than before, expected a file at rest"


@pytest.mark.parametrize("change", [-6, -1, 1, 7])
def test_other_vertices_than_were_said(tmp_path, change):
    for most in (None, 1, 4):
        mesh = Arrays(VERTICES, [[0, 0, 0]])
        mesh.arrays = np.resize(mesh.arrays, (6 + change, 3))
        with pytest.raises(SceneError, match=r"mesh: found [0-9]* vertices, expected 6"):
            together(
                joined_in_memory(mesh, ROOM)
                if most is None
                else joined_on_disk(mesh, most, ROOM, tmp_path)
            )


def test_which_join(tmp_path):
    """In memory, as long as all vertices fit."""
    for room, name in ((72, "joined_in_memory"), (71, "joined_on_disk")):
        assert joined(Arrays(VERTICES, FACES), room, tmp_path).__name__ == name


def test_no_more_windows_than_may_have_files(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_module, "WINDOWS", 3)
    mesh = Arrays(VERTICES, FACES)
    assert joined(mesh, 24, tmp_path).__name__ == "joined_on_disk"
    with pytest.raises(BudgetError) as caught:
        joined(mesh, 23, tmp_path)
    said = "found 6 vertices, expected a budget of 1MiB more to join them with faces"
    assert str(caught.value) == f"mesh: {said}"


@examples(60)
@given(
    sizes=st.lists(st.integers(0, 9), max_size=20),
    most=st.integers(1, 30),
    block=st.integers(1, 9),
    columns=st.booleans(),
)
def test_blocks_of_faces_are_cut_up(sizes, most, block, columns):
    lists = [list(range(10 * i, 10 * i + size)) for i, size in enumerate(sizes)]
    given = []
    for faces in Arrays(VERTICES, lists, block=block).face_blocks():
        beside = [f.indices.sum() for f in [faces]] * len(faces.counts)
        own = np.array(beside, np.uint32) if columns else None
        given.append(faces._replace(values=own, materials=own))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_module, "CORNERS", most)
        found = list(parts(given))
    assert [i for part in found for i in part.indices.tolist()] == [i for f in lists for i in f]
    assert [count for part in found for count in part.counts.tolist()] == sizes
    for part in found:
        assert part.counts.sum() == len(part.indices)
        assert len(part.indices) <= most or len(part.counts) == 1
    for name in ("values", "materials"):
        cut, whole = ([getattr(f, name) for f in faces] for faces in (found, given))
        if columns and sizes:
            assert np.concatenate(cut).tolist() == np.concatenate(whole).tolist()
        else:
            assert not any(each is not None for each in cut)


def test_means_of_faces():
    values = np.arange(24.0).reshape(8, 3)
    counts = np.array([3, 0, 5], np.uint32)
    right = [values[:3].mean(axis=0), [0, 0, 0], values[3:].mean(axis=0)]
    np.testing.assert_allclose(means(values, counts), right)
    np.testing.assert_allclose(means(values[:, :1], counts), np.array(right)[:, 0])
