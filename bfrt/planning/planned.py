"""A plan: the answer of `bfrt.plan`, its assumptions, and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bfrt.stats import aligned


@dataclass(frozen=True)
class Assumptions:
    """Holds the numbers that estimates are made with.

    Counts are fits to the counters of rings 36 and 94, balls 6, mount 10, tree 17, teapot 124 and
    gears 18, at 128 and 256 MiB; seconds to docs/performance.rst: two cores of an EPYC at 2.4 GHz,
    files in the page cache.

    Attributes
    ----------
    hits : float
        Part of the rays, shadow rays left out, that hit something.
    facing : float
        Part of the lights that a hit faces.
    onward : tuple of 3 float
        Rays that go on from a hit: in a scene without mirrors, with mirrors, and with transmitting
        surfaces too.
    passes, passes_full : float
        Passes of a round of the depth loop with few rays; further ones for each time that rays fill
        memory.
    passes_off : float
        Factor from the estimated passes to the most, for the upper bound of bytes.
    candidates : float
        Candidates of a ray in a pass, if memory holds them.
    hit_bytes : float
        Bytes read for a shaded hit, gaps that are read through included.
    slab_reads : float
        Times that each slab is read in a pass, if there are several.
    read_rate : float
        Bytes read a second.
    mark_rate, ray_rate, test_rate : float
        Objects marked, rays taken through all phases, and boxes tested, a second and thread.
    tests : float
        Boxes tested a ray.
    tree_passes_full : float
        As `passes_full`, of treelets.
    tree_left : float
        Part of the rays that a pass over treelets leaves to the next.
    entered : float
        Treelets that a ray in a pass brings in, where there are few rays.
    seen : float
        Part of the treelets that are entered in a pass, where there are many.
    tree_read : float
        Part of a treelet that is read where rays come to it: its nodes, and the objects of leaves.
    tree_read_rate : float
        Bytes of those read a second, in pieces of some 10 KB.
    tree_rate : float
        Rays taken through all phases by treelets, a second and thread.
    order_rate : float
        Objects brought into spatial order, a second and thread, beside what reading and writing
        take (a fit to the table in docs/tree.rst).
    """

    hits: float = 0.8
    facing: float = 0.7
    onward: tuple[float, float, float] = (0.0, 0.65, 0.95)
    passes: float = 3.0
    passes_full: float = 1.2
    passes_off: float = 3.0
    candidates: float = 16.0
    hit_bytes: float = 500.0
    slab_reads: float = 1.3
    read_rate: float = 1e9
    mark_rate: float = 8e6
    ray_rate: float = 6e5
    test_rate: float = 4e7
    tests: float = 30.0
    tree_passes_full: float = 1.2
    tree_left: float = 0.04
    entered: float = 1.0
    seen: float = 0.5
    tree_read: float = 0.55
    tree_read_rate: float = 5e8
    tree_rate: float = 6e5
    order_rate: float = 2.5e6


ASSUMED = Assumptions()


@dataclass(frozen=True)
class GridPlan:
    """Describes a group's grid.

    Attributes
    ----------
    voxels : tuple of 3 int
        Voxels on each axis: x, y, z.
    lower : int
        Voxels a side of an upper voxel; 1 for a grid of one level.
    blocks : int
        Lower-level blocks in memory; 0 for a grid of one level.
    subspaces : int
        Parts in which the grid is preprocessed, one pass each.
    slabs : int
        Parts in which rays go through the grid; exact if `slabs_known`, else the most there may be.
    slabs_known : bool
        Whether `slabs` is exact: the marks exist, or the grid is one slab.
    marks_there : bool
        Whether the marks exist, so that no preprocess is needed.
    marks_bytes : int
        Bytes of the file of marks; an upper bound if it does not exist.
    """

    voxels: tuple[int, int, int]
    lower: int
    blocks: int
    subspaces: int
    slabs: int
    slabs_known: bool
    marks_there: bool
    marks_bytes: int


@dataclass(frozen=True)
class TreePlan:
    """Describes the treelets of a scene.

    Attributes
    ----------
    treelets, nodes : int
        Numbers of them.
    bytes : int
        Bytes of all treelets: nodes, geometry, ids.
    resident : bool
        Whether they stay in memory once they are read; otherwise they stream.
    """

    treelets: int
    nodes: int
    bytes: int
    resident: bool


@dataclass(frozen=True)
class RayPlan:
    """Counts the rays to be traced: eye rays exactly, the others as an estimate and at most."""

    eye: int
    others: int
    others_most: int


@dataclass(frozen=True)
class PhasePlan:
    """Counts passes, bytes and seconds of one or more phases.

    The passes of the preprocess are exact, all else is an estimate. The bytes read are between
    `bytes_least` and `bytes_most`, if any ray comes near an object.
    """

    passes: int
    bytes_least: int
    bytes_read: int
    bytes_most: int
    seconds: float


@dataclass(frozen=True)
class DiskPlan:
    """Counts bytes on disk at most: new marks, a frame that memory cannot hold, and spools.

    And those of a checkpoint, where one is asked for: of two states, for a moment.
    """

    marks: int
    frame: int
    spools: int
    checkpoint: int = 0


@dataclass(frozen=True)
class OrderingPlan:
    """Tells what it takes to bring objects that are stored as given into spatial order.

    `bfrt.convert` does so when it has read all of them, from the file that the store was made of.

    Attributes
    ----------
    disk : int
        The most bytes on disk at once, beside the files as given; a conversion refuses a disk that
        has fewer free.
    bytes_read, bytes_written : int
        Estimates of the bytes that go through.
    memory : int
        The most bytes of memory of the process, where the budget has as much; with less there are
        fewer threads, and fewer windows wait.
    memory_least : int
        The least budget, bytes, that the ordering stays inside of.
    seconds : float
        An estimate.
    """

    disk: int
    bytes_read: int
    bytes_written: int
    memory: int
    memory_least: int
    seconds: float


@dataclass(frozen=True)
class Plan:
    """Tells what a render takes: memory exactly, rays, bytes and seconds as estimates.

    Attributes
    ----------
    objects : int
        Objects of the scene.
    scene_bytes : int
        Bytes of the store, without marks.
    settings : dict
        The settings as in `bfrt.stats.Stats`, and the resolution, the number of views, the
        samples a pixel (0 for SPD's procedure) and the AOVs.
    rays_in_flight, candidates, hits, queue : int
        Rays in flight, their candidates, hits that wait for shading, and rays of the next depth
        that memory holds; more of the last two wait on disk.
    frame_on_disk : bool
        Whether the finished image is on disk, since memory cannot hold it.
    bands : int
        Bands of rows in which the frame is rendered.
    grids : tuple of GridPlan
        The grid of each group; none where rays go through treelets.
    tree : TreePlan, optional
        The treelets, where rays go through them.
    marks_reused : bool
        Whether all marks exist, so that there is no preprocess; false without grids.
    rays : RayPlan
        Rays to be traced.
    preprocess, tracing : PhasePlan
        The work of the preprocess, and of all other phases together.
    spool_bytes : int
        The most bytes that are written to spools, in all.
    disk : DiskPlan
        The most bytes on disk at once.
    ordering : OrderingPlan, optional
        What the store's twin in spatial order would take, where objects are stored as given.
    assumptions : Assumptions
        The numbers that the estimates are made with.
    """

    objects: int
    scene_bytes: int
    settings: dict[str, Any]
    rays_in_flight: int
    candidates: int
    hits: int
    queue: int
    frame_on_disk: bool
    bands: int
    grids: tuple[GridPlan, ...]
    tree: TreePlan | None
    marks_reused: bool
    rays: RayPlan
    preprocess: PhasePlan
    tracing: PhasePlan
    spool_bytes: int
    disk: DiskPlan
    ordering: OrderingPlan | None = None
    assumptions: Assumptions = ASSUMED

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as a dict, ready for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        """Return tables for people: amounts, grids, phases, and what ordering would take."""
        structure = _grids(self) if self.tree is None else _tree(self.tree)
        tables = [_amounts(self), structure, _phases(self)]
        if self.ordering is not None:
            tables.append(_ordering(self.ordering))
        return "\n\n".join([*map(aligned, tables), _assumed(self)])


Rows = Sequence[tuple[str, ...]]


def _amounts(plan: Plan) -> Rows:
    s = plan.settings
    samples = f"{s['samples']} samples" if s["samples"] else "a ray each corner"
    occlusion = f", ao {s['ao']}" if s["ao"] else ""
    pixels = "{} x {}".format(*s["resolution"])
    if s["views"] > 1:
        pixels = f"{s['views']} x {pixels}"
    image = "on disk" if plan.frame_on_disk else "in memory"
    return [
        ("what", "amount", "note"),
        ("objects", f"{plan.objects:,}", f"{_mb(plan.scene_bytes)} MB"),
        ("memory MiB", f"{s['memory'] / 2**20:,.1f}", f"{s['threads']} threads, {s['refine']}"),
        ("rays in flight", f"{plan.rays_in_flight:,}", "exact"),
        ("candidates", f"{plan.candidates:,}", "exact"),
        ("hits in memory", f"{plan.hits:,}", "exact"),
        ("queued in memory", f"{plan.queue:,}", "exact"),
        ("pixels", pixels, f"{samples}, depth {s['depth']}{occlusion}"),
        ("bands of rows", f"{plan.bands:,}", f"image {image}"),
        ("eye rays", f"{plan.rays.eye:,}", "exact"),
        ("other rays", f"{plan.rays.others:,}", "estimate"),
        ("", f"{plan.rays.others_most:,}", "at most"),
        ("MB to spool", _mb(plan.spool_bytes), "at most"),
        ("MB on disk", _mb(plan.disk.marks), "at most, marks to be made"),
        ("", _mb(plan.disk.frame), "exact, image"),
        ("", _mb(plan.disk.spools), "at most, spools"),
        *([("", _mb(plan.disk.checkpoint), "at most, checkpoint")] if plan.disk.checkpoint else []),
    ]  # fmt: skip


def _grids(plan: Plan) -> Rows:
    head = ("grid", "voxels", "lower", "blocks", "subspaces", "slabs", "marks", "MB of marks")
    return [head] + [
        (
            str(number),
            "{} x {} x {}".format(*grid.voxels),
            str(grid.lower),
            f"{grid.blocks:,}",
            f"{grid.subspaces:,}",
            f"{'' if grid.slabs_known else '<= '}{grid.slabs}",
            "there" if grid.marks_there else "to make",
            f"{'' if grid.marks_there else '<= '}{_mb(grid.marks_bytes)}",
        )
        for number, grid in enumerate(plan.grids)
    ]


def _tree(tree: TreePlan) -> Rows:
    where = "in memory" if tree.resident else "streamed"
    return [
        ("treelets", "nodes", "MB", "where"),
        (f"{tree.treelets:,}", f"{tree.nodes:,}", _mb(tree.bytes), where),
    ]


def _phases(plan: Plan) -> Rows:
    return [("phase", "passes", "MB read", "at least", "at most", "seconds")] + [
        (
            name,
            f"{phase.passes:,}",
            _mb(phase.bytes_read),
            _mb(phase.bytes_least),
            _mb(phase.bytes_most),
            f"{phase.seconds:.2f}",
        )
        for name, phase in (("preprocess", plan.preprocess), ("tracing", plan.tracing))
    ]


def _ordering(ordering: OrderingPlan) -> Rows:
    return [
        ("spatial order", "MB on disk", "MB read", "MB written", "memory MiB", "seconds"),
        (
            "to make",
            f"<= {_mb(ordering.disk)}",
            _mb(ordering.bytes_read),
            _mb(ordering.bytes_written),
            f"{ordering.memory_least / 2**20:,.0f} to {ordering.memory / 2**20:,.0f}",
            f"{ordering.seconds:.2f}",
        ),
    ]


def _assumed(plan: Plan) -> str:
    a = plan.assumptions
    told = (
        f"estimates assume {a.read_rate / 1e6:,.0f} MB/s; a thread's {a.mark_rate:,.0f} objects "
        f"marked,\n{a.ray_rate:,.0f} rays and {a.test_rate:,.0f} box tests a second; "
        f"{a.tests:.0f} box tests a ray"
    )
    if plan.ordering is not None:
        told += f";\na thread's {a.order_rate:,.0f} objects a second on their way into order"
    return told


def _mb(amount: float) -> str:
    return f"{amount / 1e6:,.1f}"
