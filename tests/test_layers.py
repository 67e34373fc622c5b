"""Imports go one way: from the foundations up to the command line, never back."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "bfrt"

#: From the ground up; what stands in one line may import from those before, and from itself.
LAYERS = [
    {"bits", "errors", "records", "workers"},
    {"memory", "stats", "progress"},
    {"settings", "planned"},
    {"geometry"},
    {"streams"},
    {"image"},
    {"store"},
    {"framing", "formats"},
    {"view"},
    {"phases"},
    {"budget"},
    {"tracer", "reference"},
    {"scheduler"},
    {"rendering", "planning"},
    {"queries"},
    {"scene"},
    {"spd"},
    {"conversion"},
    {"__init__", "cli"},
    {"__main__"},
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
        below = imported == room or RANK[imported] < RANK[room]
        assert below, f"{source} imports bfrt.{imported}"


def test_every_room_has_its_line():
    assert {source.parts[0].split(".")[0] for source in sources()} == RANK.keys()
    assert sum(map(len, LAYERS)) == len(RANK)
