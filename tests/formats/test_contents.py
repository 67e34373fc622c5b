"""What ``bfrt info`` says of files before they are converted."""

from __future__ import annotations

import json

import numpy as np
import pytest
from layout_files import AXES, RNG, h5md, h5part, h5py, openpmd, species_of
from ply_files import XYZ, ply

import bfrt
from bfrt.cli import main
from bfrt.conversion.contents import FORMATS, describe_file, nothing
from bfrt.conversion.sources import READERS
from bfrt.errors import BfrtError

ROWS = RNG.random((20, 3)).astype("f4")
MASS = np.arange(20.0)


def told(path):
    """What is told: for each name its shape, type and use."""
    return {row["name"]: tuple(row.values())[1:] for row in describe_file(str(path))["contents"]}


def test_hdf5_datasets(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as made:
        made["gas/Coordinates"], made["gas/Mass"] = ROWS, MASS
        made["gas/Radius"], made["gas/Colors"] = MASS, ROWS
        made["frames"], made["names"] = np.zeros((4, 20, 3)), ["a", "b"]
        made["lost"] = h5py.SoftLink("/nowhere")
        made["table"] = np.zeros(3, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("m", "i2")])
    found = told(path)
    assert found["gas/Coordinates"] == ((20, 3), "float32", "points: --positions gas/Coordinates")
    assert found["gas/Mass"] == ((20,), "float64", "--color-by gas/Mass, --radius gas/Mass")
    assert found["gas/Radius"][2] == "--radius gas/Radius, --color-by gas/Radius"
    assert found["gas/Colors"][2] == "--color-by rgb"
    assert found["frames"] == ((4, 20, 3), "float64", "--positions frames --frame N")
    assert found["names"] == ((2,), "object", "")
    assert found["table/x"] == ((3,), "float32", "points: --positions table")
    assert found["table/m"] == ((3,), "int16", "--color-by table/m, --radius table/m")
    assert "which leads nowhere" in found["lost"][2]


@pytest.mark.parametrize("key", ["gas/Coordinates", "table", "frames"])
def test_an_option_that_is_told_is_taken(tmp_path, key):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as made:
        made["gas/Coordinates"], made["frames"] = ROWS, np.stack([ROWS, ROWS])
        made["table"] = np.zeros(3, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    uses = [use for _, _, use in told(path).values() if f"--positions {key}" in use]
    words = uses[0].partition("--positions ")[2].replace(" N", " 0").split()
    made = ["convert", str(path), "-o", str(tmp_path / "a.bfrt"), "--radius", "1", "--positions"]
    assert main([*made, *words]) == 0
    assert bfrt.open(tmp_path / "a.bfrt").objects == (3 if key == "table" else 20)


def test_layouts(tmp_path):
    path = tmp_path / "a.h5"
    openpmd(path, {n: {"e": species_of(ROWS, mass=((2.0, 20), 1.0))} for n in (5, 40)})
    found = told(path)
    assert found["steps"] == ((2,), "", "openPMD, of which follows data/40/particles: --frame N")
    place = "data/40/particles/e/position"
    assert {key for key in found if "/position/" in key} == {f"{place}/{axis}" for axis in AXES}
    assert found[f"{place}/x"][2] == f"points: --positions {place}"
    assert found["data/40/particles/e/mass"][0] == (20,)
    h5part(path, {n: (ROWS, {"q": MASS}) for n in (1, 2, 10)})
    found = told(path)
    assert found["steps"] == ((3,), "", "H5Part, of which follows Step#10: --frame N")
    assert found["Step#10/x"][2] == "points: --positions Step#10"
    h5md(path, {"all": {"position": (np.stack([ROWS] * 4), True)}})
    value = "particles/all/position/value"
    assert told(path)[value] == ((4, 20, 3), "float32", f"points: --positions {value} --frame N")


def test_numpy(tmp_path):
    path = tmp_path / "a.npy"
    for shape, use in {(4, 3): "points", (4, 4): "spheres", (4, 9): "triangles",
                       (2, 5, 3): "a map of points", (4, 7): ""}.items():  # fmt: skip
        np.save(path, np.zeros(shape, "f4"))
        assert told(path) == {"": (shape, "float32", use)}
    path = tmp_path / "a.npz"
    np.savez(path, **{"m/vertices": ROWS, "m/faces": np.zeros((2, 3), int), "m/heat": MASS[:2],
                      "m/normals": ROWS, "colors": ROWS})  # fmt: skip
    found = {name: use for name, (_, _, use) in told(path).items()}
    assert found == {"m/vertices": "vertices of a mesh", "m/faces": "faces of a mesh",
                     "m/heat": "--color-by m/heat", "m/normals": "normals: --smooth",
                     "colors": "--color-by rgb"}  # fmt: skip


@pytest.mark.parametrize("layout", ["ascii", "binary_big_endian"])
def test_ply(tmp_path, layout):
    path = tmp_path / "a.ply"
    more = [("nx", "float"), ("ny", "float"), ("nz", "float"), ("q", "uchar")]
    vertices = [[0, 0, 0, 0, 0, 1, 7]] * 3
    corners = [("vertex_indices", "uchar", "int")]
    path.write_bytes(
        ply(layout, ("vertex", [*XYZ, *more], vertices), ("face", corners, [[[0, 1, 2]]]))
    )
    found = told(path)
    assert found["vertex x"] == ((3,), "f4", "vertices, --color-by x")
    assert found["vertex nx"] == ((3,), "f4", "normals: --smooth, --color-by nx")
    assert found["vertex q"] == ((3,), "u1", "--color-by q")
    assert found["face vertex_indices"] == ((1,), "list of i4", "faces")
    colors = [(name, "uchar") for name in ("red", "green", "blue")]
    path.write_bytes(ply(layout, ("vertex", [*XYZ, *colors, ("q", "int")], [[0] * 7])))
    found = told(path)
    assert found["vertex x"][2] == "points, --color-by x"
    assert found["vertex red"][2] == "--color-by rgb"
    assert found["vertex q"][2] == "--color-by q, --radius q"


def test_text(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("o a\nv 0 0 0\nv 1 0 0\r\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n")
    assert told(path) == {"v": ((3,), "text", "vertices"), "f": ((1,), "text", "faces"),
                          "vn": ((1,), "text", "normals: --smooth")}  # fmt: skip
    path.write_text("v 0 0 0\n" * (1 << 18))
    assert told(path) == {"v": (((1 << 17),), "text, first 1 MiB", "vertices")}
    path = tmp_path / "a.nff"
    path.write_text("s 0 0 0 1\ns 1 1 1 1\n")
    assert told(path) == {"s": ((2,), "text", "spheres")}


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_text_of_another_encoding(tmp_path, encoding):
    path = tmp_path / "a.obj"
    path.write_bytes("\ufeffv 0 0 0\nv 1 0 0\n".encode(encoding))
    assert told(path) == {"v": ((2,), "text", "vertices")}
    path.write_bytes(bytes(range(256)) * 9)
    with pytest.raises(BfrtError, match="found no line of v, vn, f, usemtl, expected some"):
        describe_file(str(path))


def test_stl(tmp_path):
    path = tmp_path / "a.stl"
    path.write_bytes(bytes(80) + (2).to_bytes(4, "little") + bytes(100))
    assert told(path) == {"facet": ((2,), "float32", "triangles")}
    path.write_text("solid a\nfacet normal 0 0 1\n")
    assert told(path) == {"facet": ((), "text", "triangles")}


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las(tmp_path, suffix):
    laspy = pytest.importorskip("laspy", reason="laspy is not installed: bfrt[las]")
    made = laspy.create(point_format=2, file_version="1.2")
    made.x = made.y = made.z = np.arange(5.0)
    made.write(tmp_path / f"a{suffix}")
    found = told(tmp_path / f"a{suffix}")
    assert found["x y z"] == ((5,), "float64", "points")
    assert found["intensity"][::2] == ((5,), "--color-by intensity, --radius intensity")
    assert found["red"][2] == "--color-by rgb"


def test_every_format_tells_or_has_a_name(tmp_path, capsys, monkeypatch):
    assert set(FORMATS) <= set(READERS.values())
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\n")
    monkeypatch.delitem(FORMATS, READERS[".obj"])
    assert describe_file(str(path)) == {"file": str(path), "format": "OBJ", "bytes": 8,
                                        "contents": nothing("")}  # fmt: skip
    assert main(["info", str(path)]) == 0
    assert capsys.readouterr().out.endswith("format: OBJ\nbytes: 8\n\n")


def test_the_command(tmp_path, capsys):
    path = tmp_path / "a.npz"
    np.savez(path, points=ROWS, m=MASS)
    assert main(["info", str(path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"file: {path}\nformat: NPZ\nbytes: {path.stat().st_size}\n")
    assert "points  20 x 3  float32  points: --positions points\n" in out
    assert main(["info", "--json", str(path)]) == 0
    assert json.loads(capsys.readouterr().out)["contents"][1]["use"] == "--color-by m, --radius m"
    assert main(["info", str(tmp_path / "none.ply")]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_a_file_cut_anywhere_is_told_of_or_refused(tmp_path):
    """As far as it is looked at: in one sentence, and never by a crash."""
    rng = np.random.default_rng(3)
    h5, npy, npz = tmp_path / "a.h5", tmp_path / "a.npy", tmp_path / "a.npz"
    openpmd(h5, {0: {"e": species_of(ROWS)}})
    np.save(npy, ROWS)
    np.savez(npz, a=ROWS)
    faces = ("face", [("vertex_indices", "uchar", "int")], [[[0, 1, 2]]])
    text = ply("ascii", ("vertex", XYZ, [[0, 0, 0]] * 3), faces)
    (tmp_path / "a.ply").write_bytes(text)
    (tmp_path / "a.stl").write_bytes(bytes(80) + b"\2\0\0\0" + bytes(100))
    for path in (h5, npy, npz, tmp_path / "a.ply", tmp_path / "a.stl"):
        data = path.read_bytes()
        cuts = range(len(data)) if len(data) < 400 else rng.integers(0, len(data), 12)
        ends = {"a.npy": 128, "a.ply": data.find(b"end_header") + 10}  # where a header does
        for cut in cuts[: ends.get(path.name)]:
            path.write_bytes(data[:cut])
            with pytest.raises(BfrtError) as caught:
                describe_file(str(path))
            assert str(path) in str(caught.value) and str(caught.value).isprintable()
