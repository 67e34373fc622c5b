"""Imports go one way: from the foundations up to the command line, never back."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "bfrt"

#: From the ground up; what stands in one line may import from those before, and from itself.
LAYERS = [
    {"bits", "errors", "lazy", "process", "records", "stats", "thread_body", "version"},
    {"refusals", "threads"},
    {"workers"},
    {"ids", "masks", "memory", "paths", "progress"},
    {"settings"},
    {"geometry"},
    {"streams"},
    {"treelets"},
    {"image"},
    {"store"},
    {"shards"},
    {"formats", "framing"},
    {"illumination"},
    {"notebook", "view"},
    {"checkpoint"},
    {"scan"},
    {"grid"},
    {"phases"},
    {"tree"},
    {"budget", "traced_group"},
    {"tracer"},
    {"render_state"},
    {"grid_tracer", "tree_tracer"},
    {"tracing"},
    {"session"},
    {"reference", "scheduler"},
    {"rendering"},
    {"planning"},
    {"queries"},
    {"cluster"},
    {"wavefront"},
    {"scene", "cleaning"},
    {"scene_writer", "sharded"},
    {"spd"},
    {"conversion"},
    {"terrain"},
    {"__init__"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}

#: ``from bfrt.x import y``, ``import bfrt.x``, and the same with ``cimport``; for types too.
OF_A_ROOM = re.compile(r"^[ \t]*(?:from|import|cimport)[ \t]+bfrt\.(\w+)", re.MULTILINE)
#: ``import bfrt`` and ``from bfrt import x``, which may be a room.
OF_ALL = re.compile(
    r"^[ \t]*(?:c?import[ \t]+bfrt\b(?!\.)|from[ \t]+bfrt[ \t]+c?import[ \t]+(.+))", re.MULTILINE
)
DOCSTRING = re.compile(r'""".*?"""', re.DOTALL)


def sources():
    suffixes = ("py", "pyi", "pyx", "pxd")
    found = [path for suffix in suffixes for path in ROOT.rglob(f"*.{suffix}")]
    return sorted(path.relative_to(ROOT) for path in found)


def room_of(source):
    return source.parts[0].split(".")[0]


def imported_by(text):
    """The rooms that a text imports; what is of none is of ``bfrt/__init__.py``."""
    text = DOCSTRING.sub("", text)
    found = set(OF_A_ROOM.findall(text))
    for names in OF_ALL.findall(text):
        first = [name.split()[0] for name in names.strip("()").split(",") if name.strip()]
        found.update(name if name in RANK else "__init__" for name in first or ["__init__"])
    return found


@pytest.mark.parametrize("source", sources(), ids=str)
def test_imports_go_one_way(source):
    room = room_of(source)
    for imported in imported_by((ROOT / source).read_text()) - {room}:
        assert RANK[imported] < RANK[room], f"{source} imports bfrt.{imported}"


def test_every_room_has_its_line():
    assert {room_of(source) for source in sources()} == RANK.keys()
    assert sum(map(len, LAYERS)) == len(RANK)


@pytest.mark.parametrize(
    ("text", "rooms"),
    [
        ("from bfrt.store.store import Store\n", {"store"}),
        ("from bfrt.grid.planes cimport Planes\n", {"grid"}),
        ("import bfrt.scene\n", {"scene"}),
        ("cimport bfrt.records\n", {"records"}),
        ("import bfrt\n", {"__init__"}),
        ("from bfrt import spd\n", {"spd"}),
        ("from bfrt import records, convert as made\n", {"records", "__init__"}),
        ("if TYPE_CHECKING:\n    from bfrt.scan.scans import GroupScans\n", {"scan"}),
        ('"""\n>>> import bfrt\n"""\nimport numpy\n', set()),
    ],
)
def test_every_way_to_import_is_seen(text, rooms):
    assert imported_by(text) == rooms
