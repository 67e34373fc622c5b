"""Commands that are ended at any moment: what they leave, and what the next run makes of it."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import bfrt
from bfrt.streams.ownership import parsed

PROC = Path("/proc/self/status")
pytestmark = [
    pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here"),
    pytest.mark.skipif(not PROC.exists(), reason="what a process listens to cannot be seen here"),
]

#: What the command says of a signal, and its exit status.
ENDINGS = {
    signal.SIGINT: ("bfrt: interrupted\n", 130),
    signal.SIGTERM: ("bfrt: terminated\n", 143),
    signal.SIGHUP: ("bfrt: hung up\n", 129),
}

SMALL = ("--resolution", "150", "150", "--threads", "2", "--quiet", "--memory")

#: With little memory rays and hits are spooled.
SPOOLED = ("--refine", "sgb", "--fresh-marks")

#: Commands, in a folder that has `points.npy` and `rings.bfrt`; and what each makes.
COMMANDS = {
    "convert": (
        ("convert", "points.npy", "-o", "new.bfrt", "--radius", "1", "--order", "given", "--quiet"),
        "new.bfrt",
    ),
    "replace": (
        ("convert", "points.npy", "-o", "old.bfrt", "--radius", "1", "--order", "given", "--quiet"),
        "old.bfrt",
    ),
    "order": (
        ("convert", "points.npy", "-o", "new.bfrt", "--radius", "1", "--order", "spatial",
         "--quiet"),
        "new.bfrt",
    ),
    "render": (
        ("render", "rings.bfrt", "-o", "x.png", *SPOOLED, *SMALL, "70MiB"),
        "x.png",
    ),
    "render of a file": (("render", "spd:rings:12", "-o", "x.png", *SMALL, "128MiB"), "x.png"),
    "verify": (("verify", "rings.bfrt", "--quiet"), None),
    "text": (("spd", "rings", "14", "--nff", "x.nff", "--quiet"), "x.nff"),
}  # fmt: skip


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    """The folder in which commands begin."""
    folder = tmp_path_factory.mktemp("before")
    rng = np.random.default_rng(1)
    np.save(folder / "points.npy", rng.random((400_000, 3), np.float32) * 1000)
    bfrt.spd.rings(12).write(folder / "rings.bfrt", order="given")
    bfrt.spd.tetra(1).write(folder / "old.bfrt")
    return folder


def start(folder, name):
    return subprocess.Popen(
        [sys.executable, "-m", "bfrt", *COMMANDS[name][0]],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        # Where the tests run in a shell's background interrupts are ignored, by children too.
        preexec_fn=lambda: [signal.signal(number, signal.SIG_DFL) for number in ENDINGS],
    )


def wait_until_it_listens(command):
    """Wait until a command has its handlers; before that Python itself is starting."""
    status = Path(f"/proc/{command.pid}/status")
    deadline = time.monotonic() + 30
    while command.poll() is None:
        caught = status.read_text().split("SigCgt:")[1].split()[0]
        if int(caught, 16) >> (signal.SIGHUP - 1) & 1:
            return
        assert time.monotonic() < deadline
        time.sleep(0.002)


def contents(path):
    """What a store or a file holds, but for what was measured, and what is temporary."""
    if path.is_file():
        return path.read_bytes()
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in path.rglob("*")
        if file.is_file() and file.name not in ("made.json", "marks") and not parsed(file.name)
    }


def temporary(folder):
    return [path for path in folder.rglob("*") if parsed(path.name)]


@pytest.fixture(scope="module")
def whole(before, tmp_path_factory):
    """Of each command the seconds that it takes once it listens, and what it makes."""
    found = {}

    def of(name):
        if name not in found:
            folder = tmp_path_factory.mktemp("whole") / "work"
            shutil.copytree(before, folder)
            command = start(folder, name)
            wait_until_it_listens(command)
            begun = time.monotonic()
            assert command.communicate(timeout=100) == (None, "")
            assert command.returncode == 0 and temporary(folder) == []
            made = COMMANDS[name][1]
            result = None if made is None else contents(folder / made)
            found[name] = time.monotonic() - begun, result
            shutil.rmtree(folder)
        return found[name]

    return of


def each(names, count, few):
    """Return parameters: each name so many times, of which all but a few are slow."""
    return [
        pytest.param(name, seed, marks=[pytest.mark.slow] if seed >= few else [])
        for name in names
        for seed in range(count)
    ]


@pytest.mark.parametrize(
    ("name", "seed"), each(["convert", "replace", "order", "render", "render of a file"], 30, 1)
)
def test_the_run_after_a_killed_one_leaves_no_litter(before, whole, tmp_path, name, seed):
    seconds, expected = whole(name)
    folder = tmp_path / "work"
    shutil.copytree(before, folder)
    command = start(folder, name)
    wait_until_it_listens(command)
    time.sleep(random.Random(f"{name} {seed}").uniform(0, seconds))
    command.kill()
    command.communicate()
    assert contents(folder / "rings.bfrt") == contents(before / "rings.bfrt")
    if name == "replace":  # never neither
        assert contents(folder / "old.bfrt") in (contents(before / "old.bfrt"), expected)
        bfrt.open(folder / "old.bfrt").verify()
    again = start(folder, name)
    assert again.communicate(timeout=100) == (None, "")
    assert again.returncode == 0
    assert temporary(folder) == []
    made = COMMANDS[name][1]
    assert contents(folder / made) == expected
    assert sorted(os.listdir(folder)) == sorted({*os.listdir(before), made})  # noqa: PTH208


@pytest.mark.parametrize(
    ("name", "seed"),
    each(["convert", "replace", "order", "render", "render of a file", "verify", "text"], 15, 1),
)
def test_two_signals_leave_one_line_and_nothing_else(before, whole, tmp_path, name, seed):
    seconds, expected = whole(name)
    folder = tmp_path / "work"
    shutil.copytree(before, folder)
    rng = random.Random(f"{name} {seed}")
    first, second = rng.choices(list(ENDINGS), k=2)
    command = start(folder, name)
    wait_until_it_listens(command)
    time.sleep(rng.uniform(0, seconds))
    command.send_signal(first)
    begun = time.monotonic()
    time.sleep(rng.uniform(0.001, 0.5))
    command.send_signal(second)
    _, said = command.communicate(timeout=100)
    assert time.monotonic() - begun < 2.5  # a second, and what a busy machine adds
    assert (said, command.returncode) in (ENDINGS[first], ("", 0))
    assert temporary(folder) == []
    made = COMMANDS[name][1]
    if made is not None and (folder / made).exists():
        now = contents(folder / made)
        assert now == expected or (name == "replace" and now == contents(before / made))
    assert set(os.listdir(folder)) <= {*os.listdir(before), made}  # noqa: PTH208
