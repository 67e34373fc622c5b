"""Whatever call fails: the right result, or one error of ours, and nothing half there."""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest
from faults import shim, trial
from faults.run import told_of
from faults.shim import FAMILIES, FAULTS, Fault
from faults.trial import Expected, Outcome, misplaced, unfit
from faults.work import Work
from faults.works import WORKS

from bfrt.errors import ResourceError, StreamError

#: Works of the short run, which between them read and write in every way, and places a fault.
SAMPLED = (
    "convert obj", "render by a grid, spooled",
    "list_intersections, spooled", "save exr", "render by treelets, resumed",
    "cast_rays, past the cache",
)  # fmt: skip
PLACES = 1


def check(told):
    wrong = [line for each in told for line in each["wrong"]]
    assert not wrong, "\n".join(wrong)
    found = Counter()
    for each in told:
        for fault, outcomes in each["counts"].items():
            found.update({fault.split()[0]: sum(outcomes.values())})
    return found


def direct_reads(folder):
    """Whether files there are read past the system's cache."""
    path = folder / "direct"
    path.touch()
    try:
        os.close(os.open(path, os.O_RDONLY | os.O_DIRECT))
    except OSError:
        return False
    return True


def test_some_calls_of_every_kind(tmp_path):
    found = check(told_of(tmp_path, PLACES, SAMPLED))
    seldom = {"truncate"} if direct_reads(tmp_path) else {"truncate", "aio"}
    assert {family for family in FAMILIES if found[family]} >= set(FAMILIES) - seldom


@pytest.mark.slow
@pytest.mark.parametrize("work", WORKS)
def test_every_call(tmp_path, work):
    assert sum(check(told_of(tmp_path, 0, [work])).values()) > 100


# --- what is found wrong -------------------------------------------------------------------------


BEFORE = {"in/a": "1", "out/b": "2", "out/c": "3", "out/c/d": "4"}
AFTER = {"in/a": "1", "out/b": "9", "out/c": "3", "out/c/d": "8", "out/e": "5", "out/e/f": "6"}


@pytest.mark.parametrize(
    ("found", "done", "wrong"),
    [
        (AFTER, True, ""),
        (BEFORE, True, "differing"),
        ({**AFTER, "tmp/x": "7"}, True, "differing"),
        (BEFORE, False, ""),
        (AFTER, False, ""),
        ({**BEFORE, "out/b": "9"}, False, ""),
        ({**BEFORE, "out/b": "1"}, False, "half: out/b"),
        ({**BEFORE, "out/e": "5"}, False, "half: out/e"),
        ({**BEFORE, "out/.e.part": "5"}, False, "left: out/.e.part"),
        ({key: value for key, value in BEFORE.items() if key != "out/b"}, False, "half: out/b"),
    ],
)
def test_what_is_left_is_seen(found, done, wrong):
    expected = Expected(BEFORE, AFTER, "", {}, [])
    assert misplaced(found, expected, done=done).startswith(wrong)
    assert bool(misplaced(found, expected, done=done)) == bool(wrong)


@pytest.mark.parametrize(
    ("error", "wrong"),
    [
        (OSError(errno.EIO, "bare"), "OSError"),
        (MemoryError(), "MemoryError"),
        (ResourceError(""), "ResourceError of no sentence"),
        (ResourceError("a: found no memory"), ""),
        (StreamError("a", 3, errno.EIO, "reading"), ""),
    ],
)
def test_an_exception_that_is_not_ours_is_seen(error, wrong):
    assert unfit(error).startswith(wrong)
    assert bool(unfit(error)) == bool(wrong)


def test_a_child_that_died_counts_as_one_that_was_hit():
    assert Outcome({}, "", "hangs").was_hit(FAULTS[0], 3)
    assert not Outcome({"open": 2}, "", "").was_hit(Fault("open", errno.EIO), 3)


class Unarmed:
    """Stands for the shim, and knows whether a call is to fail."""

    asked = shim.NEVER

    def arm(self, fault, n):
        self.asked = n

    def disarm(self):
        pass

    def counts(self):
        return dict.fromkeys(FAMILIES, 9)


def test_a_child_that_hangs_is_ended_and_tells_where(tmp_path, monkeypatch):
    refuser = Unarmed()

    def waiting_for_ever(_):
        if refuser.asked != shim.NEVER:
            time.sleep(60)
        return b""

    monkeypatch.setattr(trial, "PATIENCE", 1)
    monkeypatch.setitem(WORKS, "hang", Work(lambda _: None, waiting_for_ever))
    trials = trial.Trials(refuser, tmp_path)
    outcome = trials.run("hang", FAULTS[0], 3, trials.prepare("hang"))
    assert outcome.wrong.startswith("hangs: ")
    assert "in waiting_for_ever" in outcome.wrong


def test_a_child_that_is_stopped_with_this_process_does_not_hang(tmp_path):
    """Nothing runs meanwhile: what is stopped is a process that waits for its own child."""
    code = (
        "import os, sys, time; sys.path.insert(0, sys.argv[1]); from faults import trial\n"
        "trial.PATIENCE = 3\n"
        "child = os.fork()\n"
        "if not child: time.sleep(1.5); os._exit(0)\n"
        "print(child, flush=True); print(trial.ended_in_time(child))"
    )
    waiting = subprocess.Popen(
        [sys.executable, "-c", code, str(Path(__file__).parents[1])],
        cwd=tmp_path, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    both = (int(waiting.stdout.readline()), waiting.pid)
    for process in both:
        os.kill(process, signal.SIGSTOP)
    time.sleep(5)
    for process in both:
        os.kill(process, signal.SIGCONT)
    assert waiting.communicate(timeout=30)[0] == "True\n"


def test_the_shim_has_all_families(tmp_path):
    library = ctypes.CDLL(str(shim.built(tmp_path)))
    library.fault_count.restype = ctypes.c_long
    assert [library.fault_count(k) for k in range(len(FAMILIES))] == [0] * len(FAMILIES)
    assert {fault.family for fault in FAULTS} == set(FAMILIES)
