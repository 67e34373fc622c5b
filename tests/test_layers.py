"""Imports go one way: from the foundations up to the command line, never back."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "bfrt"

#: From the ground up; what stands in one line may import from it and from those before.
LAYERS = [
    {"bits", "errors", "records", "stats", "workers"},
    {"planned"},
    {"geometry"},
    {"streams"},
    {"image"},
    {"scene"},
    {"spd", "framing"},
    {"phases", "budget"},
    {"scheduler", "reference"},
    {"formats"},
    {"rendering"},
    {"queries", "planning"},
    {"scene_file"},
    {"conversion"},
    {"__init__", "cli", "__main__"},
]
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}
IMPORT = re.compile(r"^\s*(?:from|import)\s+bfrt\.(\w+)", re.MULTILINE)
FOR_TYPES = re.compile(r"^if TYPE_CHECKING:\n(?:    .*\n|\n)*", re.MULTILINE)


def sources():
    found = [path for suffix in ("py", "pyx", "pxd") for path in ROOT.rglob(f"*.{suffix}")]
    return sorted(path.relative_to(ROOT) for path in found)


@pytest.mark.parametrize("source", sources(), ids=str)
def test_imports_go_one_way(source):
    room = source.parts[0].split(".")[0]
    text = FOR_TYPES.sub("", (ROOT / source).read_text())
    for imported in IMPORT.findall(text):
        assert RANK[imported] <= RANK[room], f"{source} imports bfrt.{imported}"
