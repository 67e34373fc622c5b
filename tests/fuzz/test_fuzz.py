"""A short run of every harness, the same each time: success or one error of ours, nothing left."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fuzz import alone, readers
from fuzz.folders import in_memory
from fuzz.harnesses import HARNESSES
from fuzz.mutator import FilesMutator, Mutator
from fuzz.packing import packed, unpacked
from fuzz.trial import Finding, Trials, of_bytes

from bfrt.errors import ResourceError, SceneError
from bfrt.records import Kind

COMMAND = Path(__file__).with_name("fuzz.py")

#: Inputs of a harness in the short run, and in the long one; and the seconds that they may take.
FEW, MANY = 30, 10_000
SECONDS = {FEW: 120, MANY: 7200}


def fuzzed(folder: Path, *asked: str, seconds: int) -> list[dict]:
    """What the command tells of each harness, which is run in a process of its own."""
    paths = filter(None, [os.environ.get("PYTHONPATH")])
    done = subprocess.run(
        [sys.executable, COMMAND, *asked, "--keep", folder / "findings"],
        cwd=folder, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True, text=True, timeout=seconds, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (folder / "findings").exists()
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_some_inputs(tmp_path):
    asked = ("all", "--engine", "own", f"--inputs={FEW}")
    told = fuzzed(tmp_path, *asked, seconds=SECONDS[FEW])
    assert [each["harness"] for each in told] == [*HARNESSES]
    for each in told:
        assert each["inputs"] == sum(each["outcomes"].values()) == FEW
        assert len(each["outcomes"]) > 1, "all inputs end in the same way"


def test_readers_alone_make_no_store(tmp_path):
    """They tell the same of an input as a conversion, but for what is done with the store."""
    alone, whole = (
        fuzzed(tmp_path, "stl", "--engine", "own", "--inputs=99", *more, seconds=SECONDS[FEW])
        for more in (["--alone"], [])
    )
    assert alone[0]["outcomes"] == whole[0]["outcomes"]
    assert len(alone[0]["outcomes"]) > 1


@pytest.mark.slow
@pytest.mark.parametrize("name", HARNESSES)
def test_many_inputs(tmp_path, name):
    asked = (name, "--engine", "own", f"--inputs={MANY}", "--seed", "1")
    (told,) = fuzzed(tmp_path, *asked, seconds=SECONDS[MANY])
    assert told["outcomes"]["success"] > MANY // 100


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stl", "checkpoint"])
def test_inputs_of_atheris(tmp_path, name):
    if importlib.util.find_spec("atheris") is None:
        pytest.skip("atheris is not installed")
    asked = (name, "--engine", "atheris", "--inputs=300", "--corpus", "kept")
    assert fuzzed(tmp_path, *asked, seconds=600)[0]["inputs"] == 300
    assert len(list((tmp_path / "kept").iterdir())) > 3


#: Harnesses whose inputs say themselves what is done with them.
SETTINGS_IN_INPUT = ("rays", "store", "checkpoint")

#: Of stores, a query of some does not fit, as of one without marks: those that succeed are most.
LEAST_SHARE = {"store": 0.75}


@pytest.mark.parametrize("name", HARNESSES)
def test_seeds_are_right(name, monkeypatch):
    """Each succeeds unchanged, by one at least of the settings that there are for its format."""
    right = 0
    with in_memory(name) as folder:
        harness = HARNESSES[name](folder)
        for seed in harness.seeds:
            trials = Trials(harness, folder)
            for chosen in range(readers.CHOICES if name not in SETTINGS_IN_INPUT else 1):
                monkeypatch.setattr(readers, "choice", lambda _, chosen=chosen: chosen)
                trials.try_one(seed)
                if trials.outcomes["success"]:
                    break
            right += trials.outcomes["success"]
    assert right >= LEAST_SHARE.get(name, 1.0) * len(harness.seeds)


# --- what is found -------------------------------------------------------------------------------


def leaving(part: str):
    def run(_: bytes, folder: Path) -> None:
        (folder / part / ".a.bfrt-0.part").mkdir()
        raise SceneError("a.ply: found nothing, expected a scene")

    return run


def raising(error: Exception):
    def run(_: bytes, folder: Path) -> None:
        raise error

    return run


@pytest.mark.parametrize(
    ("run", "kind", "words"),
    [
        (leaving("in"), Finding, r"left: \['in/.a.bfrt-0.part'\]"),
        (leaving("out"), Finding, r"left: \['out/.a.bfrt-0.part'\]"),
        (leaving("tmp"), Finding, "left: "),
        (raising(IndexError("3")), IndexError, "3"),
        (raising(MemoryError()), MemoryError, "^$"),
        (raising(ResourceError("a: found no memory")), Finding, "asked for too much"),
        (raising(SceneError("")), Finding, "expected a sentence"),
    ],
)
def test_what_is_wrong_is_found(tmp_path, run, kind, words):
    trials = Trials(of_bytes([b"seed"], (), run), tmp_path)
    with pytest.raises(kind, match=words):
        trials.try_one(b"an input")
    assert (tmp_path / "current").read_bytes() == b"an input"
    assert not trials.outcomes


@pytest.mark.parametrize(
    ("records", "materials"),
    [(np.zeros((3, 9)), [0, 0]), (np.zeros((3, 8)), [0] * 3), (np.zeros((1, 9), int), [0]),
     (np.zeros((1, 9)), [1])],
)  # fmt: skip
def test_what_a_reader_may_not_give_a_sink_is_found(records, materials):
    sink = alone.Checked()
    sink.append(Kind.TRIANGLE, np.zeros((2, 9)), np.array([sink.material("plain")] * 2))
    with pytest.raises(AssertionError):
        sink.append(Kind.TRIANGLE, records, np.array(materials))


def test_files_that_stay_open_are_found(tmp_path):
    held = []

    def run(_: bytes, folder: Path) -> None:
        held.append((folder / "in" / "a").open("w"))

    with pytest.raises(Finding, match="open files"):
        Trials(of_bytes([b"seed"], (), run), tmp_path).try_one(b"an input")
    held.pop().close()


def test_an_input_that_hangs_ends_the_process(tmp_path):
    """Also where it does not come back to Python."""
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parents[1])!r}); "
        "import ctypes; from pathlib import Path; from fuzz import trial; trial.PATIENCE = 1; "
        "wait = lambda *_: ctypes.PyDLL(None).sleep(60); "
        "trial.Trials(trial.of_bytes([b'x'], (), wait), Path.cwd()).try_one(b'x')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=50,
        check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "Timeout" in done.stderr and "try_one" in done.stderr
    assert (tmp_path / "current").read_bytes() == b"x"


# --- how inputs are made -------------------------------------------------------------------------


def test_inputs_of_a_key_are_the_same_and_others_differ():
    seeds = [b"ply\nformat ascii 1.0\nelement vertex 12\n" * 3, bytes(range(256))]
    made = [Mutator(seeds, (b"end_header",)).made(f"ply 0 {n}") for n in range(300)]
    assert made == [Mutator(seeds, (b"end_header",)).made(f"ply 0 {n}") for n in range(300)]
    assert len(set(made)) > 290
    assert sum(b"end_header" in data for data in made) > 10
    assert {len(data) for data in made} > {len(seeds[0]), len(seeds[1])}


def test_a_change_of_several_files_is_mostly_of_one_and_keeps_sizes():
    names = ["a.json", "b", "c"]
    files = {"a.json": b"[1, 2, 3]" * 9, "b": bytes(99), "c": bytes(50)}
    seed = b"\1\2" + packed(files, names)
    mutator = FilesMutator([seed], (), names, 2)
    same = one = 0
    for n in range(300):
        found = unpacked(mutator.made(str(n))[2:], names)
        same += all(len(found.get(name, b"")) == len(files[name]) for name in ("b", "c"))
        one += sum(found.get(name) != files[name] for name in names) <= 1
    assert same > 200 and one > 250


@pytest.mark.parametrize("data", [b"", b"\0", b"\7\xff\xff\xff\xffabc", bytes(23)])
def test_any_bytes_are_files(data):
    assert all(name in ("a", "b") for name in unpacked(data, ["a", "b"]))


def test_files_are_packed_and_unpacked():
    files = {"b": b"123", "a": b"", "c": bytes(300)}
    assert unpacked(packed(files, ["a", "b", "c"]), ["a", "b", "c"]) == files
