"""The command line: what it says, what it leaves, how it ends."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np
import pytest

import bfrt
from bfrt.cli import main

AWAY = tempfile.gettempdir()

NFF = """b 0.1 0.2 0.3
v
from 0 -5 0
at 0 0 0
up 0 0 1
angle 45
hither 1
resolution 24 16
l 3 -4 5
f 1 0.5 0.25 0.7 0.3 20 0 0
s 0 0 0 1
c 1 0 0 0.2 2 0 1 0.1
p 4
-3 -3 -2
3 -3 -2
3 3 -2
-3 3 -2
"""


@pytest.fixture
def nff(tmp_path):
    path = tmp_path / "scene.nff"
    path.write_text(NFF)
    return path


def run(*arguments, cwd=AWAY, **options):
    """The command as a process, away from the source tree, which has no compiled modules."""
    return subprocess.run(
        [sys.executable, "-m", "bfrt", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        **options,
    )


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_convert_then_render_is_render_in_one_go(nff, tmp_path):
    assert main(["convert", str(nff), "-o", str(tmp_path / "a.bfrt")]) == 0
    outputs = ["-o", str(tmp_path / "a.npy"), "-o", str(tmp_path / "a.png"), "-o"]
    stats = ["--stats", str(tmp_path / "a.json"), "--memory", "256MiB", "--threads", "2"]
    a = ["render", str(tmp_path / "a.bfrt"), *outputs, str(tmp_path / "a.exr"), *stats]
    assert main(a) == 0
    assert main(["render", str(nff), "-o", str(tmp_path / "b.npy"), "--memory", "99MiB"]) == 0
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()
    assert json.loads((tmp_path / "a.json").read_text())["objects"] == 3
    assert names(tmp_path) == [
        "a.bfrt", "a.exr", "a.json", "a.npy", "a.png", "b.npy", "scene.nff",
    ]  # fmt: skip


def test_standard_input_is_read(nff, tmp_path):
    done = run("convert", "-", "-o", tmp_path / "a.bfrt", input=NFF)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert bfrt.open(tmp_path / "a.bfrt").objects == 3


def test_the_view_can_be_another(nff, tmp_path):
    view = tmp_path / "view.nff"
    view.write_text("v\nfrom 5 0 0\nat 0 0 0\nup 0 0 1\nangle 30\nresolution 8 8\n")
    store = str(tmp_path / "a.bfrt")
    main(["convert", str(nff), "-o", store])
    for name, arguments in {
        "view": ["--view", str(view)],
        "options": ["--from", "5", "0", "0", "--angle", "30", "--resolution", "8", "8"],
        "scene": ["--resolution", "8", "8"],
    }.items():
        out = str(tmp_path / f"{name}.npy")
        assert main(["render", store, "-o", out, "--memory", "128MiB", *arguments]) == 0
    view, options, scene = (
        np.load(tmp_path / f"{name}.npy") for name in ("view", "options", "scene")
    )
    assert (view == options).all()
    assert (view != scene).any()


@pytest.mark.parametrize("size", [["12x8"], ["12X8"], ["12", "8"]])
@pytest.mark.parametrize("option", ["--resolution", "--res"])
def test_a_resolution_is_one_word_or_two(nff, tmp_path, option, size):
    out = tmp_path / "a.npy"
    asked = ["render", option, *size, str(nff), "-o", str(out), "--memory", "128MiB"]
    assert main(asked) == 0
    assert np.load(out).shape == (8, 12, 4)
    if len(size) == 1:
        asked[1:3] = [f"{option}={size[0]}"]
        assert main([*asked[:-3], str(tmp_path / "b.npy"), *asked[-2:]]) == 0
        assert (tmp_path / "b.npy").read_bytes() == out.read_bytes()


def test_the_light_can_be_another(nff, tmp_path, capsys):
    scene = bfrt.convert(nff, tmp_path / "a.bfrt")
    options = ["--sun", "-45", "30.5", "--ambient", "0.25", "--ao", "3", "--ao-distance", "1e1"]
    options += ["--background", "0.5", "0", "1", "--memory", "128MiB", "--stats", "a.json"]
    done = run("render", "a.bfrt", "-o", "a.npy", *options, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    expected = scene.render(
        lights=[bfrt.Sun(-45, 30.5)], ambient=0.25, ao=3, ao_distance=10, background=(0.5, 0, 1),
        memory="128MiB",
    )  # fmt: skip
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), expected.rgba)
    told = json.loads((tmp_path / "a.json").read_text())
    assert told["rays"]["shadow"] == expected.stats.total.rays.shadow > 0
    assert main(["render", str(scene.path), "--plan", *options[:-2]]) == 0
    assert str(scene.plan(ao=3, lights=[bfrt.Sun(0, 9)], memory="128MiB"))[:200]
    capsys.readouterr()


@pytest.mark.parametrize("number", ["-1e1", "-10.", "-1.E+01", "-.1e2", "-10"])
def test_a_negative_number_is_no_option(nff, tmp_path, number):
    out = tmp_path / "a.npy"
    view = ["--from", "0", "0", number, "--at", "0", "0", "0", "--up", "0", "1", "0"]
    asked = ["render", str(nff), "-o", str(out), "--memory", "128MiB", *view]
    assert main(asked) == 0
    asked[3], asked[asked.index(number)] = str(tmp_path / "b.npy"), "-10.0"
    assert main(asked) == 0
    assert (tmp_path / "b.npy").read_bytes() == out.read_bytes()


@pytest.mark.parametrize("size", [["12x"], ["x8"], ["12x8x3"], ["12"], ["12x8", "3"], ["a", "b"]])
def test_a_resolution_that_is_none(nff, size):
    done = run("render", nff, "-o", nff.parent / "x.png", "--resolution", *size)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert names(nff.parent) == ["scene.nff"]


def test_a_name_like_a_resolution_is_a_name(nff, tmp_path):
    """Only what follows the option is taken apart."""
    file = tmp_path / "12x8"
    assert main(["spd", "tetra", "2", "--nff", str(file)]) == 0
    assert run("spd", "tetra", "2", "--nff", "12x8", cwd=tmp_path).returncode == 0
    assert names(tmp_path) == ["12x8", "scene.nff"]


def test_spd_makes_stores_and_text(tmp_path):
    store, text = tmp_path / "r.bfrt", tmp_path / "r.nff"
    assert main(["spd", "rings", "2", "-o", str(store), "--nff", str(text)]) == 0
    assert bfrt.open(store).objects == 301
    done = run("spd", "rings", "2", "--nff", "-")
    assert done.stdout == text.read_text()
    again = bfrt.convert(text, tmp_path / "again.bfrt")
    assert again.geometries == bfrt.open(store).geometries


@pytest.mark.parametrize(("name", "size"), [("tetra", 3), ("gears", 2), ("balls", 2)])
def test_spd_says_what_it_has_written(tmp_path, name, size, capsys):
    """The bytes are those that ``bfrt info`` and ``bfrt verify`` tell, and those of the files."""
    store = str(tmp_path / "a.bfrt")
    said = run("spd", name, size, "-o", store).stderr
    assert main(["info", "--json", store]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert said == f"{store}: {facts['objects']:,} objects, {facts['bytes']:,} bytes\n"
    files = [path for path in (tmp_path / "a.bfrt").rglob("*") if path.is_file()]
    made = (tmp_path / "a.bfrt" / "made.json").stat().st_size
    assert facts["bytes"] == sum(path.stat().st_size for path in files) - made
    assert main(["verify", store]) == 0
    assert capsys.readouterr().out == f"{said[:-1]}, all as written\n"


def test_spd_is_quiet(tmp_path):
    assert run("spd", "tetra", 3, "-o", tmp_path / "a.bfrt", "--quiet").stderr == ""


def test_spd_has_the_scenes_options(tmp_path, capsys):
    assert main(["spd", "mount", "2", "--hash", "jenkins", "--nff", str(tmp_path / "a.nff")]) == 0
    text = (tmp_path / "a.nff").read_text()
    file = io.StringIO()
    bfrt.spd.mount(2, "jenkins").write_nff(file)
    assert text == file.getvalue()
    assert main(["spd", "rings", "2", "--hash", "jenkins", "--nff", "-"]) == 2
    assert "found option hash for rings, which has none" in capsys.readouterr().err
    path = str(tmp_path / "t.bfrt")
    assert main(["spd", "tree", "3", "-o", path, "--hierarchy", "s=2", "--threads", "1"]) == 0
    assert bfrt.open(path).store.hierarchy == bfrt.Hierarchy(s=2.0, t=0.5)  # t is the scene's own
    assert main(["spd", "tree", "3", "-o", path, "--hierarchy", "s=0"]) == 2
    assert main(["convert", "spd:tree:3", "-o", path, "--hierarchy", "n=7"]) == 0
    assert bfrt.open(path).store.hierarchy.n == 7


def test_refinements_and_named_views(tmp_path):
    path = str(tmp_path / "r.bfrt")
    assert main(["spd", "rings", "2", "-o", path, "--quiet"]) == 0
    made = {}
    for refine in ("base", "sg", "sgb"):
        out, stats = tmp_path / f"{refine}.npy", tmp_path / f"{refine}.json"
        arguments = [
            "render",
            path,
            "-o",
            str(out),
            "--resolution",
            "32",
            "32",
            "--stats",
            str(stats),
        ]
        arguments += ["--view", "rings368m", "--angle", "40", "--refine", refine]
        assert main(arguments) == 0
        made[refine] = out.read_bytes()
        assert json.loads(stats.read_text())["settings"]["refine"] == refine
    assert made["base"] == made["sg"] == made["sgb"]


def test_info_and_verify(nff, tmp_path, capsys):
    store = tmp_path / "a.bfrt"
    main(["convert", str(nff), "-o", str(store)])
    assert main(["info", str(store)]) == 0
    assert "objects: 3" in capsys.readouterr().out
    assert main(["info", "--json", str(store)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert {s["kind"]: s["objects"] for s in facts["streams"]} == {
        "sphere": 1, "cone": 1, "polygon": 1,
    }  # fmt: skip
    assert facts["bounds"][0][:2] == [-3, -3] and facts["bounds"][1][:2] == [3, 3]
    assert main(["verify", str(store)]) == 0
    file = store / "0" / "sphere" / "geometry"
    data = bytearray(file.read_bytes())
    data[3] ^= 16
    file.write_bytes(data)
    assert main(["verify", str(store)]) == 1
    assert "geometry" in capsys.readouterr().err


def test_info_writes_letters_alone_to_a_terminal(tmp_path, capsys):
    """Whatever text a store of others has, or a sharded scene beside it."""
    with bfrt.SceneWriter(tmp_path / "a.bfrt", durable=False) as writer:
        writer.spheres([[0.0, 0, 0]], 1.0)
        writer.crs("\x1b[2Ja\nb")
    assert main(["info", str(tmp_path / "a.bfrt")]) == 0
    assert r"crs: \x1b[2Ja\nb" in capsys.readouterr().out


def test_info_shows_bounds_in_the_worlds_coordinates(tmp_path, capsys):
    """As the file has them, wherever the store's origin is."""
    file, store = tmp_path / "a.npy", tmp_path / "a.bfrt"
    np.save(file, np.array([[5e5, 4e6, 100], [5e5 + 10, 4e6 + 20, 130]]))
    assert main(["convert", str(file), "-o", str(store), "--radius", "1"]) == 0
    opened = bfrt.open(store)
    world = [[5e5 - 1, 4e6 - 1, 99], [5e5 + 11, 4e6 + 21, 131]]
    assert opened.origin != (0, 0, 0)
    np.testing.assert_array_equal(opened.bounds, world)
    np.testing.assert_array_equal(np.array(opened.store.bounds) + opened.origin, world)
    assert main(["info", "--json", str(store)]) == 0
    assert json.loads(capsys.readouterr().out)["bounds"] == world
    assert main(["info", str(store)]) == 0
    assert f"bounds: {[list(map(float, corner)) for corner in world]}\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("s 0 0 0\n", "line"),
        ("q 1 2 3\n", "line 1"),
        ("s 0 0 nan 1\n", "line 1"),
        ("\0\1\2\3", "line 1"),
        (NFF[:-30], "end of file"),
    ],
)
def test_a_bad_file_is_one_line_status_1_and_nothing_left(tmp_path, text, words):
    bad = tmp_path / "bad.nff"
    bad.write_text(text)
    for command in (["convert", bad, "-o", "x.bfrt"], ["render", bad, "-o", "x.png"]):
        done = run(*command, cwd=tmp_path)
        assert done.returncode == 1
        assert done.stderr.count("\n") == 1
        assert "bad.nff" in done.stderr
        assert words in done.stderr
        assert "expected" in done.stderr
        assert names(tmp_path) == ["bad.nff"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["render", "scene.nff", "-o", "x.gif"], 2, "expected .exr, .png, .npy"),
        (["render", "scene.nff", "-o", "x.png", "--memory", "9MiB"], 2, "expected .* or more"),
        (["render", "scene.nff", "-o", "x.png", "--memory", "9 bananas"], 2, "bananas"),
        (["render", "scene.abc", "-o", "x.png"], 2, "found suffix '.abc'"),
        (["render", "no.bfrt", "-o", "x.png"], 1, "not a scene store"),
        (["render", "spd:rongs:3", "-o", "x.png"], 2, "rongs"),
        (["render", "scene.nff"], 2, "nothing to write: expected -o FILE, or --plan"),
        (["render", "scene.nff", "--plan"], 2, "scene.nff: found no scene store to plan for"),
        (["render", "spd:rings:3", "--plan"], 2, "spd:rings:3: found no scene store"),
        (["render", "no.bfrt", "--plan"], 1, "not a scene store"),
        (["render", "scene.nff", "-o", "x.png", "--resolution", "0x5"], 2, r"resolution \(0, 5\)"),
        (["render", "scene.nff", "-o", "x.png", "--resolution", "9", "65536"], 2, "1 to 65535"),
        (["render", "scene.nff", "-o", "x.png", "--angle", "0"], 2, "expected 0 < angle < 180"),
        (["render", "scene.nff", "-o", "x.png", "--angle", "nan"], 2, "expected a finite number"),
        (["render", "scene.nff", "-o", "x.png", "--up", "0", "0", "0"], 2, "does not span a view"),
        (["render", "spd:tetra:2", "-o", "x.png", "--angle", "180"], 2, "angle 180, expected"),
        (["render", "scene.nff", "-o", "x.png", "--half"], 2, "--half: found outputs x.png, expec"),
        (["render", "scene.nff", "-o", "no/x.png"], 2, "no/x.png: found no folder .*no, expected"),
        (["render", "scene.nff", "-o", "scene.nff/x.png"], 2, "found no folder .*scene.nff"),
        (["render", "scene.nff", "-o", "x.png", "-o", "no/x.exr"], 2, "no/x.exr: found no folder"),
        (["render", "scene.nff", "-o", "x.png", "--stats", "no/x.json"], 2, "found no folder"),
        (["render", "scene.nff", "-o", "x.png", "--stats", "."], 2, "something else than a file"),
        (["render", "scene.nff", "-o", "x.png", "--stats", ""], 2, "found an empty path"),
        (["render", "scene.nff", "-o", "x.png", "--stats", "./x.png"], 2, "x.png: found it twice"),
        (["render", "scene.nff", "-o", "x.png", "-o", "x.png"], 2, "x.png: found it twice"),
        (
            ["render", "scene.nff", "-o", "x.png", "--stats", "scene.nff"],
            2,
            "scene.nff: found it tw",
        ),
        (
            ["render", "scene.nff", "-o", "x.png", "--stats", "a", "--stats", "b"],
            2,
            "expected it once",
        ),
        (["render", "scene.nff", "-o", "n" * 300 + ".png"], 2, "found too long a name"),
        (
            ["convert", "scene.nff", "-o", "x.bfrt", "-o", "y.bfrt"],
            2,
            "'x.bfrt' and 'y.bfrt', expec",
        ),
        (["convert", "spd:tetra:1", "-o", "x.bfrt", "--output=y.bfrt"], 2, "expected it once"),
        (["spd", "rings", "1", "-o", "x.bfrt", "-o", "y.bfrt"], 2, "expected it once"),
        (["spd", "rings", "1", "--nff", "x.nff", "--nff", "-"], 2, "expected it once"),
        (["spd", "rings", "1", "--nff", "x.nff", "-o", "x.nff"], 2, "x.nff: found it twice"),
        (["spd", "rings", "1", "--nff", "x.nff", "-o", "scene.nff"], 2, "is no scene store"),
        (["spd", "rings", "1", "--nff", "x.nff", "-o", "scene.nff/x"], 2, "found the file .*nff"),
        (["spd", "rings", "1", "--nff", "no/x.nff"], 2, "found no folder"),
        (["spd", "rings", "1", "--nff", "x.nff", "-o", "x.bfrt", "--hierarchy", "s=0"], 2, "s > 0"),
        (["spd", "rings", "0", "-o", "x.bfrt"], 2, "expected 1 or more"),
        (["spd", "rings", "3"], 2, "expected -o"),
        (["convert", "no.nff", "-o", "x.bfrt"], 1, "no.nff"),
        (["verify", "scene.nff"], 1, "not a scene store"),
        (
            ["render", "scene.nff", "-o", "x.png", "--sun", "0", "99"],
            2,
            "--sun: elevation of a sun",
        ),
        (["render", "scene.nff", "-o", "x.png", "--ao", "-1"], 2, "ao: found -1"),
        (["render", "scene.nff", "-o", "x.png", "--ao-distance", "2"], 2, "found 2.0 without ao"),
        (["render", "scene.nff", "-o", "x.png", "--ambient", "-1"], 2, "ambient: found -1"),
        (["render"], 2, "usage"),
    ],
)
def test_wrong_use_says_why(nff, arguments, status, words):
    done = run(*arguments, cwd=nff.parent)
    assert done.returncode == status
    assert re.search(words, done.stderr), done.stderr
    assert "Traceback" not in done.stderr
    assert names(nff.parent) == ["scene.nff"]


@pytest.mark.parametrize("radius", ["-1", "0", "-0", "nan", "inf", "-inf"])
def test_a_radius_of_points_that_nobody_could_see(tmp_path, radius):
    np.save(tmp_path / "a.npy", np.zeros((5, 3)))
    done = run("convert", "a.npy", "-o", "x.bfrt", f"--radius={radius}", cwd=tmp_path)
    assert done.returncode == 2
    expected = f"bfrt: radius: found {float(radius)}, expected a finite number above 0\n"
    assert done.stderr == expected
    for wrong in (float(radius), np.float32(radius), [1.0], True):
        with pytest.raises(bfrt.SettingError, match=r"radius: found .*, expected a finite number"):
            bfrt.convert(tmp_path / "a.npy", tmp_path / "x.bfrt", radius=wrong)
    assert names(tmp_path) == ["a.npy"]


def test_outputs_are_checked_before_the_work(tmp_path, monkeypatch, capsys):
    """What could not be written after a render is found before it, and stores stay as they are."""
    store = bfrt.spd.tetra(2).write(tmp_path / "s.bfrt").path
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(bfrt.Scene, "render", lambda *_, **__: pytest.fail("rendering"))
    (tmp_path / "link.png").symlink_to(store / "x.png")
    for inside in (store / "x.png", store / "0" / "x.png", tmp_path / "link.png"):
        assert main(["render", str(store), "-o", str(inside)]) == 2
        assert f"found it to be in the store {store}" in capsys.readouterr().err
    stats = ["--stats", str(store / "scene.json")]
    assert main(["render", str(store), "-o", str(tmp_path / "x.png"), *stats]) == 2
    assert main(["spd", "tetra", "1", "--nff", str(store / "x.nff")]) == 2
    assert main(["convert", "spd:tetra:1", "-o", str(store / "x.bfrt")]) == 2
    assert main(["spd", "tetra", "1", "-o", str(store / "0" / "x.bfrt")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == said.count(f"found it to be in the store {store}") == 4
    monkeypatch.setattr("os.access", lambda path, mode: False)
    assert main(["render", str(store), "-o", str(tmp_path / "x.png")]) == 2
    assert "expected one that we may write to" in capsys.readouterr().err
    (tmp_path / "link.png").unlink()
    assert sorted(tmp_path.rglob("*")) == before


def test_a_store_goes_to_a_new_folder(tmp_path):
    """With the folders above it, as a converted one does."""
    for made in (["spd", "tetra", "2"], ["convert", "spd:tetra:2"]):
        path = tmp_path / made[0] / "a" / "s.bfrt"
        assert main([*made, "-o", str(path)]) == 0
        assert bfrt.open(path).objects == 16


def test_a_plan_is_printed_and_nothing_written(nff, tmp_path, capsys):
    store = tmp_path / "scene.bfrt"
    bfrt.convert(nff, store)
    before = sorted(path for path in tmp_path.rglob("*"))
    asked = ["render", str(store), "--plan", "--memory", "128MiB", "--threads", "2"]
    shape = ["--resolution", "40", "30", "--samples", "2", "--depth", "3", "--grid", "4"]
    shown = ["--refine", "sg", "--max-grid", "9", "--scratch", str(tmp_path), "--fresh-marks"]
    assert main([*asked, *shape, *shown]) == 0
    planned = bfrt.plan(
        store, memory="128MiB", threads=2, resolution=(40, 30), samples=2, depth=3, grid=4,
        refine="sg", max_grid=9, scratch=tmp_path, fresh_marks=True,
    )  # fmt: skip
    assert capsys.readouterr().out == f"{planned}\n"
    assert main([*asked, "-o", str(tmp_path / "x.png"), "--stats", str(tmp_path / "x.json")]) == 0
    assert sorted(path for path in tmp_path.rglob("*")) == before
    assert main(["render", str(store), "--plan", "--memory", "9MiB"]) == 2
    assert re.search(r"found 9MiB, expected \d+MiB or more", capsys.readouterr().err)


def test_degenerate_objects_give_one_warning(tmp_path):
    file = tmp_path / "a.nff"
    file.write_text(NFF + "c 1 1 1 1 1 1 1 1\np 3\n0 0 0\n1 1 1\n2 2 2\n")
    done = run("convert", file, "-o", tmp_path / "a.bfrt")
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert "2 degenerate objects" in done.stderr
    assert run("convert", file, "-o", tmp_path / "a.bfrt", "--quiet").stderr == ""


def test_an_interrupt_ends_within_a_second_and_leaves_the_store_whole(tmp_path):
    store = bfrt.spd.rings(20).write(tmp_path / "rings.bfrt")
    command = [sys.executable, "-m", "bfrt", "render", str(store.path), "-o", "x.png"]
    process = subprocess.Popen(
        [*command, "--resolution", "2000", "2000", "--memory", "512MiB"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        # Where the tests run in a shell's background interrupts are ignored, by children too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(2.5)
    assert process.poll() is None
    start = time.perf_counter()
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert time.perf_counter() - start < 1.5  # a second, and what a busy machine adds
    assert process.returncode == 130
    assert said == "bfrt: interrupted\n"
    store.verify()
    assert names(tmp_path) == ["rings.bfrt"]


def test_no_bar_without_a_terminal(nff):
    done = run("render", nff, "-o", nff.parent / "x.png", "--memory", "128MiB")
    assert (done.stdout, done.stderr) == ("", "")


def test_a_reader_that_goes_away_is_no_error(tmp_path):
    bfrt.spd.tetra(2).write(tmp_path / "s.bfrt")
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "bfrt", "info", "--json", str(tmp_path / "s.bfrt")]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, check=False, cwd=tmp_path)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


def test_verify_reads_the_marks_too(tmp_path, capsys):
    store = bfrt.spd.tetra(2).write(tmp_path / "s.bfrt").path
    assert (
        main(["render", str(store), "-o", str(tmp_path / "a.png"), "--resolution", "8", "8"]) == 0
    )
    assert main(["verify", str(store)]) == 0
    marks = store / "0" / "marks"
    data = bytearray(marks.read_bytes())
    data[-1] ^= 1
    marks.write_bytes(data)
    capsys.readouterr()
    assert main(["verify", str(store)]) == 1
    assert str(marks) in capsys.readouterr().err
