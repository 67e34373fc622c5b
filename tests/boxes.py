"""The boxes of stored objects, read and decoded one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bfrt.records import PARENT, Kind
from bfrt.reference import _kernels
from bfrt.store.store import Store
from bfrt.store.stream import Stream


def boxes_of(store: Store, *, quantised: bool = False) -> NDArray[np.float32]:
    """All of them, as rays meet them: as they are, or quantised where they are kept so."""
    parts = [
        _quantised(s) if quantised and s.quantised else _exact(s, store) for s in store.streams
    ]
    return np.concatenate(parts)


def _exact(stream: Stream, store: Store) -> NDArray[np.float32]:
    if stream.kind != Kind.SPHERE:
        return np.fromfile(stream.path("boxes"), np.float32).reshape(-1, 6)
    records = np.fromfile(stream.path("geometry"), np.uint8).reshape(stream.count, -1)
    eights = [records[i : i + 8] for i in range(0, stream.count, 8)]
    found = [_kernels.sphere_boxes(e, stream.wide, store.origin)[0][: len(e)] for e in eights]
    return np.concatenate(found)


def _quantised(stream: Stream) -> NDArray[np.float32]:
    codes = np.fromfile(stream.path("quantised"), np.uint8).reshape(-1, 6)
    found, begin = [], 0
    for parent in np.fromfile(stream.path("level1"), PARENT):
        box = np.array([parent[name] for name in PARENT.names[:6]], np.float32)
        for first in range(begin, parent["end"], 8):
            own = codes[first : min(first + 8, parent["end"])]
            found.append(_kernels.decoded_eight(box, own)[0][: len(own)])
        begin = parent["end"]
    return np.concatenate(found)
