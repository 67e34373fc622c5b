"""The suite's profiles: how large, and how often."""

from __future__ import annotations

#: Sizes of the standard scenes: about a million objects, about ten, and the paper's largest.
SIZES = {
    "quick": {
        "balls": 6, "gears": 18, "mount": 9, "rings": 36, "teapot": 124, "tetra": 10, "tree": 17,
    },
    "large": {
        "balls": 7, "gears": 30, "mount": 11, "rings": 94, "teapot": 300, "tetra": 12, "tree": 21,
    },
    "huge": {"mount": 14, "rings": 368},
}  # fmt: skip

ROUNDS = {"quick": 3, "large": 3, "huge": 1}
