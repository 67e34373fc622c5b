"""Several views on the command line."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

import bfrt
from bfrt.cli import main
from bfrt.conversion.view_list import read_views
from bfrt.errors import SceneError

SMALL = ["--resolution", "24", "16", "--memory", "160MiB", "--quiet"]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    rng = np.random.default_rng(4)
    with bfrt.SceneWriter(tmp_path_factory.mktemp("views") / "cloud.bfrt") as writer:
        writer.camera(bfrt.Camera((6, -5, 4), (0, 0, 0), resolution=(30, 20)))
        writer.spheres(rng.uniform(-2, 2, (200, 3)), 0.3)
    return bfrt.open(writer.path)


@pytest.fixture
def run(scene, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        status = main(["render", str(scene.path), *SMALL, *map(str, arguments)])
        return status, capsys.readouterr().err

    return run


def test_a_turntable_writes_numbered_files(run, scene, tmp_path):
    assert run("--turntable", 4, "-o", "a-{:02d}.png", "-o", "b%d.exr", "--stats", "s.json") == (
        0, "",
    )  # fmt: skip
    names = [f"a-{n:02d}.png" for n in range(4)] + [f"b{n}.exr" for n in range(4)]
    assert sorted(path.name for path in tmp_path.iterdir()) == [*names, "s.json"]
    camera = replace(scene.camera, resolution=(24, 16))
    for number, view in enumerate(scene.turntable(4, camera)):
        image = scene.render(camera=view, memory="160MiB")
        for name in (f"a-{number:02d}.png", f"b{number}.exr"):
            image.save(tmp_path / f"alone{name[-4:]}")
            assert (tmp_path / name).read_bytes() == (tmp_path / f"alone{name[-4:]}").read_bytes()
    rays = json.loads((tmp_path / "s.json").read_text())["rays"]
    assert rays["eye"] == 4 * 25 * 17


def test_a_turn_begins_at_the_view_that_is_asked_for(run, scene, tmp_path):
    asked = ["--from", 0, 7, 1, "--angle", 50]
    assert run(*asked, "--turntable", 2, "-o", "a{}.png")[0] == 0
    assert run(*asked, "-o", "b.png")[0] == 0
    assert (tmp_path / "a0.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a1.png").read_bytes() != (tmp_path / "b.png").read_bytes()


def test_a_sheet_and_an_animation_alone(run, tmp_path):
    assert run("--turntable", 3, "--contact-sheet", "s.png", "--animation", "a.png") == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "s.png"]


def test_views_of_a_file(run, scene, tmp_path):
    (tmp_path / "views.txt").write_text(
        "6 -5 4  0 0 0  0 0 1  45 # as the scene's\n1,9,1,0,0,0,0,0,1,30\n"
    )
    (tmp_path / "one.nff").write_text(
        "v\nfrom 6 -5 4\nat 0 0 0\nup 0 0 1\nangle 45\nhither 1\nresolution 9 9\n"
        "v\nat 0 0 0\nfrom 1 9 1\nup 0 0 1\nangle 30\nresolution 9 9\n"
    )
    for name, file in (("a", "views.txt"), ("b", "one.nff")):
        assert run("--views", file, "-o", f"{name}{{}}.png") == (0, "")
    assert run("-o", "alone.png") == (0, "")
    for number in range(2):
        same = (tmp_path / f"a{number}.png").read_bytes()
        assert same == (tmp_path / f"b{number}.png").read_bytes()
    assert (tmp_path / "a0.png").read_bytes() == (tmp_path / "alone.png").read_bytes()
    assert [view.resolution for view in read_views(tmp_path / "one.nff", (3, 4))] == [(9, 9)] * 2
    assert [view.resolution for view in read_views(tmp_path / "views.txt", (3, 4))] == [(3, 4)] * 2


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "found no view, expected 10 numbers (from, at, up, angle), or v and its fields"),
        ("# none\n\n1 2 3\n", ":3: found 3 numbers, expected 10 numbers"),
        ("1 2 3 4 5 6 7 8 9 x\n", ":1: found '1 2 3 4 5 6 7 8 9 x', expected 10 numbers"),
        ("from 1 2 3\n", ":1: found 'from 1 2 3', expected 10 numbers"),
        ("v\nfrom 1 2 3\nat 0 0 0\nangle 4\n", ":1: found a v without up, expected from, at, up"),
        ("v\nfrom 1 2\n", ":2: from: found 2 numbers, expected 3 numbers once"),
        ("v\nup 0 0 1\nup 0 0 1\n", ":3: up: found it twice, expected 3 numbers once"),
        ("0 0 0 0 0 0 0 0 1 45\n", ":1: camera: from (0.0, 0.0, 0.0) at (0.0, 0.0, 0.0)"),
        ("0 0 0 0 1 0 0 0 1 nan\n", ":1: camera: found angle nan, expected"),
        (
            "v\nfrom 1 2 3\nat 0 0 0\nup 0 0 1\nangle 4\nresolution 2.5 1e9\n",
            ":1: camera: found resolution (2.5, 1000000000.0), expected 1 to 65535",
        ),
    ],
)  # fmt: skip
def test_files_of_no_views(tmp_path, text, fault):
    path = tmp_path / "views.txt"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        read_views(path, (8, 8))
    assert str(caught.value).startswith(str(path)) and fault in str(caught.value)


@pytest.mark.parametrize("what", ["nothing", "a folder", "much"])
def test_what_is_no_file_of_views(tmp_path, what):
    path = tmp_path / "views"
    if what == "a folder":
        path.mkdir()
    elif what == "much":
        with path.open("wb") as file:
            file.truncate((1 << 24) + 1)
    with pytest.raises(SceneError, match=r"views: found no(ne| file) of views, expected a file of"):
        read_views(path, (8, 8))


@pytest.mark.parametrize(
    ("arguments", "status", "fault"),
    [
        (["--turntable", "3", "-o", "a.png"], 2, "a.png: found 0 places for a view's number"),
        (["--turntable", "3"], 2, "render: nothing to write"),
        (["--turntable", "0", "-o", "a{}.png"], 2, "count: found 0, expected a whole number"),
        (["--contact-sheet", "a.png", "-o", "b.png"], 2, "--contact-sheet: found one view"),
        (["--animation", "a.png", "-o", "b.png"], 2, "--animation: found one view"),
        (["--turntable", "3", "--contact-sheet", "a.exr"], 2, "of a contact sheet, expected .png"),
        (["--turntable", "3", "--animation", "a.mp4"], 2, "expected .gif or .png"),
        (["--turntable", "3", "-o", "a{}.png", "-o", "a%d.png"], 2, "found it twice"),
        (["--views", "v", "--up", "0", "0", "1", "-o", "a{}.png"], 2, "--up: found it with"),
        (["--views", "v", "--from", "0", "0", "1", "-o", "a{}.png"], 2, "--from: found it with"),
        (["--views", "missing", "-o", "a{}.png"], 1, "missing: found no file of views"),
        (["--turntable", "2", "--resolution", "0", "1", "-o", "a{}.png"], 2, "found resolution"),
        (["--views", "two", "--resolution", "0", "1", "-o", "a{}.png"], 2, "found resolution"),
    ],
)  # fmt: skip
def test_wrong_use(run, tmp_path, arguments, status, fault):
    (tmp_path / "two").write_text("6 -5 4  0 0 0  0 0 1  45\n" * 2)
    found, error = run(*arguments)
    assert (found, fault in error, error.count("\n")) == (status, True, 1), error
    assert [path.name for path in tmp_path.iterdir()] == ["two"]


def test_views_of_two_sizes(run, tmp_path, scene, capsys):
    block = "v\nfrom 6 -5 4\nat 0 0 0\nup 0 0 1\nangle 45\nresolution {0} {0}\n"
    (tmp_path / "two.nff").write_text(block.format(9) + block.format(8))
    command = ["render", str(scene.path), "--views", "two.nff", "-o", "a{}.png", "--quiet"]
    assert main(command) == 2
    said = "two.nff: found views of (9, 9) and of (8, 8) pixels, expected one resolution for all"
    assert said in capsys.readouterr().err
    assert run("--views", "two.nff", "-o", "a{}.png") == (0, "")


def test_a_gif_without_pillow_is_refused_before_the_work(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    status, error = run("--turntable", 3, "--animation", "a.gif")
    assert status == 2 and "a GIF needs Pillow: pip install bfrt[animation]" in error
    assert list(tmp_path.iterdir()) == []


def test_a_plan_of_a_turn(scene, capsys):
    command = ["render", str(scene.path), "--turntable", "36", "--plan", "--memory", "160MiB"]
    assert main(command) == 0
    assert "36 x 30 x 20" in capsys.readouterr().out


def test_a_file_is_converted_for_a_turn(tmp_path, capsys):
    (tmp_path / "a.nff").write_text("s 0 0 0 1\ns 1 1 1 0.5\n")
    asked = ["--turntable", "3", "--contact-sheet", str(tmp_path / "s.png")]
    assert main(["render", str(tmp_path / "a.nff"), *asked, *SMALL]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nff", "s.png"]


def test_a_turn_with_a_checkpoint_leaves_none(run, tmp_path):
    assert run("--turntable", 3, "-o", "a{}.png", "--checkpoint", "kept", "--every", 0) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a0.png", "a1.png", "a2.png"]
