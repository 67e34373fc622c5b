"""PCD files as tests write them, and LZF as simply as it can be packed."""

from __future__ import annotations

import struct

import numpy as np

LAYOUTS = ("ascii", "binary", "binary_compressed")
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def header(dtype, rows, layout):
    fields = [(name, *field_of(dtype[name])) for name in dtype.names]
    lines = [
        "# .PCD v0.7 - Point Cloud Data", "VERSION 0.7",
        *(
            f"{key} {' '.join(str(field[k]) for field in fields)}"
            for k, key in enumerate(("FIELDS", "SIZE", "TYPE", "COUNT"))
        ),
        f"WIDTH {rows}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {rows}", f"DATA {layout}",
    ]  # fmt: skip
    return ("\n".join(lines) + "\n").encode()


def field_of(dtype):
    return dtype.base.itemsize, {"i": "I", "u": "U", "f": "F"}[dtype.base.kind], (
        dtype.shape[0] if dtype.shape else 1
    )  # fmt: skip


def pcd(records, layout, pack=None):
    """A file of records."""
    head = header(records.dtype, len(records), layout)
    if layout == "ascii":
        rows = (np.concatenate([np.ravel(r[n]) for n in records.dtype.names]) for r in records)
        return head + "".join(" ".join(map(repr, map(float, row))) + "\n" for row in rows).encode()
    if layout == "binary":
        return head + records.tobytes()
    columns = b"".join(
        np.ascontiguousarray(records[name]).tobytes() for name in records.dtype.names
    )
    packed = (pack or lzf)(columns)
    return head + struct.pack("<II", len(packed), len(columns)) + packed


def lzf(data):
    """Packed as LibLZF does, with references of every length, by a table of three bytes."""
    out, literals, at, seen = bytearray(), bytearray(), 0, {}

    def flush():
        for first in range(0, len(literals), 32):
            part = literals[first : first + 32]
            out.append(len(part) - 1)
            out.extend(part)
        literals.clear()

    while at < len(data):
        key = data[at : at + 3]
        back = at - seen.get(key, -10000)
        seen[key] = at
        if len(key) == 3 and back <= 8192:
            size = 3
            while (
                size < 264 and at + size < len(data) and data[at + size] == data[at + size - back]
            ):
                size += 1
            flush()
            first = min(size - 2, 7)
            out.append(first << 5 | back - 1 >> 8)
            if first == 7:
                out.append(size - 9)
            out.append(back - 1 & 255)
            at += size
        else:
            literals.append(data[at])
            at += 1
    flush()
    return bytes(out)


def unlzf(packed):
    """The slow twin: all at once, in plain Python."""
    out, at = bytearray(), 0
    while at < len(packed):
        first = packed[at]
        at += 1
        if first < 32:
            packed[at + first]  # as all of it has to be there
            out += packed[at : at + first + 1]
            at += first + 1
            continue
        size = first >> 5
        if size == 7:
            size += packed[at]
            at += 1
        back = ((first & 31) << 8 | packed[at]) + 1
        at += 1
        for _ in range(size + 2):
            out.append(out[-back])
    return bytes(out)
