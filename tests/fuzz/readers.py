"""Conversions of each format, in process; settings are chosen by the input, so that all come."""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import array_files
import las_files
import meshes
import nff_files
import numpy as np
import obj_files
import pcd_files
import ply_files
import raster_files
import stl_files
from fuzz.alone import read
from fuzz.packing import packed, put, unpacked
from fuzz.trial import Harness, of_bytes, of_files

import bfrt

Settings = Sequence[Mapping[str, Any]]

MEMORY = "512MiB"
ORDERS = ("given", "spatial")

#: Settings of meshes, and of points.
MESH: Settings = (
    {}, {}, {"triangulate": True}, {"polygons": True}, {"skip_invalid": True}, {"color_by": "rgb"},
    {"color_by": "z", "radius": 0.5}, {"smooth": True}, {"smooth": True, "skip_invalid": True},
)  # fmt: skip
POINTS: Settings = (
    {"radius": 0.5}, {"radius": 0.5}, {"radius": 0.5, "skip_invalid": True},
    {"radius": 0.5, "color_by": "mass"}, {"radius": "radii"}, {"radius": 0.5, "color_by": "rgb"},
    {"radius": 0.5, "frame": 0}, {},
    {"positions": "centers", "radius": 0.5, "color_by": "mass", "color_range": (0, 1)},
)  # fmt: skip


def converting(name: str, settings: Settings) -> Callable[[bytes, Path], None]:
    """What converts a file of a name, and compares the store with its checksums."""

    def run(data: bytes, folder: Path) -> None:
        (folder / "in" / name).write_bytes(data)
        convert(data, folder, name, settings)

    return run


#: Choices, at the most, by which the settings of any format come in both orders.
CHOICES = len(ORDERS) * (1 + max(map(len, (MESH, POINTS))))


def choice(data: bytes) -> int:
    """Return what chooses settings for an input."""
    return zlib.crc32(data)


#: Whether files are only read: `fuzz.py --alone`.
alone = False


def convert(data: bytes, folder: Path, name: str, settings: Settings) -> None:
    """Convert a file that is there, or only read it, by settings that the input chooses."""
    chosen = choice(data)
    how = settings[chosen // 2 % len(settings)]
    if alone:
        read(folder / "in" / name, how, folder / "tmp")
        return
    with bfrt.convert(
        folder / "in" / name, folder / "out" / "a.bfrt", order=ORDERS[chosen % 2],
        memory=MEMORY, scratch=folder / "tmp", durable=False, **how,
    ) as scene:  # fmt: skip
        scene.verify()


# --- text, and bytes in rows -------------------------------------------------------------------


def nff(_: Path) -> Harness:
    text = io.StringIO()
    bfrt.spd.tetra(1).write_nff(text)
    tokens = b"v from at up angle hither resolution b l f c s p pp # p 3 pp 3 \n \r \x0b".split(
        b" "
    )
    seeds = [nff_files.SCENE, text.getvalue().encode(), nff_files.VIEW + b"s 1 2 3 4\n"]
    return of_bytes(seeds, (*tokens, b" ", b"p 99999999 "), converting("a.nff", ({},)))


def ply(_: Path) -> Harness:
    colored = [("red", "uchar"), ("green", "uchar"), ("blue", "uchar"), ("radii", "float")]
    seeds = [
        make
        for layout in ply_files.LAYOUTS
        for make in (
            ply_files.rich(layout),
            ply_files.mesh(layout),
            ply_files.points(layout, colored, [[1, 2, 3, 0.5]] * 4),
        )
    ]
    seeds += [ply_files.splats(5), ply_files.splats(5, flat=True)]
    words = (
        "ply\nformat ascii 1.0\n|format binary_little_endian 1.0\n|element |element face 3\n|"
        "element vertex 7\n|property list uchar int vertex_indices\n|property float x\n|list |"
        "property list double double l\n|property uchar red\n|end_header\n|comment |obj_info |\r\n|"
        "property float opacity\n|property float packed_position\n"
    )
    tokens = tuple(word.encode() for word in words.split("|"))
    return of_bytes(seeds, tokens, converting("a.ply", (*MESH, {"opacity": 0.5})))


def stl(_: Path) -> Harness:
    seeds = [
        stl_files.binary(), stl_files.text(), stl_files.text(name=" a name", end="\r\n"),
        stl_files.binary(header=b"solid of bytes"),
    ]  # fmt: skip
    words = b"solid|endsolid|facet normal |outer loop|vertex |endloop|endfacet|\n|\r\n|\x00"
    return of_bytes(
        seeds, tuple(words.split(b"|")), converting("a.stl", ({}, {"skip_invalid": True}))
    )


#: An OBJ file and its library.
OBJECT = ("a.obj", "a.mtl")


def obj(_: Path) -> Harness:
    forms = ("{0}", "{1}", "{0}/1", "{0}/1/1", "{0}//{1}")
    texts = [
        obj_files.DRESSED + "\n",
        obj_files.obj(forms=forms),
        obj_files.dressed("a.mtl", ["red one", "glass", "mirror", "halo", "none"]),
    ]
    seeds = [
        packed({"a.obj": text.encode(), "a.mtl": obj_files.LIBRARY.encode()}, OBJECT)
        for text in texts
    ]
    words = (
        "v |vt |vn |f |f 1 2 3\n|usemtl |mtllib a.mtl\n|newmtl |Kd |Ks |Ni |d |Tr |illum |map_Kd |"
        "#|\\\n|/|//|-1|\n|o |g |s off\n"
    )

    def run(data: bytes, folder: Path) -> None:
        put(unpacked(data, OBJECT), folder / "in")
        convert(data, folder, "a.obj", MESH[:5])

    return of_files(seeds, tuple(word.encode() for word in words.split("|")), run, OBJECT)


# --- arrays ------------------------------------------------------------------------------------


def arrays() -> list[dict[str, Any]]:
    """What archives hold: points with more, a mesh, triangles."""
    points = {"centers": array_files.CENTERS, "mass": array_files.MASS}
    return [
        {**points, "radii": array_files.RADII, "colors": (array_files.CENTERS * 9).astype("u1")},
        {"vertices": meshes.VERTICES, "faces": np.array([[0, 1, 5], [3, 2, 1]])},
        {"triangles": array_files.TRIANGLES},
        {"particles/all/position/value": np.stack([array_files.CENTERS] * 2)},
        {
            f"Step#{n}/{axis}": array_files.CENTERS[:, k]
            for n in (0, 1)
            for k, axis in enumerate("xyz")
        },
    ]


def saved(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


#: Words of a header of .npy.
TYPES = (
    b"'<f4'", b"'>f8'", b"'|u1'", b"'<i8'", b"'|O'", b"'<f2'", b"'|V0'", b"'<U9'", b"True",
    b"False", b"(20, 3)", b"(0,)", b"()", b"(2, 3, 3)", b"\x93NUMPY",
    b"[('x', '<f4'), ('y', '<f4')]", b"('<f4', (3,))", b"-1", b"None",
)  # fmt: skip


def npy(_: Path) -> Harness:
    mass = array_files.records(mass=array_files.MASS)
    seeds = [
        saved(array)
        for array in (
            array_files.CENTERS, array_files.TRIANGLES, mass,
            np.asfortranarray(array_files.CENTERS),
            array_files.CENTERS.astype(">f8"), np.tile(array_files.RADII[:, None], 4),
        )
    ]  # fmt: skip
    return of_bytes(seeds, TYPES, converting("a.npy", (*POINTS[:6], {})))


def npz(_: Path) -> Harness:
    seeds = []
    for save in array_files.SAVES:
        for each in arrays():
            file = io.BytesIO()
            save(file, **each)
            seeds.append(file.getvalue())
    tokens = (b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06", b"PK\x06\x06", b"centers.npy", *TYPES)
    return of_bytes(seeds, tokens, converting("a.npz", POINTS))


#: Names of arrays in an archive that is put together of what was changed.
MEMBERS = (
    "centers", "mass", "radii", "colors", "vertices", "faces", "triangles",
    "particles/all/position/value", *(f"Step#{n}/{axis}" for n in (0, 1) for axis in "xyz"),
)  # fmt: skip


def npz_members(_: Path) -> Harness:
    """Archives whose checksums are right, whatever is in their members."""

    def run(data: bytes, folder: Path) -> None:
        with zipfile.ZipFile(folder / "in" / "a.npz", "w") as archive:
            for name, member in unpacked(data, MEMBERS).items():
                archive.writestr(f"{name}.npy", member)
        convert(data, folder, "a.npz", POINTS)

    seeds = [
        packed({name: saved(array) for name, array in each.items()}, MEMBERS) for each in arrays()
    ]
    return of_files(seeds, TYPES, run, MEMBERS)


# --- scans -------------------------------------------------------------------------------------


def scans(home: Path, suffix: str) -> list[bytes]:
    seeds = []
    for form in (0, 3, 6, 7):
        extra = [("mass", "f4")] if form in (3, 6) else []
        path = home / f"{form}{suffix}"
        las_files.write(path, form, 12, extra=extra)
        seeds.append(path.read_bytes())
    return seeds


def las(home: Path) -> Harness:
    return of_bytes(scans(home, ".las"), (b"LASF", b"LASF_Spec"), converting("a.las", SCAN))


def laz(home: Path) -> Harness:
    return of_bytes(scans(home, ".laz"), (b"LASF", b"laszip encoded"), converting("a.laz", SCAN))


SCAN: Settings = (
    {"radius": 0.5}, {"radius": 0.5}, {"radius": 0.5, "color_by": "rgb"},
    {"radius": 0.5, "color_by": "intensity"}, {"radius": "mass"}, {"radius": 1, "color_by": "mass"},
)  # fmt: skip


# --- rasters -----------------------------------------------------------------------------------

TERRAIN: Settings = (
    {}, {}, {"skip_invalid": True}, {"height_scale": 0.5, "floor": 0.0}, {"color_by": "z"},
    {"band": 2, "curvature": 1.0},
)  # fmt: skip


def raster(home: Path) -> Harness:
    """Read in this process, where GDAL has no limit of its own."""
    tiles = {"tiled": True, "blockxsize": 16, "blockysize": 16}
    layouts: list[dict[str, Any]] = [
        {}, {"nodata": 5.0}, {"compress": "deflate", "predictor": 3}, {**tiles, "compress": "lzw"},
        {**tiles, "BIGTIFF": "YES"}, {"ENDIANNESS": "BIG", "compress": "packbits"},
    ]  # fmt: skip
    seeds = []
    for bands in (1, 2):
        heights = np.stack([raster_files.HEIGHTS] * bands)
        for layout in layouts:
            path = raster_files.write(home / "seed.tif", heights, **layout)
            seeds.append(path.read_bytes())

    def run(data: bytes, folder: Path) -> None:
        (folder / "in" / "a.tif").write_bytes(data)
        with raster_files.in_this_process():
            convert(data, folder, "a.tif", TERRAIN)

    tokens = (b"II*\x00", b"MM\x00*", b"II+\x00", b"\x01\x01", b"\x44\x01", b"-9999", b"nan\x00")
    return of_bytes(seeds, tokens, run)


# --- points, and OFF -----------------------------------------------------------------------------

#: Rows of numbers, and what text of them may have.
ROWS = "".join(f"{k} {k * 0.5} {-k} {k % 3 + 1} {k * 9} 0 255\n" for k in range(1, 13))
WORDS = (
    b"\n",
    b"\r\n",
    b",",
    b";",
    b"\t",
    b"|",
    b'"',
    b"#",
    b"//",
    b"nan",
    b"1e400",
    b"12\n",
    b"-",
)

CLOUD: Settings = (
    {"radius": 0.5}, {"radius": "auto"}, {"radius": 0.5, "color_by": "rgb"}, {"radius": "4"},
    {"radius": 0.5, "color_by": "intensity"}, {"radius": 0.5, "skip_invalid": True}, {},
)  # fmt: skip


def lines(_: Path) -> Harness:
    titled = "x,y,z,intensity,red,green,blue\n" + ROWS.replace(" ", ",")
    seeds = [text.encode() for text in (ROWS, "12\n" + ROWS, titled, "# x y z a b c d\n" + ROWS)]
    return of_bytes(seeds, WORDS, converting("a.csv", CLOUD))


def gzipped(_: Path) -> Harness:
    seeds = [gzip.compress(ROWS.encode(), level, mtime=0) for level in (0, 1, 9)]
    seeds.append(seeds[0] + seeds[1])
    return of_bytes(seeds, (b"\x1f\x8b\x08\x00", bytes(8)), converting("a.xyz.gz", CLOUD))


def pcd(_: Path) -> Harness:
    made = np.zeros(12, [*pcd_files.XYZ, ("intensity", "<f4"), ("rgb", "<f4"), ("n", "<i2", 3)])
    for number, axis in enumerate("xyz"):
        made[axis] = np.arange(12) * (number + 1)
    made["intensity"] = np.arange(12) + 1
    seeds = [pcd_files.pcd(made, layout) for layout in pcd_files.LAYOUTS]
    words = b"FIELDS |SIZE |TYPE |COUNT |WIDTH |HEIGHT 1|POINTS |DATA ascii\n|binary|rgba|12|\n"
    return of_bytes(seeds, tuple(words.split(b"|")), converting("a.pcd", CLOUD))


def off(_: Path) -> Harness:
    rows = "0 0 0{0}\n1 0 0{0}\n1 1 0.5{0}\n0 1 0{0}\n"
    faces = "3 0 1 2{1}\n4 0 1 2 3{1}\n"
    seeds = [
        f"{word}\n4 2 0\n{(rows + faces).format(more, behind)}".encode()
        for word, more, behind in (
            ("OFF", "", ""), ("COFF", " 255 0 9 1", ""), ("OFF # a", "", " 0.5 1 0"),
            ("CNOFF", " 0 0 1 1 1 0", " 7"),
        )
    ]  # fmt: skip
    seeds.append(b"OFF 4 0 0\n" + rows.format("").encode())
    tokens = (b"OFF", b"COFF", b"4 2 0", b"99999999", b"-1", *WORDS)
    return of_bytes(seeds, tokens, converting("a.off", (*MESH[:6], {"radius": "auto"})))


def lammps(_: Path) -> Harness:
    atoms = "ITEM: ATOMS id type {} radius\n1 1 0.5 0.5 0.5 1\n2 2 0.25 0.5 0.75 2\n"
    begin = "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\n"
    boxes = (
        "ITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n-1 9\n",
        "ITEM: BOX BOUNDS xy xz yz pp pp pp\n0 9 1\n0 9 0\n0 9 2\n",
        "ITEM: BOX BOUNDS abc origin\n1 0 0 0\n0 1 0 0\n0 0 1 0\n",
    )
    frames = [begin + box + atoms.format(n) for box in boxes for n in ("x y z", "xs ys zs")]
    seeds = [frame.encode() for frame in (*frames, frames[0] + frames[3])]
    tokens = (b"ITEM: ", b"TIMESTEP\n0\n", b"NUMBER OF ATOMS\n", b"BOX BOUNDS ", b"xsu ysu zsu")
    settings: Settings = (
        {}, {"radius": "1=1,2=3"}, {"radius": 1, "frame": 0}, {"radius": "auto", "frame": -2},
        {"color_by": "type"}, {"skip_invalid": True},
    )  # fmt: skip
    return of_bytes(seeds, (*tokens, *WORDS), converting("a.dump", settings))
