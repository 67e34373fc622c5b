"""Whole conversions of meshes, by the command too, of one file and of several."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_files import random_mesh
from meshes import FACES, VERTICES, convert, expected, failure, objects_of, shapes_of, small_room
from properties import examples

import bfrt
from bfrt.cli import main
from bfrt.store.store import open_store

# --- whole conversions ---------------------------------------------------------------------------


def ply_of(vertices, faces, more=()):
    """A PLY file of bytes; `more` are columns of floats."""
    columns = vertices.shape[1]
    names = ["x", "y", "z", *(f"c{i}" for i in range(3, columns))]
    kind = {4: "float", 8: "double"}[vertices.itemsize]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property {kind} {name}" for name in names]
    head += [f"element face {len(faces)}", "property list uchar int vertex_index", "end_header\n"]
    body = [np.uint8(len(face)).tobytes() + np.array(face, "<i4").tobytes() for face in faces]
    return "\n".join(head).encode() + vertices.tobytes() + b"".join(body)


@examples(40)
@given(
    seed=st.integers(0, 1 << 30),
    n=st.integers(1, 250),
    faces=st.integers(1, 60),
    room=st.integers(40, 3000),
    dtype=st.sampled_from([np.float32, np.float64]),
    asked=st.sampled_from(
        [{}, {"color_by": "c3"}, {"polygons": True}, {"triangulate": True}, {"dtype": "float32"}]
    ),
)
def test_the_same_store(tmp_path_factory, seed, n, faces, room, dtype, asked):
    vertices, lists = random_mesh(np.random.default_rng(seed), n, faces, 4, dtype)
    file = tmp_path_factory.mktemp("mesh") / "a.ply"
    file.write_bytes(ply_of(vertices, lists))
    whole = convert(file, **asked)
    if "polygons" in asked:
        assert shapes_of(whole) == expected(vertices[:, :3], lists)
    with pytest.MonkeyPatch.context() as patch:
        small_room(patch, room)
        assert convert(file, **asked).checksum == whole.checksum
    assert sorted(path.name for path in file.parent.iterdir()) == ["a.bfrt", "a.ply"]


@pytest.mark.parametrize("room", [1 << 19, 50])
def test_another_scratch_folder(tmp_path, monkeypatch, room):
    small_room(monkeypatch, room)
    file = tmp_path / "a.ply"
    file.write_bytes(ply_of(VERTICES, FACES))
    scratch = tmp_path / "scratch"
    if room == 50:  # on disk, and there is no such folder
        assert "creating" in failure(file, bfrt.errors.StreamError, scratch=scratch)
    scratch.mkdir()
    assert shapes_of(convert(file, scratch=scratch)) == expected(VERTICES, FACES)
    assert list(scratch.iterdir()) == []


def test_a_bad_mesh_on_disk_leaves_nothing(tmp_path, monkeypatch):
    file = tmp_path / "a.ply"
    data = ply_of(VERTICES, FACES)
    small_room(monkeypatch, 50)
    for size in (*range(data.index(b"end_header"), len(data), 3), len(data) - 1):
        file.write_bytes(data[:size])
        failure(file)
    file.write_bytes(ply_of(VERTICES, [*FACES, [0, 1, 9]]))
    assert failure(file) == "face 4: found vertex 9, expected 0 to 5"
    vertices = VERTICES.copy()
    vertices[3, 0] = np.nan
    file.write_bytes(ply_of(vertices, FACES))
    said = "found nan 1 0.5 1 1 0.75 1 0 0.25, expected finite coordinates of three corners or more"
    assert failure(file) == f"face 1: {said}"
    vertices = VERTICES.copy()
    vertices[0, 2] = np.inf
    file.write_bytes(ply_of(vertices, FACES[1:]))
    assert failure(file).startswith("face 0: found 1 1 0.75 1 0 0.25 0 0 inf, expected finite")


# --- the command ---------------------------------------------------------------------------------


@pytest.fixture
def cloud(tmp_path):
    """Points with a number, one of which is not finite."""
    file = tmp_path / "cloud.ply"
    head = ["ply", "format ascii 1.0", "element vertex 3"]
    head += [f"property float {name}" for name in ("x", "y", "z", "heat")]
    file.write_text("\n".join([*head, "end_header", "0 0 0 1", "nan 0 0 2", "2 0 0 3", ""]))
    return file


@pytest.fixture
def square(tmp_path):
    file = tmp_path / "square.ply"
    file.write_bytes(ply_of(VERTICES, FACES))
    return file


def run(*arguments):
    """The command as a process: its status, what it prints, and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "bfrt", *map(str, arguments)],
        capture_output=True, text=True, check=False, cwd=tempfile.gettempdir(),
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


def test_convert_points(cloud, tmp_path):
    out = tmp_path / "a.bfrt"
    colors = ["--color-by", "heat", "--color-range", "1", "3", "--colormap", "gray"]
    how = ["-o", out, "--skip-invalid", "--radius"]
    status, _, said = run("convert", cloud, *how, "0.5", *colors)
    assert (status, said) == (0, f"bfrt: {cloud}: 1 invalid objects were dropped\n")
    first, last = objects_of(open_store(out))
    assert (first.shape, last.shape) == (((0, 0, 0, 0.5),), ((2, 0, 0, 0.5),))
    assert (first.color, last.color) == ((0, 0, 0), (1, 1, 1))
    assert run("convert", cloud, *how, "heat", "--quiet") == (0, "", "")
    assert shapes_of(open_store(out)) == [((0, 0, 0, 1),), ((2, 0, 0, 3),)]


def test_convert_in_a_budget(square, tmp_path, capsys):
    out = str(tmp_path / "a.bfrt")
    least = "53MiB"
    assert main(["convert", str(square), "-o", out, "--memory", "52MiB"]) == 2
    assert f"expected {least} or more to convert {square}" in capsys.readouterr().err
    assert main(["convert", str(square), "-o", out, "--memory", least, "--triangulate"]) == 0
    assert [stream.kind.label for stream in open_store(out).streams] == ["triangle"]
    assert main(["convert", str(square), "-o", out, "--dtype", "float64"]) == 0
    assert all(stream.wide for stream in open_store(out).streams)


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj"])
@pytest.mark.parametrize("command", ["convert", "render"])
def test_a_bad_file_is_one_line_and_status_1(tmp_path, capsys, suffix, command):
    file = tmp_path / f"a.{suffix}"
    file.write_bytes(b"f 1 2 3\n")
    out = tmp_path / ("a.bfrt" if command == "convert" else "a.png")
    assert main([command, str(file), "-o", str(out)]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said.startswith(f"bfrt: {file}: ")
    assert "expected" in said
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--radius", "1"], "found radius=1.0, expected none"),
        (["--positions", "x"], "found positions='x', expected none"),
        (["--colormap", "gray"], "found without color_by"),
        (["--color-range", "0", "1"], "found without color_by"),
        (["--color-by", "heat"], "found no heat of each vertex or face, expected one of x y z"),
        (["--color-by", "x", "--colormap", "nope"], "colormap: found 'nope'"),
        (["--color-by", "x", "--color-range", "2", "1"], "color_range: found [2.0, 1.0], expected"),
        (["--memory", "many"], "memory: found 'many'"),
    ],
)
@pytest.mark.parametrize("command", ["convert", "render"])
def test_wrong_settings_are_status_2(square, tmp_path, capsys, command, arguments, words):
    out = tmp_path / ("a.bfrt" if command == "convert" else "a.png")
    assert main([command, str(square), "-o", str(out), *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["square.ply"]


def test_points_without_a_radius_are_status_2(cloud, tmp_path, capsys):
    assert main(["convert", str(cloud), "-o", str(tmp_path / "a.bfrt")]) == 2
    assert "found points without a radius, expected radius=" in capsys.readouterr().err
    for radius in ("nan", "inf"):
        arguments = ["-o", str(tmp_path / "a.bfrt"), "--radius", radius]
        assert main(["convert", str(cloud), *arguments]) == 2
        assert (
            f"radius: found {radius}, expected a finite number above 0" in capsys.readouterr().err
        )


def test_render_a_mesh(square, tmp_path, capsys):
    out = tmp_path / "x.png"
    size = ["--resolution", "16", "12", "--memory", "256MiB", "--threads", "1"]
    assert main(["render", str(square), "-o", str(out), "--color-by", "z", *size]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["square.ply", "x.png"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "arguments",
    [["--dtype", "float32"], ["--radius", "1"], ["--radius", "0"], ["--positions", "x"],
     ["--color-by", "z"], ["--colormap", "gray"], ["--color-range", "0", "0"], ["--skip-invalid"],
     ["--triangulate"]],
)  # fmt: skip
def test_reading_options_are_not_for_stores(square, tmp_path, capsys, arguments):
    convert(square)
    store, out = str(square.with_suffix(".bfrt")), str(tmp_path / "x.png")
    assert main(["render", store, "-o", out, *arguments]) == 2
    said = capsys.readouterr().err
    assert f"found {arguments[0]}, expected it for a file, not for a store" in said
    assert not Path(out).exists()


def test_several_files_are_groups(square, cloud, tmp_path):
    with pytest.raises(bfrt.errors.SettingError):
        bfrt.convert([square, cloud], tmp_path / "a.bfrt")
    cloud.write_text(cloud.read_text().replace("nan", "1"))
    scene = bfrt.convert([square, square], tmp_path / "a.bfrt")
    assert counts_of(scene) == [4, 4]


# --- settings of several files -------------------------------------------------------------------


def counts_of(scene):
    """Objects of each group."""
    return [sum(stream.count for stream in group.streams) for group in scene.store.groups]


@pytest.fixture
def several(tmp_path, cloud, square):
    """Files of all sorts, by their suffix or what they hold."""
    cloud.write_text(cloud.read_text().replace("nan", "1"))
    files = {"cloud": cloud, "square": square}
    texts = {
        "stl": "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
        "endloop\nendfacet\nendsolid\n",
        "obj": "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n",
        "nff": "s 0 0 0 1\n",
    }
    for suffix, text in texts.items():
        files[suffix] = tmp_path / f"a.{suffix}"
        files[suffix].write_text(text)
    files["npy"] = tmp_path / "a.npy"
    np.save(files["npy"], VERTICES[:2])
    return files


@pytest.mark.parametrize(
    ("names", "asked", "counts"),
    [
        (("stl", "obj"), {"triangulate": True}, [1, 2]),
        (("obj", "stl"), {"triangulate": True}, [2, 1]),
        (("stl", "obj", "nff"), {"polygons": True}, [1, 1, 1]),
        (("cloud", "square"), {"radius": 1}, [3, 4]),
        (("square", "cloud", "obj"), {"radius": 1, "triangulate": True}, [7, 3, 2]),
        (("stl", "nff"), {"skip_invalid": True}, [1, 1]),
        (("obj", "square"), {"color_by": "z", "colormap": "gray"}, [1, 4]),
        (("square", "obj"), {"color_by": "z", "color_range": (0, 1)}, [4, 1]),
        (("npy", "stl"), {"radius": 0.5}, [2, 1]),
    ],
)
def test_a_setting_is_for_the_files_that_it_concerns(several, tmp_path, names, asked, counts):
    scene = bfrt.convert([several[name] for name in names], tmp_path / "a.bfrt", **asked)
    assert counts_of(scene) == counts
    if "color_by" in asked:
        plain = names.index("obj")
        (stream,) = scene.store.groups[plain].streams
        palette = scene.materials().view("<f4").reshape(-1, 8)
        assert palette[stream.material, :3] == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("names", "asked", "words"),
    [
        (("stl", "obj"), {"radius": 1}, "found radius=1, expected none for files"),
        (("obj", "cloud"), {"radius": 1, "positions": "x"}, "found positions='x', expected none"),
        (("nff", "stl"), {"triangulate": True}, "found triangulate=True, expected none"),
        (("nff", "nff", "stl"), {"polygons": True}, "found polygons=True, expected none"),
        (("stl", "obj", "nff"), {"color_by": "z"}, "found color_by='z', expected none"),
        (("stl", "obj"), {"colormap": "gray"}, "found without color_by"),
        (("square", "obj"), {"color_by": "no"}, "found no no of each vertex or face"),
    ],
)
def test_a_setting_that_concerns_no_file_is_refused(several, tmp_path, names, asked, words):
    files = [several[name] for name in names]
    before = set(tmp_path.iterdir())
    with pytest.raises(bfrt.errors.SettingError) as caught:
        bfrt.convert(files, tmp_path / "a.bfrt", **asked)
    said = str(caught.value)
    assert words in said
    if "for files" in said:
        assert said.startswith(", ".join(map(str, files)) + ": found ")
    assert set(tmp_path.iterdir()) == before


def test_of_many_files_three_are_named(several, tmp_path):
    with pytest.raises(bfrt.errors.SettingError) as caught:
        bfrt.convert([several["stl"]] * 9, tmp_path / "a.bfrt", radius=1)
    named = ", ".join([str(several["stl"])] * 3)
    assert str(caught.value).startswith(f"{named} and 6 more: found radius=1, expected none for")


def test_a_standard_scene_beside_a_mesh(several, tmp_path):
    files = ["spd:tetra:2", several["obj"]]
    scene = bfrt.convert(files, tmp_path / "a.bfrt", triangulate=True)
    assert counts_of(scene) == [16, 2]
    with pytest.raises(bfrt.errors.SettingError, match=r"spd:tetra:2, .*found radius=1, expected"):
        bfrt.convert(files, tmp_path / "a.bfrt", radius=1)
