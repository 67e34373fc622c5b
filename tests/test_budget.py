"""A budget's parts never add up to more than the budget, and the least that works works."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from properties import examples

import bfrt
from bfrt import budget
from bfrt import memory as memory_module
from bfrt.budget import capacities, fixed_bytes
from bfrt.errors import BudgetError, SettingError
from bfrt.grid.partition import partition_of
from bfrt.image.frame import FrameSize
from bfrt.memory import default_memory, format_memory, machine_memory, parse_memory
from bfrt.phases.traversal import FEWEST_RAYS, IN_FLIGHT_BYTES
from bfrt.records import HIT_BYTES, QUEUED_BYTES, RAY_BITS, VOXEL_BITS
from bfrt.settings import Settings
from bfrt.store.model import Light, Material
from bfrt.store.writer import StoreWriter

MIB = 1 << 20


@pytest.mark.parametrize(
    ("text", "amount"),
    [
        (12345, 12345),
        (np.int64(12345), 12345),
        ("12345", 12345),
        ("12345B", 12345),
        ("1kB", 1000),
        ("1KB", 1000),
        ("1KiB", 1024),
        ("256MiB", 256 * MIB),
        ("256MB", 256_000_000),
        (" 256 MiB ", 256 * MIB),
        ("1.5GB", 1_500_000_000),
        ("1.5 GiB", 3 << 29),
        ("2TiB", 2 << 40),
        ("4.35MB", 4_350_000),  # 4.35 * 10**6 is less in floats
        ("1.1GB", 1_100_000_000),
        ("9007199254740993", 9007199254740993),
    ],
)
def test_amounts(text, amount):
    found = parse_memory(text)
    assert found == amount
    assert type(found) is int


@pytest.mark.parametrize(
    "text",
    ["", "MiB", "256M", "256mib", "-1MiB", "1e9", "1,5GB", ".5GB", "0x10", "1 2", "inf", "nan",
     "٣MiB", None, 1.5, 1e9, True, b"1MiB", "1XiB"],
)  # fmt: skip
def test_what_is_no_amount(text):
    with pytest.raises(SettingError, match=r"memory: found .* expected an amount such as 256MiB"):
        parse_memory(text)


def test_an_endless_amount():
    with pytest.raises(SettingError, match=r"memory: found 2\^1368 bytes or more, expected fewer"):
        parse_memory("9" * 400 + "TiB")


@given(st.integers(0, 1 << 50))
def test_what_is_printed_is_enough_and_can_be_read(amount):
    shown = parse_memory(format_memory(amount))
    assert amount <= shown < amount + MIB


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """A machine of 16 GiB whose cgroups are files below tmp_path."""
    pages = (16 << 30) // 4096
    monkeypatch.setattr(
        memory_module.os,
        "sysconf",
        lambda name: {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": pages}[name],
    )
    monkeypatch.setattr(memory_module, "OWN_CGROUPS", tmp_path / "own")
    monkeypatch.setattr(memory_module, "CGROUPS", tmp_path / "cgroup")
    machine_memory.cache_clear()
    yield tmp_path
    machine_memory.cache_clear()


@pytest.mark.parametrize(
    ("own", "limits", "expected"),
    [
        (None, {}, 16 << 30),
        ("0::/\n", {"memory.max": "max"}, 16 << 30),
        ("0::/\n", {"memory.max": "1048576"}, MIB),
        ("0::/a/b\n", {"a/b/memory.max": "max", "a/memory.max": "4194304"}, 4 * MIB),
        ("0::/a/b\n", {"a/b/memory.max": "2097152", "a/memory.max": "4194304"}, 2 * MIB),
        ("0::/a\n", {"other/memory.max": "1"}, 16 << 30),
        ("0::/a\n", {"a/memory.max": str(1 << 60)}, 16 << 30),
        ("3:cpu:/a\n2:memory:/a\n", {"memory/a/memory.limit_in_bytes": "8192"}, 8192),
        ("2:memory:/docker/1\n", {"memory/memory.limit_in_bytes": "8192"}, 8192),
        ("2:cpu:/a\n", {"memory/a/memory.limit_in_bytes": "8192"}, 16 << 30),
    ],
)
def test_the_default_is_a_quarter_of_what_there_is(machine, own, limits, expected):
    if own is not None:
        (machine / "own").write_text(own)
    for name, text in limits.items():
        path = machine / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")
    assert default_memory() == expected // 4


def test_there_is_memory_here():
    assert default_memory() > MIB


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    """An empty store, a small one, and one of several streams with a large polygon."""
    folder = tmp_path_factory.mktemp("budget")
    rng = np.random.default_rng(1)
    StoreWriter(folder / "empty").complete()
    with StoreWriter(folder / "small") as writer:
        writer.spheres(rng.random((50, 3), np.float32), 0.1)
    with StoreWriter(folder / "several") as writer:
        for k in range(3000):
            writer.material(Material(kd=k / 4096))
        writer.light(Light((0, 0, 0)))
        writer.spheres(rng.random((500, 3), np.float32), 0.1)
        writer.triangles(rng.random((5000, 3, 3), np.float32))
        turn = np.linspace(0, 2 * np.pi, 30_000, endpoint=False)
        outline = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        writer.polygons(outline.astype(np.float32), [len(turn)])
    return [bfrt.open(folder / name).store for name in ("empty", "small", "several")]


def divided(store, width, height, samples, memory, threads, aovs=()):
    """What a budget holds."""
    settings = Settings.of(memory=memory, threads=threads)
    return capacities(store, settings, FrameSize(width, height, samples, tuple(aovs)))


VIEW = st.tuples(
    st.integers(1, 4096), st.integers(1, 4096), st.sampled_from([0, 1, 16]), st.integers(1, 64)
)
AOVS = st.sampled_from([(), ("position",), ("albedo",), ("position", "albedo")])


def least_of(store, width, height, samples, threads, aovs=()):
    """What the refusal of one byte names, in bytes."""
    with pytest.raises(BudgetError) as caught:
        divided(store, width, height, samples, 1, threads, aovs=aovs)
    message = str(caught.value)
    found = re.fullmatch(
        rf"memory: found 0MiB, expected (\d+MiB) or more for {width} x {height} pixels "
        rf"of this scene with {threads} threads", message
    )  # fmt: skip
    assert found, message
    return parse_memory(found[1])


@given(view=VIEW, which=st.integers(0, 2), aovs=AOVS)
def test_the_least_that_is_named_works_and_less_does_not(stores, view, which, aovs):
    store = stores[which]
    width, height, samples, threads = view
    least = least_of(store, *view, aovs)
    plan = divided(store, width, height, samples, least, threads, aovs=aovs)
    assert min(plan.blocks, plan.subspace, plan.rays, plan.candidates, plan.hits, plan.queue) > 0
    assert plan.rays >= FEWEST_RAYS - 1
    with pytest.raises(BudgetError):
        divided(store, width, height, samples, least - MIB, threads, aovs=aovs)


@examples(300)
@given(view=VIEW, which=st.integers(0, 2), more=st.integers(0, 1 << 36), aovs=AOVS)
def test_the_parts_add_up_to_no_more_than_the_budget(stores, view, which, more, aovs):
    store = stores[which]
    width, height, samples, threads = view
    memory = least_of(store, *view, aovs) + more
    plan = divided(store, width, height, samples, memory, threads, aovs=aovs)
    group = store.groups[0]
    cut = partition_of(group, plan.limits)
    parts = {
        "fixed": fixed_bytes(store, Settings.of(memory=memory, threads=threads)),
        "frame": frame_held(plan, width, height, samples, 12 * len(aovs)),
        "a slab": min(plan.limits.slab, 512 * cut.bricks),
        "where bricks are": 6 * cut.bricks,
        "starts and occupancy": cut.uppers * (4 + 8 / 64),
        "blocks": plan.blocks * (256 + 8 + 4 + 16) if cut.lower_bits else 1,
        "rays": plan.rays * (72 + 24 + 4 + 4),
        "candidates": plan.candidates * 8,
        "hits, waiting and shaded": plan.hits * (HIT_BYTES + 2 * HIT_BYTES + 16),
        "two queues": 2 * plan.queue * QUEUED_BYTES,
    }
    assert plan.memory == memory
    assert sum(parts.values()) <= memory
    assert cut.voxels <= plan.limits.voxels <= 1 << VOXEL_BITS
    # Before there are rays.
    early = parts["fixed"] + parts["frame"]
    assert early + plan.subspace + 6 * cut.bricks + 2 * plan.limits.slab < memory
    assert plan.rays <= 1 << RAY_BITS
    assert plan.candidates >= 4 * plan.rays


def frame_held(plan, width, height, samples, extra):
    """The film of a band, or the whole film and the image."""
    corners = samples == 0
    film = (width + corners) * (plan.rows + corners) * (56 + extra)
    assert 1 <= plan.rows <= height
    assert plan.frame_on_disk or plan.rows == height
    return film + (0 if plan.frame_on_disk else width * height * (40 + extra))


@given(view=VIEW, which=st.integers(0, 2), more=st.integers(0, 1 << 32), step=st.integers(0, MIB))
@example(view=(2624, 224, 0, 42), which=1, more=107824375, step=146900)
def test_more_memory_holds_no_fewer_rays(stores, view, which, more, step):
    width, height, samples, threads = view
    memory = least_of(stores[which], *view) + more
    one, two = (
        divided(stores[which], width, height, samples, m, threads) for m in (memory, memory + step)
    )
    # But where the whole frame begins to fit, or a row more of it, they do so in place of rays.
    lost = (one.rays - two.rays) * IN_FLIGHT_BYTES
    row = (width + 1) * (56 + 40) * (two.rows - one.rows)
    assert lost <= row or (one.frame_on_disk and not two.frame_on_disk)
    assert one.frame_on_disk >= two.frame_on_disk


@pytest.mark.parametrize("part", ["threads", "stores"])
def test_more_work_needs_more(stores, part):
    base = (640, 480, 0, 2)
    more = {"threads": (640, 480, 0, 8), "stores": base}[part]
    other = stores[2] if part == "stores" else stores[1]
    assert least_of(other, *more) > least_of(stores[1], *base)


@pytest.mark.parametrize("memory", [0, -1, 1000])
def test_next_to_nothing_is_refused(stores, memory):
    with pytest.raises(BudgetError, match="memory: found"):
        divided(stores[1], 64, 64, 0, memory, 1)


def test_a_refusal_never_names_what_was_given(stores):
    least = least_of(stores[1], 512, 512, 0, 2)
    with pytest.raises(BudgetError) as caught:
        divided(stores[1], 512, 512, 0, least - MIB, 2)
    found, expected = re.findall(r"(\d+)MiB", str(caught.value))
    assert int(found) < int(expected)


def test_channels_on_request_take_their_bytes_from_the_rays(stores):
    """Film and image have them; what is not asked for takes nothing."""
    plans = [
        divided(stores[1], 512, 512, 16, 512 << 20, 2, aovs=aovs)
        for aovs in ((), ("position",), ("position", "albedo"))
    ]
    assert plans[0] == divided(stores[1], 512, 512, 16, 512 << 20, 2)
    lost = -np.diff([plan.rays for plan in plans])
    part = budget.IN_FLIGHT_PART * 2 * 12 * 512 * 512 / IN_FLIGHT_BYTES
    assert (lost > 0).all() and lost == pytest.approx([part, part], rel=0.2)
    # The least in which the frame is in memory without them: it is not, with them.
    edge = next(
        memory
        for memory in range(128 * MIB, 1024 * MIB, MIB)
        if not divided(stores[1], 1400, 1400, 1, memory, 2).frame_on_disk
    )
    assert divided(stores[1], 1400, 1400, 1, edge, 2, aovs=("albedo",)).frame_on_disk


def test_a_larger_frame_needs_hardly_more(stores):
    """It is rendered in bands of rows."""
    small, large = (least_of(stores[1], side, side, 0, 2) for side in (64, 8192))
    assert large < small + (20 << 20)  # OpenEXR has sixteen rows at once
    plan = divided(stores[1], 8192, 8192, 0, 256 << 20, 2)
    assert plan.frame_on_disk and 16 <= plan.rows < 8192
