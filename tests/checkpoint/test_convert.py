"""Conversions that are broken off after any state, and go on: the same bytes, nothing is left."""

from __future__ import annotations

import errno
import json
import os
import shutil
import zlib
from pathlib import Path

import numpy as np
import pytest
from checkpoints import Killed
from kills import contents

import bfrt
from bfrt.checkpoint.checkpoint import Checkpoint
from bfrt.conversion import writing as conversion
from bfrt.conversion.kept_files import has_column, remove_others
from bfrt.errors import CheckpointError, SceneError, SettingError, StreamError
from bfrt.store.atomic_folder import AtomicFolder
from bfrt.store.ordering.files import OrderedFiles
from bfrt.store.ordering.regions import Regions

FOLDER = "bfrt-conversion.part"

NFF = """v
from 0 -9 1
at 0 0 0
up 0 0 1
angle 40
hither 1
resolution 40 30
b 0.1 0.2 0.3
l 5 5 9
l 5 -5 9 0.5 0.5 1
f 1 0.5 0.1 0.9 0.1 5 0 0
s 0 0 0 1
c
0 0 0 0.5
0 0 2 0.5
f 0.2 0.5 0.1 0.5 0.5 9 0 0
s 2 0 0 1
p 5
1 0 0
2 0 0
2.5 1 0
2 2 0
1 2 0
"""


#: So many materials that indices become wider while objects are brought into order.
RICH = "".join(
    f"f 0.{k:03d} 0.5 0.1 0.9 0.1 5 0 0\ns {k * 37 % 100} {k * 61 % 100} {k * 7 % 100} 1\n"
    for k in range(700)
)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Every way to come by objects, materials and a view."""
    folder = tmp_path_factory.mktemp("sources")
    rng = np.random.default_rng(8)
    (folder / "a.nff").write_text(NFF)
    near = rng.uniform(0, 9, (4000, 3)).astype(np.float32)
    np.save(folder / "b.npy", near[np.lexsort(near.T)])
    square = "v 0 0 5\nv 1 0 5\nv 1 1 5\nv 0 1 5\nv 3 3 3\n"
    colors = "".join(f"newmtl m{k}\nKd 0.{k} 0.5 0.1\n" for k in range(4))
    (folder / "c.mtl").write_text(colors)
    faces = "".join(f"usemtl m{k}\nf 1 2 3 4\nf 1 2 5\n" for k in range(4))
    (folder / "c.obj").write_text(f"mtllib c.mtl\n{square}{faces}")
    np.save(folder / "d.npy", rng.normal(size=(3000, 3)))
    return [str(folder / name) for name in ("a.nff", "b.npy", "c.obj", "d.npy")]


def converted(sources, target, **settings):
    return bfrt.convert(sources, target, **{"radius": 0.25, **settings})


class States:
    """Kills a run after the state of a number, and counts them."""

    def __init__(self, monkeypatch):
        self.at, self.count = 0, 0
        save = Checkpoint.save

        def killing(checkpoint, write):
            save(checkpoint, write)
            self.count += 1
            if self.count == self.at:
                raise Killed

        monkeypatch.setattr(Checkpoint, "save", killing)

    def kill_at(self, at):
        self.at, self.count = at, 0


@pytest.fixture
def states(monkeypatch):
    return States(monkeypatch)


@pytest.mark.parametrize("order", ["given", "spatial"])
@pytest.mark.parametrize("first", ["a file", "a standard scene"])
def test_a_kill_after_any_state(sources, tmp_path, states, order, first):
    sources = sources if first == "a file" else ["spd:gears:1", *sources[1:]]
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt", order=order).path)
    kept, target, count = tmp_path / "kept", tmp_path / "x.bfrt", 0
    while True:
        count += 1
        states.kill_at(count)
        try:
            made = converted(sources, target, order=order, checkpoint=kept, every=0)
        except Killed:
            assert sorted(path.name for path in kept.iterdir())[0] == FOLDER
            states.kill_at(0)
            made = converted(sources, target, order=order, checkpoint=kept, every=0)
            assert contents(made.path) == expected and not kept.exists()
            shutil.rmtree(target)
            continue
        assert contents(made.path) == expected
        break
    assert count > len(sources) + 4
    assert {path.name for path in tmp_path.iterdir()} == {"plain", "x.bfrt"}


def test_a_kill_after_every_state(sources, tmp_path, states):
    """Each run gets one state further than the one before."""
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt").path)
    runs = 0
    while True:
        states.kill_at(1)
        runs += 1
        try:
            made = converted(sources, tmp_path / "x.bfrt", checkpoint=tmp_path / "kept", every=0)
        except Killed:
            continue
        break
    assert contents(made.path) == expected
    assert runs > len(sources) + 4


@pytest.mark.parametrize("local", [False, True])
@pytest.mark.parametrize("window", [60, 1000])
def test_a_kill_after_every_window(sources, tmp_path, states, monkeypatch, window, local):
    """Each run brings one more window into order; those before are read back for the levels."""
    monkeypatch.setattr("bfrt.store.ordering.order.WINDOW", window)
    if local:
        monkeypatch.setattr("bfrt.store.locality.threshold", lambda windows: 1e9)
    (tmp_path / "rich.nff").write_text(RICH)
    sources = [str(tmp_path / "rich.nff"), sources[2], sources[0]]
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt", radius=None).path)
    runs = 0
    while True:
        states.kill_at(1)
        runs += 1
        try:
            made = converted(
                sources, tmp_path / "x.bfrt", radius=None, checkpoint=tmp_path / "kept", every=0
            )
        except Killed:
            continue
        break
    assert contents(made.path) == expected and not (tmp_path / "kept").exists()
    assert runs > (20 if window == 60 else 6)


def test_windows_in_order_are_not_made_again(tmp_path, states, monkeypatch):
    """Nor are their objects parted again."""
    monkeypatch.setattr("bfrt.store.ordering.order.WINDOW", 60)
    monkeypatch.setattr("bfrt.store.locality.threshold", lambda windows: 0.0)
    (tmp_path / "rich.nff").write_text(RICH)
    sources, numbers = [str(tmp_path / "rich.nff")], []
    append = OrderedFiles.append

    def counting(files, window):
        append(files, window)
        numbers.append(window.objects.number)

    monkeypatch.setattr(OrderedFiles, "append", counting)
    regions, put = [], Regions.append

    def putting(given, region, some):
        put(given, region, some)
        regions.append(some.number)

    monkeypatch.setattr(Regions, "append", putting)
    target, kept = broken_off(sources, tmp_path, states, at=9, radius=None)
    done = sum(numbers)
    assert 60 < done < 640
    assert sum(regions) == 700
    regions.clear()
    converted(sources, target, radius=None, checkpoint=kept)
    assert sum(numbers) == 700
    assert sum(regions) == 700 - done


def test_what_the_system_refuses_to_tell_of_is_an_error_of_ours(tmp_path, monkeypatch):
    def refuse(path):
        raise OSError(errno.EIO, "no", str(path))

    (tmp_path / "a").write_bytes(b"a")
    facts = {"ordering": {"files": {"materials": {"width": 1, "bytes": 1, "crc32": 1}}}}
    monkeypatch.setattr(Path, "lstat", refuse)
    with pytest.raises(StreamError, match=f"^{tmp_path / 'a'}: examining"):
        remove_others(tmp_path, {tmp_path / "a"}, {tmp_path})
    monkeypatch.setattr(Path, "stat", lambda path, **_: refuse(path))
    with pytest.raises(StreamError, match=f"^{tmp_path}.*: examining"):
        has_column(tmp_path / "sphere", facts)


def read_by(monkeypatch):
    """Note the names of the files that conversions read."""
    names = []
    read = conversion.read_file

    def noting(file, *rest):
        names.append(Path(file.name).name)
        return read(file, *rest)

    monkeypatch.setattr(conversion, "read_file", noting)
    return names


def broken_off(sources, tmp_path, states, at=2, **settings):
    """Break a conversion off after a state; return its target and its checkpoint."""
    states.kill_at(at)
    target, kept = tmp_path / "x.bfrt", tmp_path / "kept"
    with pytest.raises(Killed):
        converted(sources, target, checkpoint=kept, every=0, **settings)
    states.kill_at(0)
    return target, kept


def test_complete_files_are_not_read_again(sources, tmp_path, states, monkeypatch):
    target, kept = broken_off(sources, tmp_path, states)
    names = read_by(monkeypatch)
    converted(sources, target, checkpoint=kept)
    assert names == ["c.obj", "d.npy"]


def test_what_colors_say_is_kept(tmp_path, states):
    """Of files whose ranges are not the same, each has its own."""
    sources = []
    for number in range(3):
        rows = "".join(f"{k},{number},0,{k + number}\n" for k in range(9))
        sources.append(tmp_path / f"{number}.csv")
        sources[-1].write_text(f"x,y,z,heat\n{rows}")
    asked = {"color_by": "heat", "color_range": ("10%", "100%")}
    expected = converted(sources, tmp_path / "plain" / "x.bfrt", **asked)
    assert [(scale.lo, scale.hi) for scale in expected.colors] == [(0, 8), (1, 9), (2, 10)]
    target, kept = broken_off(sources, tmp_path, states, **asked)
    made = converted(sources, target, checkpoint=kept, **asked)
    assert made.colors == expected.colors
    assert contents(made.path) == contents(expected.path)


def test_an_error_in_a_file_keeps_those_before(sources, tmp_path, monkeypatch):
    """The file may be mended, for it was not complete."""
    bad = tmp_path / "bad.nff"
    bad.write_text("s 0 0 0 nan\n")
    sources, kept = [*sources[:2], str(bad)], tmp_path / "kept"
    with pytest.raises(SceneError, match=r"bad\.nff"):
        converted(sources, tmp_path / "x.bfrt", checkpoint=kept, every=0)
    bad.write_text("s 0 0 0 1\n")
    names = read_by(monkeypatch)
    made = converted(sources, tmp_path / "x.bfrt", checkpoint=kept)
    assert names == ["bad.nff"]
    assert contents(made.path) == contents(converted(sources, tmp_path / "p" / "x.bfrt").path)


def test_an_error_in_the_first_file_leaves_nothing(sources, tmp_path):
    bad = tmp_path / "bad.nff"
    bad.write_text("s 0 0 0 nan\n")
    with pytest.raises(SceneError):
        converted([str(bad), *sources], tmp_path / "x.bfrt", checkpoint=tmp_path / "kept")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.nff"]


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("moment", ["before its name", "after its name", "after what it replaces"])
def test_a_kill_while_the_store_gets_its_name(sources, tmp_path, monkeypatch, moment, before):
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt").path)
    target, kept = tmp_path / "x.bfrt", tmp_path / "kept"
    if before:
        bfrt.convert("spd:balls:1", target)

    def killed(*_):
        raise Killed

    with monkeypatch.context() as patch:
        if moment == "before its name":
            patch.setattr(AtomicFolder, "take_name", killed)
        elif moment == "after its name":
            patch.setattr("bfrt.store.atomic_folder.remove_folder", killed)
        else:
            patch.setattr(Checkpoint, "remove", killed)
        with pytest.raises(Killed):
            converted(sources, target, checkpoint=kept)
    assert kept.exists()
    names = read_by(monkeypatch)
    made = converted(sources, target, checkpoint=kept)
    assert contents(made.path) == expected and names == []
    assert {path.name for path in tmp_path.iterdir()} == {"plain", "x.bfrt"}


OTHERS = {
    "dtype": {"dtype": "float64"},
    "radius": {"radius": 0.5},
    "order": {"order": "given"},
    "hierarchy": {"hierarchy": bfrt.Hierarchy(s=4.0)},
    "skip_invalid": {"skip_invalid": True},
    "triangulate": {"triangulate": True},
    "color_by": {"color_by": "z"},
}


@pytest.mark.parametrize("name", OTHERS)
def test_other_settings_are_refused(sources, tmp_path, states, name):
    target, kept = broken_off(sources, tmp_path, states)
    held = contents(kept)
    with pytest.raises(SettingError, match=f"found the state of work with {name} .*, expected"):
        converted(sources, target, checkpoint=kept, **OTHERS[name])
    assert contents(kept) == held and not target.exists()


def test_other_sources_and_another_version_are_refused(sources, tmp_path, states, monkeypatch):
    target, kept = broken_off(sources, tmp_path, states)
    with pytest.raises(SettingError, match="found the state of work with sources "):
        converted(sources[::-1], target, checkpoint=kept)
    monkeypatch.setattr("bfrt.checkpoint.identity.VERSION", "9.9")
    with pytest.raises(SettingError, match=r'with version "0\.1\.0", expected version "9\.9"'):
        converted(sources, target, checkpoint=kept)


@pytest.fixture
def own(sources, tmp_path):
    """Copies of the sources, to be changed."""
    folder = tmp_path / "own"
    folder.mkdir()
    for name in (*sources, str(Path(sources[2]).with_suffix(".mtl"))):
        shutil.copy(name, folder)
    return [str(folder / Path(name).name) for name in sources]


@pytest.mark.parametrize("change", ["bytes", "time", "gone"])
def test_a_complete_file_that_has_changed_is_refused(own, tmp_path, states, change):
    target, kept = broken_off(own, tmp_path, states)
    path = Path(own[1])
    facts = path.stat()
    if change == "gone":
        path.unlink()
    else:
        if change == "bytes":
            path.write_bytes(path.read_bytes() + b"0")
        os.utime(path, ns=(0, facts.st_mtime_ns + (change == "time")))
    with pytest.raises(SettingError, match=rf"b\.npy: found .*, expected {facts.st_size} bytes of"):
        converted(own, target, checkpoint=kept)
    assert not target.exists() and kept.exists()


def test_a_file_that_is_not_complete_may_change(own, tmp_path, states):
    target, kept = broken_off(own, tmp_path, states)
    np.save(own[3], np.ones((5, 3)))
    made = converted(own, target, checkpoint=kept)
    assert contents(made.path) == contents(converted(own, tmp_path / "p" / "x.bfrt").path)


def test_what_was_made_after_the_state_is_made_again(sources, tmp_path, states):
    """As the run that was killed left it: more palette, half a group, an order half done."""
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt").path)
    target, kept = broken_off(sources, tmp_path, states)
    store = kept / FOLDER
    with (store / "palette").open("ab") as file:
        file.write(bytes(77))
    for place in ("2/sphere", "1/sphere.ordered", "0/sphere.ordered"):
        (store / place).mkdir(parents=True)
        (store / place / "geometry").write_bytes(b"half")
    (store / "1" / "sphere" / "level1").write_bytes(b"half")
    (store / "scene.json").write_text("{")
    (store / "link").symlink_to(tmp_path)
    made = converted(sources, target, checkpoint=kept)
    assert contents(made.path) == expected and (tmp_path / "plain").exists()


@pytest.mark.parametrize("change", ["gone", "named", "wider and named"])
def test_materials_that_have_another_file_since(tmp_path, states, monkeypatch, change):
    """After the state indices became wider, or all were there: the kill came before the next."""
    monkeypatch.setattr("bfrt.store.ordering.order.WINDOW", 60)
    (tmp_path / "rich.nff").write_text(RICH)
    sources = [str(tmp_path / "rich.nff")]
    expected = contents(converted(sources, tmp_path / "plain" / "x.bfrt", radius=None).path)
    target, kept = broken_off(sources, tmp_path, states, at=9, radius=None)
    ordered = kept / FOLDER / "0" / "sphere.ordered"
    (column,) = ordered.glob("materials.*")
    data = column.read_bytes()
    column.unlink()
    if change != "gone":
        (ordered / "materials").write_bytes(data[change == "wider and named" :] + b"more")
    made = converted(sources, target, radius=None, checkpoint=kept)
    assert contents(made.path) == expected and not kept.exists()


FORGED_ON_THE_WAY = {
    "no files": lambda ordering: ordering["files"].update(files={}),
    "a place more": lambda ordering: ordering["places"].append(3),
    "more than all": lambda ordering: ordering["files"].update(done=5000),
    "a width": lambda ordering: ordering["files"]["materials"].update(width=3),
    "a file's bytes": lambda ordering: ordering["files"]["files"]["ids"].update(bytes=9),
}


@pytest.mark.parametrize("name", FORGED_ON_THE_WAY)
def test_what_is_forged_on_the_way_into_order_is_refused(tmp_path, states, monkeypatch, name):
    monkeypatch.setattr("bfrt.store.ordering.order.WINDOW", 60)
    (tmp_path / "rich.nff").write_text(RICH)
    sources = [str(tmp_path / "rich.nff")]
    target, kept = broken_off(sources, tmp_path, states, at=9, radius=None)

    def change(facts):
        FORGED_ON_THE_WAY[name](facts["groups"][0]["streams"][0]["ordering"])

    forged(kept, change)
    with pytest.raises(CheckpointError, match=f"^{kept}"):
        converted(sources, target, radius=None, checkpoint=kept)


def test_links_in_the_store_are_not_followed(sources, tmp_path, states):
    target, kept = broken_off(sources, tmp_path, states)
    palette = kept / FOLDER / "palette"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes(palette.read_bytes() + b"mine")
    palette.unlink()
    palette.symlink_to(elsewhere)
    with pytest.raises(CheckpointError, match=f"^{palette}: found no file"):
        converted(sources, target, checkpoint=kept)
    assert elsewhere.read_bytes().endswith(b"mine")


def files_kept(kept):
    return [path for path in sorted((kept / FOLDER).rglob("*")) if path.stat().st_size]


def test_what_is_damaged_is_refused(sources, tmp_path, states):
    """Every file of the store that is made: a bit flipped, cut, gone."""
    target, kept = broken_off(sources, tmp_path, states, at=3)
    count = 0
    for path in [path for path in files_kept(kept) if path.is_file()]:
        data = path.read_bytes()
        for damaged in (data[:-1], data[:-1] + bytes([data[-1] ^ 1]), None):
            path.unlink()
            if damaged is not None:
                path.write_bytes(damaged)
            with pytest.raises(CheckpointError, match=f"^{path}: "):
                converted(sources, target, checkpoint=kept)
            path.write_bytes(data)
            count += 1
    assert count > 30
    made = converted(sources, target, checkpoint=kept)
    assert contents(made.path) == contents(converted(sources, tmp_path / "p" / "x.bfrt").path)


def forged(kept, change):
    """Change the facts of a state, and sign it anew."""
    (header,) = kept.glob("state.*/state.json")
    body = json.loads(header.read_text())
    change(body["facts"])
    del body["checksum"]
    body["checksum"] = zlib.crc32(json.dumps(body, sort_keys=True).encode())
    header.write_text(json.dumps(body))


def stream_fact(name, value):
    def change(facts):
        facts["groups"][1]["streams"][0]["header"][name] = value

    return change


FORGED = {
    "no inputs": lambda facts: facts.update(inputs=[]),
    "too many inputs": lambda facts: facts.update(inputs=facts["inputs"] * 9),
    "a file elsewhere": stream_fact("files", {"../../../own": {"bytes": 0, "crc32": 0}}),
    "a file more": stream_fact("files", {"mine": {"bytes": 4, "crc32": 0}}),
    "a kind that is none": stream_fact("kind", 99),
    "no camera": lambda facts: facts["view"].update(camera=7),
    "no palette": lambda facts: facts.pop("palette"),
    "other materials": lambda facts: facts["palette"].update(bytes=5),
    "whole": lambda facts: facts.update(whole=5),
    "ends of bounds": lambda facts: facts["groups"][1].update(bounds=[[1, 1, 1], [0, 0, 0]]),
}


@pytest.mark.parametrize("name", FORGED)
def test_what_is_forged_is_refused(sources, tmp_path, states, name):
    target, kept = broken_off(sources, tmp_path, states)
    forged(kept, FORGED[name])
    with pytest.raises(CheckpointError, match=f"^{kept}"):
        converted(sources, target, checkpoint=kept)
    assert not target.exists()


def test_what_comes_through_a_pipe_is_refused(sources, tmp_path):
    os.mkfifo(tmp_path / "pipe.nff")
    for name in ("-", str(tmp_path / "pipe.nff")):
        with pytest.raises(SettingError, match=f"^checkpoint: found {name} among the sources"):
            converted([*sources, name], tmp_path / "x.bfrt", checkpoint=tmp_path / "kept")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe.nff"]


def test_another_file_system_is_refused(sources, tmp_path):
    shared = Path("/dev/shm")
    if not shared.is_dir() or shared.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("there is no other file system")
    kept = shared / f"bfrt-{os.getpid()}-kept"
    with pytest.raises(SettingError, match=f"^{kept}: found another file system than that of"):
        converted(sources, tmp_path / "x.bfrt", checkpoint=kept)
    assert not kept.exists() and list(tmp_path.iterdir()) == []


def test_the_target_is_no_checkpoint(sources, tmp_path):
    with pytest.raises(SettingError, match="found it twice"):
        converted(sources, tmp_path / "x.bfrt", checkpoint=tmp_path / "x.bfrt")
    assert list(tmp_path.iterdir()) == []


def test_small_states_are_saved_no_oftener_than_they_may_cost(sources, tmp_path, states):
    states.kill_at(0)
    converted(sources, tmp_path / "x.bfrt", checkpoint=tmp_path / "kept", every=3600)
    assert states.count == 2  # before given files go, and before the name
