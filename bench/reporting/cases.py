"""The cases of a report: each is a script of bench/ with its arguments, and the least size at which
it is run. A larger size runs all that a smaller one does."""

from __future__ import annotations

from typing import NamedTuple

from reporting.kinds import KINDS

#: From minutes to as long as it takes; the last needs 41 GB of disk.
SIZES = ("quick", "large", "huge")

#: Those that are told the Pythons that have the peers.
WITH_PEERS = ("peers", "steady", "particles")


class Case(NamedTuple):
    """One run of a script, whose rows are saved together."""

    kind: str
    arguments: str
    size: str

    @property
    def name(self) -> str:
        """The command without what differs from machine to machine: its name in the JSON."""
        return f"{KINDS[self.kind].script} {self.arguments}".strip()

    @property
    def words(self) -> list[str]:
        return self.name.split()


def _caps(kind: str, size: str, millions: int, caps: str) -> list[Case]:
    return [Case(kind, f"--millions {millions} --caps {cap}", size) for cap in caps.split()]


def _each(kind: str, size: str, arguments: str) -> list[Case]:
    return [Case(kind, argument, size) for argument in arguments.split()]


def _table1(size: str, scenes: str) -> list[Case]:
    return [Case("refinements", f"--scenes {scene}", size) for scene in scenes.split()]


def _partitions(kind: str, size: str, scenes: str, runs: int) -> list[Case]:
    return [Case(kind, f"--scenes {scene} --runs {runs}", size) for scene in scenes.split()]


QUICK = [
    *_caps("peers", "quick", 1, "256MiB 1GiB"),
    *_caps("peers", "quick", 4, "256MiB 1GiB"),
    *_caps("particles", "quick", 1, "1GiB"),
    Case("renderers", "rings 36 --runs 1", "quick"),
    *_table1("quick", "balls:6 gears:18 mount:9 rings:36 teapot:124 tetra:9 tree:17"),
    *_partitions("tracing", "quick", "rings:20 rings:36", 3),
    *_partitions("growth", "quick", "rings:20 rings:36", 1),
    *_each("budgets", "quick", "rings:36"),
    Case("steady", "--runs 3", "quick"),
    *_each("loaded", "quick", "1000000"),
    *_each("tree", "quick", "rings:36 mount:9"),
    *_each("random", "quick", "1000000"),
    Case("ordering", "sphere local 1000000", "quick"),
    Case("ordering", "sphere random 1000000", "quick"),
    Case("stadium", "--size 20", "quick"),
    Case("points", "--points 1000000", "quick"),
    Case("terrain", "--sides 1000", "quick"),
    Case("checkpoints", "rings:36 --every 1 --runs 1", "quick"),
    Case("cluster", "--scene rings:36 --pixels 256 --rays 200000 --runs 1", "quick"),
]

LARGE = [
    *_caps("peers", "large", 1, "4GiB 18GiB"),
    *_caps("peers", "large", 4, "4GiB 18GiB"),
    *_caps("peers", "large", 16, "256MiB 1GiB 4GiB 18GiB"),
    *_caps("peers", "large", 64, "256MiB 18GiB"),
    *_caps("particles", "large", 4, "256MiB 1GiB 4GiB"),
    *_caps("particles", "large", 16, "256MiB 4GiB"),
    Case("renderers", "balls 6 --runs 3 --memory 175MiB", "large"),
    Case("renderers", "mount 9 --runs 3 --memory 140MiB", "large"),
    Case("renderers", "teapot 124 --runs 1", "large"),
    *_table1("large", "mount:10 mount:11 tetra:10 tetra:11 tree:19 tree:21 balls:7 rings:94"),
    *_table1("large", "balls:8 mount:12 rings:135 teapot:877 tetra:12 tree:23"),
    Case("refinements", "--scenes mount:12 --disk 200MB", "large"),
    Case("refinements", "--scenes tetra:12 --disk 200MB", "large"),
    *_partitions("tracing", "large", "rings:94 rings:135 rings:200", 3),
    *_partitions("growth", "large", "rings:94 balls:6 balls:7 mount:9 mount:10 mount:11", 1),
    *_partitions("growth", "large", "tetra:9 tetra:11 tetra:12 tree:17 tree:19 tree:21", 1),
    *_partitions("levels", "large", "rings:94 tetra:12 tree:21", 3),
    *_each("budgets", "large", "rings:94"),
    *_each("tree", "large", "rings:135 mount:12 tetra:12 tree:23"),
    *_each("random", "large", "16000000"),
    Case("ordering", "sphere local 8000000", "large"),
    Case("ordering", "sphere random 8000000", "large"),
    Case("stadium", "--size 30 --runs 3", "large"),
    Case("points", "--points 10000000", "large"),
    Case("terrain", "--sides 5000", "large"),
    Case("checkpoints", "rings:94 --every 60 5", "large"),
    Case("cluster", "", "large"),
]

HUGE = [
    *_caps("peers", "huge", 64, "1GiB 4GiB"),
    *_caps("particles", "huge", 16, "1GiB 18GiB"),
    *_caps("particles", "huge", 64, "256MiB"),
    Case("renderers", "gears 18 --runs 1", "huge"),
    *_table1("huge", "gears:49 gears:61 gears:69 rings:118 teapot:516 teapot:719"),
    *_partitions("levels", "huge", "balls:7 gears:49 mount:11 teapot:300", 3),
    *_partitions("growth", "huge", "gears:18 gears:30 teapot:124 teapot:300", 1),
    *_partitions("tracing", "huge", "rings:368", 3),
    *_each("tree", "huge", "balls:8 gears:69 teapot:877"),
    Case("billion", "mount:14", "huge"),
    Case("billion", "rings:368 --views rings368m", "huge"),
]


CASES = [*QUICK, *LARGE, *HUGE]


def cases_of(size: str, kinds: list[str]) -> list[Case]:
    """Those of a size and of all smaller ones, of some kinds or of all."""
    sizes = SIZES[: SIZES.index(size) + 1]
    return [case for case in CASES if case.size in sizes and case.kind in (kinds or KINDS)]
