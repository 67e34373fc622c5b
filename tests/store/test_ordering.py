"""Stores in spatial order as files: whole or not there, told of, and as large as was said."""

from __future__ import annotations

import errno
import itertools
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from boxes import boxes_of
from meshes import open_files

import bfrt
from bfrt.cli.command import main
from bfrt.errors import Cancelled, SettingError, StoreError, StreamError
from bfrt.records import Kind
from bfrt.store.header import header_text
from bfrt.store.store import open_store
from bfrt.store.writer import StoreWriter
from bfrt.streams.writer import FileWriter

NEW_FILES = ("ids", "nodes", "treelets")
KINDS = tuple(kind.label for kind in Kind)


@pytest.fixture(autouse=True, scope="module")
def small_windows():
    """Windows, blocks and parts of few objects, so that all of them are there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bfrt.store.ordering.given.OBJECTS_AT_ONCE", 16)
        patch.setattr("bfrt.store.ordering.regions.OBJECTS_AT_ONCE", 16)
        patch.setattr("bfrt.store.ordering.objects.VERTICES_AT_ONCE", 24)
        patch.setattr("bfrt.store.ordering.order.WINDOW", 40)
        patch.setattr("bfrt.store.locality.TOGETHER", 16)
        yield


def fill(writer, n=150, seed=1):
    """Add objects of all kinds, in no order."""
    rng = np.random.default_rng(seed)
    centers = rng.random((n, 3)).astype(np.float32)
    near = centers[:, None] + rng.normal(0, 0.01, (n, 3, 3)).astype(np.float32)
    materials = [writer.material(bfrt.Material(kd=kd)) for kd in (0.25, 0.5)]
    which = np.resize(materials, n)
    writer.spheres(centers, np.float32(0.01), which)
    writer.cones(centers, np.float32(0.01), centers + np.float32(0.02), np.float32(0.02), which)
    writer.triangles(near, which)
    writer.patches(near, near, which)
    corner = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32) / 50
    writer.polygons((centers[:, None] + corner).reshape(-1, 3), np.full(n, 4), which)


def make(path, n=150, **how):
    with StoreWriter(path, **{"order": "spatial", **how}) as writer:
        fill(writer, n)
    return open_store(path)


def steps():
    """Some numbers from 1 on, the first of them all."""
    at = 1
    while True:
        yield at
        at += 1 + at // 6


@pytest.fixture(scope="module")
def whole(tmp_path_factory, small_windows):
    """Not to be changed."""
    path = tmp_path_factory.mktemp("store") / "whole.bfrt"
    make(path)
    return path


@pytest.fixture
def path(whole, tmp_path):
    """To be damaged."""
    return shutil.copytree(whole, tmp_path / "a.bfrt")


ANOTHER = r"^order: found .*, expected given, spatial or auto$"


# --- what is asked for ---------------------------------------------------------------------------


@pytest.mark.parametrize("order", ["Spatial", "", "tree", None, 3])
def test_there_is_no_such_order(tmp_path, order):
    nff = tmp_path / "a.nff"
    nff.write_text("s 0 0 0 1\n")
    for call in (
        lambda: StoreWriter(tmp_path / "a.bfrt", order=order),
        lambda: bfrt.SceneWriter(tmp_path / "a.bfrt", order=order),
        lambda: bfrt.convert(nff, tmp_path / "a.bfrt", order=order),
        lambda: bfrt.spd.balls(1).write(tmp_path / "a.bfrt", order=order),
    ):
        with pytest.raises(SettingError, match=ANOTHER):
            call()
    assert [p.name for p in tmp_path.iterdir()] == ["a.nff"]


@pytest.mark.parametrize(
    ("order", "ordered"), [(None, True), ("auto", True), ("spatial", True), ("given", False)]
)
def test_every_edge_takes_the_order(tmp_path, order, ordered):
    nff = tmp_path / "a.nff"
    nff.write_text("s 0 0 0 1\ns 3 0 0 1\n")
    how = {} if order is None else {"order": order}
    command = [] if order is None else ["--order", order]
    with bfrt.SceneWriter(tmp_path / "w.bfrt", **how) as writer:
        writer.spheres([[0, 0, 0]], 1)
    bfrt.convert(nff, tmp_path / "c.bfrt", **how)
    assert main(["convert", str(nff), "-o", str(tmp_path / "cc.bfrt"), *command]) == 0
    for name in ("w", "c", "cc"):
        assert [s.ordered for s in open_store(tmp_path / f"{name}.bfrt").streams] == [ordered]
    bfrt.spd.balls(1).write(tmp_path / "s.bfrt", **how)
    output = ["-o", str(tmp_path / "ss.bfrt")]
    assert main(["spd", "balls", "1", "--quiet", *output, *command]) == 0
    for name in ("s", "ss"):
        streams = open_store(tmp_path / f"{name}.bfrt").streams
        assert [s.ordered for s in streams] == [ordered and order is not None] * len(streams)


# --- what is told --------------------------------------------------------------------------------


def test_info_tells_the_order(whole, tmp_path, capsys):
    assert main(["info", "--json", str(whole)]) == 0
    streams = json.loads(capsys.readouterr().out)["streams"]
    for told, stream in zip(streams, open_store(whole).streams, strict=True):
        assert told["order"] == "spatial"
        assert told["treelets"] == stream.treelets > 0
        assert told["nodes_bytes"] == stream.path("nodes").stat().st_size == 80 * stream.nodes
        assert told["ids_bytes"] == stream.path("ids").stat().st_size == 4 * stream.count
    assert main(["info", str(whole)]) == 0
    assert "order spatial  treelets 4  nodes_bytes" in capsys.readouterr().out
    make(tmp_path / "g.bfrt", order="given")
    assert main(["info", str(tmp_path / "g.bfrt")]) == 0
    assert "order given  treelets 0  nodes_bytes 0  ids_bytes 0" in capsys.readouterr().out


def test_progress_tells_the_stage(tmp_path):
    told = []
    with StoreWriter(tmp_path / "a.bfrt") as writer:
        fill(writer)
        writer.complete(told.append)
    assert {done.stage for done in told} == {"ordering"}
    assert {done.total for done in told} == {5 * 150}
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0, 5 * 150)
    assert len(set(told)) > 50


def test_progress_of_a_conversion_reads_and_then_orders(tmp_path):
    nff = tmp_path / "a.nff"
    nff.write_text("".join(f"s {i} 0 0 1\n" for i in range(100)))
    told = []
    bfrt.convert(nff, tmp_path / "a.bfrt", progress=told.append)
    stages = [(stage, list(some)) for stage, some in itertools.groupby(told, lambda d: d.stage)]
    assert [stage for stage, _ in stages] == ["reading", "ordering"]
    for _, some in stages:
        assert some[-1] == some[-1].total
    told.clear()
    bfrt.convert(nff, tmp_path / "a.bfrt", order="given", progress=told.append)
    assert {done.stage for done in told} == {"reading"}
    told.clear()
    bfrt.spd.balls(2).write(tmp_path / "b.bfrt", order="spatial", progress=told.append)
    assert [s for s, _ in itertools.groupby(d.stage for d in told)] == ["writing", "ordering"]


# --- what is left --------------------------------------------------------------------------------


def test_cancelled_at_any_report_leaves_nothing(tmp_path):
    for last in steps():
        reports = itertools.count()
        before = open_files()
        try:
            with StoreWriter(tmp_path / "a.bfrt", durable=False) as writer:
                fill(writer)
                writer.complete(lambda _, reports=reports, last=last: next(reports) != last)
            break
        except Cancelled as error:
            assert str(error).startswith("cancelled while ordering, with ")
        assert not list(tmp_path.iterdir())
        assert open_files() == before
    assert last > 50


def test_a_conversion_is_cancelled_as_it_reads(tmp_path):
    nff = tmp_path / "a.nff"
    nff.write_text("s 0 0 0 1\n" * 10)
    for no in (False, np.False_):
        with pytest.raises(Cancelled, match="cancelled while reading, with"):
            bfrt.convert(nff, tmp_path / "a.bfrt", progress=lambda _, no=no: no)
    assert [p.name for p in tmp_path.iterdir()] == ["a.nff"]


CALLS = [
    (os, "write", errno.ENOSPC),
    (os, "pwrite", errno.ENOSPC),
    (os, "preadv", errno.EIO),
    (os, "open", errno.ENOSPC),
    (os, "fsync", errno.EIO),
    (Path, "open", errno.EIO),
    (Path, "mkdir", errno.ENOSPC),
    (Path, "rename", errno.EIO),
    (shutil, "rmtree", errno.EIO),
]


def broken_at(monkeypatch, folder, owner, name, failure):
    """Make a store in a folder that has one, a call of which fails: the first, the second ..."""
    path, real = folder / "a.bfrt", getattr(owner, name)
    how = {"durable": name == "fsync"}
    make(path, order="given", **how)
    old = (path / "scene.json").read_bytes()
    for failing in steps():
        calls = itertools.count(1)

        def fail(*arguments, failing=failing, calls=calls, **named):
            if next(calls) == failing:
                raise failure()
            return real(*arguments, **named)

        before = open_files()
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, fail)
            try:
                make(path, **how)
                replaced = True
            except (StreamError, KeyboardInterrupt, SettingError) as error:
                # Folders above are asked whether they are stores.
                places = str(folder), "/scene.json: reading at byte 0"
                assert isinstance(error, KeyboardInterrupt) or any(p in str(error) for p in places)
                # It may come late, as the new store, which has its name, is opened.
                replaced = (path / "scene.json").read_bytes() != old
        assert open_files() == before
        if next(calls) <= failing:
            return failing
        if replaced:  # what failed was to remove the old store, or what was no part of the work
            for left in folder.glob(".*"):
                shutil.rmtree(left)
        assert ((path / "scene.json").read_bytes() == old) != replaced
        assert [p.name for p in folder.iterdir()] == ["a.bfrt"]
        if replaced:
            open_store(path).verify()
            make(path, order="given", **how)
            old = (path / "scene.json").read_bytes()
    raise AssertionError


@pytest.mark.parametrize(("owner", "name", "number"), CALLS)
def test_a_refusal_at_any_call_leaves_nothing(tmp_path, monkeypatch, owner, name, number):
    calls = broken_at(
        monkeypatch, tmp_path, owner, name, lambda: OSError(number, os.strerror(number))
    )
    assert calls > 4


@pytest.mark.parametrize(("owner", "name", "number"), [c for c in CALLS if c[1] != "rmtree"])
def test_an_interrupt_at_any_call_leaves_nothing(tmp_path, monkeypatch, owner, name, number):
    assert broken_at(monkeypatch, tmp_path, owner, name, KeyboardInterrupt) > 4


def test_an_interrupt_between_windows_leaves_nothing(tmp_path, monkeypatch):
    real, calls = FileWriter.write, itertools.count()

    def interrupted(self, data, **how):
        if self.path.name == "nodes" and next(calls) == 2:
            raise KeyboardInterrupt
        real(self, data, **how)

    monkeypatch.setattr(FileWriter, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make(tmp_path / "a.bfrt")
    assert not list(tmp_path.iterdir())


# --- what is damaged -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", NEW_FILES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_byte_is_found(path, kind, name, capsys):
    file = path / "0" / kind / name
    data = bytearray(file.read_bytes())
    for at in (0, len(data) // 2, len(data) - 1):
        data[at] ^= 1
        file.write_bytes(data)
        with pytest.raises(StoreError, match=f"^{file}: the contents differ"):
            open_store(path).verify()
        assert main(["verify", str(path)]) != 0
        assert f"{file}: the contents differ" in capsys.readouterr().err
        data[at] ^= 1


@pytest.mark.parametrize("name", NEW_FILES)
@pytest.mark.parametrize("change", [-1, 1, None])
def test_a_file_of_another_size_is_refused(path, name, change):
    file = path / "0" / "sphere" / name
    size = file.stat().st_size
    if change is None:
        file.unlink()
    else:
        os.truncate(file, size + change)
    found = "the file is missing" if change is None else f"found {size + change} bytes"
    with pytest.raises(StoreError, match=f"^{file}: {found}"):
        open_store(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("id_bytes", 5, "expected 0, 4 or 8"),
        ("id_bytes", 0, "expected a node or more for each treelet, where there are ids"),
        ("id_bytes", 8, "the header contradicts its own counts"),
        ("id_bytes", None, "id_bytes: found None"),
        ("treelets", 10**6, "expected a node or more for each treelet"),
        ("treelets", 1, "the header contradicts its own counts"),
        ("treelets", -1, "treelets: found -1"),
        ("nodes", 10**6, "the header contradicts its own counts"),
        ("nodes", 1.5, "nodes: found 1.5"),
    ],
)
def test_a_header_that_is_wrong_about_treelets(path, key, value, message):
    header = json.loads((path / "scene.json").read_text())
    header["groups"][0]["streams"][0][key] = value
    (path / "scene.json").write_text(header_text(header))
    with pytest.raises(StoreError, match=message):
        open_store(path)


def test_digests_differ_by_order_and_not_by_hierarchy(tmp_path, whole):
    flat = make(tmp_path / "a.bfrt", hierarchy=bfrt.Hierarchy(n=4, s=2.0))
    given_store = make(tmp_path / "b.bfrt", order="given")
    assert flat.checksum == open_store(whole).checksum != given_store.checksum


# --- the files, as docs/store.rst describes them -------------------------------------------------


def number(data, at, kind):
    return np.frombuffer(data, kind, 1, at)[0]


def below(nodes, treelet_node, node, covered, objects):
    """Follow a node as the page says: yield each leaf's objects with its box."""
    at = 80 * (treelet_node + node)
    low = np.frombuffer(nodes, "<f4", 3, at).astype(np.float64)
    step = 2.0 ** np.frombuffer(nodes, "i1", 3, at + 12).astype(np.float64)
    inner, child = nodes[at + 15], int(number(nodes, at + 16, "<u4"))
    first = int(number(nodes, at + 20, "<u4"))
    counts = np.frombuffer(nodes, "u1", 8, at + 24)
    lower = np.frombuffer(nodes, "u1", 24, at + 32).reshape(3, 8).T * step + low
    upper = np.frombuffer(nodes, "u1", 24, at + 56).reshape(3, 8).T * step + low
    covered.append(node)
    for k in range(8):
        assert (counts[k] == 255) == bool(inner >> k & 1)
        if counts[k] == 255:
            yield from (
                (object, np.maximum(lo, lower[k]), np.minimum(hi, upper[k]))
                for object, lo, hi in below(nodes, treelet_node, child, covered, objects)
            )
            child += 1
        elif counts[k]:
            assert counts[k] <= 4
            for object in range(first, first + counts[k]):
                yield objects + object, lower[k], upper[k]
            first += int(counts[k])


@pytest.mark.parametrize("kind", KINDS)
def test_the_files_are_as_the_page_says(whole, tmp_path, kind):
    header = json.loads((whole / "scene.json").read_text())
    (stream,) = (s for s in header["groups"][0]["streams"] if KINDS[s["kind"]] == kind)
    folder = whole / "0" / kind
    treelets, nodes = ((folder / name).read_bytes() for name in ("treelets", "nodes"))
    assert (len(treelets), len(nodes)) == (48 * stream["treelets"], 80 * stream["nodes"])
    ids = np.fromfile(folder / "ids", {4: "<u4", 8: "<u8"}[stream["id_bytes"]])
    geometry = np.fromfile(folder / "geometry", np.uint8).reshape(stream["count"], -1)
    as_given = make(tmp_path / "g.bfrt", order="given").path / "0" / kind
    expected = np.fromfile(as_given / "geometry", np.uint8).reshape(stream["count"], -1)
    np.testing.assert_array_equal(geometry, expected[ids])
    begin = stream["kind"] * stream["count"]
    boxes = boxes_of(open_store(as_given.parents[1]))[begin : begin + stream["count"]][ids]
    end = last_node = 0
    for at in range(0, len(treelets), 48):
        lo, hi = np.frombuffer(treelets, "<f4", 6, at).reshape(2, 3)
        first, node = (int(number(treelets, at + k, "<u8")) for k in (24, 32))
        count, nodes_of_it = (int(number(treelets, at + k, "<u4")) for k in (40, 44))
        assert (first, node) == (end, last_node)
        covered = []
        found = list(below(nodes, node, 0, covered, first))
        assert sorted(covered) == list(range(nodes_of_it))
        assert sorted(object for object, _, _ in found) == list(range(first, first + count))
        for object, lower, upper in found:
            assert (lower <= boxes[object, :3]).all() and (boxes[object, 3:] <= upper).all()
        np.testing.assert_array_equal(lo, boxes[first : first + count, :3].min(0))
        np.testing.assert_array_equal(hi, boxes[first : first + count, 3:].max(0))
        end, last_node = first + count, node + nodes_of_it
    assert (end, last_node) == (stream["count"], stream["nodes"])
