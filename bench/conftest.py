"""The suite's profiles, its stores, and cases that run cold in a process under a cap."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from capped import CAP, drop, how_capped, run_capped
from profiles import ROUNDS, SIZES
from stores import made


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--size", choices=tuple(SIZES), default="quick", help="of the scenes")
    parser.addoption("--folder", type=Path, help="where stores are made, with room for one")


def pytest_xdist_auto_num_workers() -> int:
    """Have cases run one after the other, as what they measure demands."""
    return 0


@pytest.fixture(scope="session")
def profile(request: pytest.FixtureRequest) -> str:
    return str(request.config.getoption("--size"))


@pytest.fixture(scope="session")
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    given = request.config.getoption("--folder")
    return Path(given) if given else tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="session")
def standard(folder: Path, profile: str) -> Iterator[Callable[..., Path]]:
    """Makes a standard scene's store of this profile; one is on disk at a time."""
    there: list[Path] = []

    def make(name: str, order: str = "given") -> Path:
        if name not in SIZES[profile]:
            pytest.skip(f"no {name} in profile {profile}")
        path = folder / f"{name}{SIZES[profile][name]}.{order}.bfrt"
        if there != [path]:
            while there:
                shutil.rmtree(there.pop())
            there.append(made(name, SIZES[profile][name], folder, order))
        return path

    yield make
    for path in there:
        shutil.rmtree(path)


@pytest.fixture
def case(benchmark: Any, folder: Path, profile: str) -> Callable[..., dict[str, Any]]:
    """Runs a case of case.py in turns, each cold and capped; its facts go into the JSON."""

    def run(what: str, files: list[Path], cap: int = CAP, **settings: Any) -> dict[str, Any]:
        facts = folder / "facts.json"
        script = str(Path(__file__).with_name("case.py"))
        peaks, digests = [], set()
        found: dict[str, Any] = {}

        def cold() -> None:
            for file in files:
                drop(file)

        def once() -> None:
            nonlocal found
            status, peak = run_capped([script, what, json.dumps(settings), str(facts)], cap)
            assert status == 0, f"{what} {settings}: exit status {status}, peak {peak >> 20} MiB"
            found = json.loads(facts.read_text())
            peaks.append(peak)
            digests.add(found["digest"])

        benchmark.pedantic(once, setup=cold, rounds=ROUNDS[profile])
        assert len(digests) == 1, f"{what} {settings}: found answers that differ: {digests}"
        found["peak_bytes"] = max(peaks)
        found["cap"] = f"{cap >> 20} MiB by {how_capped()}"
        benchmark.extra_info.update(found)
        return found

    return run
