"""The command that runs all that takes long: it sums up, and tells of what went wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import stress

ROOT = Path(__file__).parent.parent


def test_what_steps_run_is_there():
    for quick in (True, False):
        for step in stress.steps(quick, 1).values():
            for word in step.command:
                assert not word.startswith("tests/") or (ROOT / word).exists(), word


def test_all_rooms_that_have_loops_in_c_are_looked_at():
    rooms = {path.relative_to(ROOT / "bfrt").parts[0] for path in ROOT.glob("bfrt/*/**/*.pyx")}
    assert {f"tests/{room}" for room in rooms if (ROOT / "tests" / room).is_dir()} <= {
        *stress.ROOMS
    }


def test_the_exceptions_of_libraries_are_thrown_on_the_sanitizer_build(tmp_path):
    """AddressSanitizer has to find the function that throws them before Python is there."""
    loaded = stress.environment(tmp_path, sanitized=True)["LD_PRELOAD"].split()
    assert [Path(path).name for path in loaded] == ["libasan.so", "libstdc++.so"]
    assert all(Path(path).is_file() for path in loaded)


@pytest.mark.parametrize("quick", [True, False])
def test_slow_tests_are_run_unless_it_is_quick(quick):
    assert ("slow or not slow" in stress.steps(quick, 1)["kills"].command) != quick


def test_counts_of_faults_are_summed_up(tmp_path):
    said = "call, faults, refused, succeeded, wrong\nopen, 5, 3, 2, 0\nread, 7, 4, 2, 1\n"
    assert stress.faults_told(said, tmp_path) == "12 faults: 7 refused, 4 succeeded, 1 wrong"


def test_counts_of_inputs_are_summed_up(tmp_path):
    told = [{"harness": "ply", "inputs": 7, "findings": ["x"]},
            {"harness": "stl", "inputs": 5, "findings": []}]  # fmt: skip
    said = "\n".join(map(json.dumps, told))
    assert stress.inputs_told(said, tmp_path) == "12 inputs (ply 7, stl 5), 1 found"


@pytest.mark.parametrize(("status", "word"), [(0, "ok"), (3, "FAILED")])
def test_a_step_that_fails_is_told(capsys, status, word):
    step = stress.Step(["-c", f"print('hello'); raise SystemExit({status})"], lambda said, _: said)
    assert stress.done("a step", step) == (status == 0)
    assert capsys.readouterr().out.startswith(f"a step           {word:8} hello")


def test_a_test_that_fails_is_counted(tmp_path, capsys):
    file = tmp_path / "test_two.py"
    file.write_text("def test_one():\n    pass\n\n\ndef test_two():\n    assert 0\n")
    assert not stress.done("tests", stress.testing(str(file), quick=True))
    assert "2 tests, 1 failed" in capsys.readouterr().out


def test_a_step_that_is_none(tmp_path):
    asked = [sys.executable, Path(stress.__file__), "kill"]
    ended = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "found kill, expected some of kills, faults" in ended.stderr
