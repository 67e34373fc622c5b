"""PLY files as tests write them: of any elements, in any layout."""

from __future__ import annotations

import struct

import numpy as np
from meshes import (
    FACES,
    VERTICES,
)

from bfrt.formats import source as source_module
from bfrt.formats.ply import file as file_module

LAYOUTS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CODES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
         "float": "f", "double": "d", "int64": "q", "uint64": "Q"}  # fmt: skip
OTHERS = {"char": "int8", "uchar": "uint8", "short": "int16", "ushort": "uint16", "int": "int32",
          "uint": "uint32", "float": "float32", "double": "float64",
          "int64": "int64", "uint64": "uint64"}  # fmt: skip
WHOLE = [name for name in CODES if name not in ("float", "double")]
WIDE = ("int", "uint", "double", "int64", "uint64")
XYZ = [("x", "float"), ("y", "float"), ("z", "float")]
CORNERS = [("vertex_indices", "uchar", "int")]


def ply(layout, *elements):
    """A file of elements: name, properties (name and type, or for lists two types), and rows."""
    head = ["ply", f"format {layout} 1.0"]
    for name, properties, rows in elements:
        head.append(f"element {name} {len(rows)}")
        for word, *types in properties:
            head.append(f"property {'list ' * (len(types) > 1)}{' '.join(types)} {word}")
    body = b""
    for _, properties, rows in elements:
        for row in rows:
            values = []  # each with its type
            for (_, *types), value in zip(properties, row, strict=True):
                if len(types) > 1:
                    values.append((types[0], len(value)))
                    values += [(types[1], item) for item in value]
                else:
                    values.append((types[0], value))
            if layout == "ascii":
                body += " ".join(repr(value) for _, value in values).encode() + b"\n"
            else:
                form = LAYOUTS[layout] + "".join(
                    CODES[next(k for k in CODES if kind in (k, OTHERS[k]))] for kind, _ in values
                )
                body += struct.pack(form, *(value for _, value in values))
    return "\n".join([*head, "end_header\n"]).encode() + body


def mesh(layout="ascii", faces=FACES, vertices=VERTICES, xyz=XYZ, corners=CORNERS):
    """A file of vertices and faces, nothing else."""
    rows = [[face] for face in faces]
    return ply(layout, ("vertex", xyz, np.asarray(vertices).tolist()), ("face", corners, rows))


def points(layout="ascii", more=(), rows=None):
    """A file of points with more properties."""
    rows = [[i, 0, 0, *row] for i, row in enumerate(rows or [[]] * 3)]
    return ply(layout, ("vertex", [*XYZ, *more], rows))


def chunk_bytes(patch, size):
    patch.setattr(source_module, "CHUNK_BYTES", size)
    patch.setattr(file_module, "CHUNK_BYTES", size)
    patch.setattr(file_module, "ROWS_AT_ONCE", max(size // 16, 1))


# --- colors --------------------------------------------------------------------------------------


def light_of(color):
    """sRGB as light."""
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in color]


def gray(value, lo, hi):
    """The map gray, of 256 steps."""
    step = min(max(int((value - lo) / (hi - lo) * 256), 0), 255)
    return light_of([step / 255] * 3)


def rgb(red, green, blue):
    """A color of 5, 6 and 5 bits."""
    return light_of([round(red * 31) / 31, round(green * 63) / 63, round(blue * 31) / 31])


# --- bad files -----------------------------------------------------------------------------------


def rich(layout):
    """A small file of all there is."""
    corners = [("q", "uchar"), *CORNERS, ("l", "ushort", "float")]
    rows = [[7, face, [0.5, 1.5]] for face in FACES[:2]]
    return ply(
        layout,
        ("vertex", [*XYZ, ("l", "uchar", "short")], [[*row, [1, 2]] for row in VERTICES.tolist()]),
        ("face", corners, rows),
        ("last", [("a", "int")], [[1], [2]]),
    )


def splats(count, *, flat=False):
    """Gaussian splats, of two lengths where they are flat."""
    names = [*"xyz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
    made = np.zeros(count, [(name, "<f4") for name in names[: -1 if flat else None]])
    for k, name in enumerate(made.dtype.names):
        made[name] = np.sin(np.arange(count) + k)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n"
    head += "".join(f"property float {name}\n" for name in made.dtype.names)
    return (head + "end_header\n").encode() + made.tobytes()
