"""A signal to end ends the command whenever it comes: in one sentence, with its status."""

import io
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bfrt import process
from bfrt.process import Interrupts

PROJECT = Path(__file__).parent.parent / "pyproject.toml"

#: Interrupts the command when it looks for a module, as a part of Python's own start.
WHEN_IMPORTED = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
"""

#: Interrupts it where a module that Cython made has a bare ``except``.
WHEN_REGISTERED = """
import abc, os, signal

register = abc.ABCMeta.register

def interrupted(cls, made):
    if made.__name__ == "_memoryviewslice":
        os.kill(os.getpid(), signal.SIGINT)
    return register(cls, made)

abc.ABCMeta.register = interrupted
"""

#: Interrupts it when it has ended, and Python ends.
AT_EXIT = """
import atexit, os, signal

atexit.register(os.kill, os.getpid(), signal.SIGINT)
"""

#: What takes long: nothing else is wrong with it.
LONG = ("spd", "rings", "60", "--nff", "o.nff")


MODULE = ("-m", "bfrt")

#: What the script does that is installed.
SCRIPT = re.search(r'^bfrt = "(\S+):(\S+)"$', PROJECT.read_text(), re.MULTILINE).expand(
    r"import sys; from \1 import \2; sys.exit(\2())"
)


def started(folder, *arguments, at_start="", how=MODULE):
    """Start the command in a folder, with code that Python runs at its own start."""
    (folder / "start").mkdir()
    (folder / "start" / "sitecustomize.py").write_text(at_start)
    (folder / "work").mkdir()
    paths = [str(folder / "start"), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, *how, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder / "work",
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        # Where the tests run in a shell's background interrupts are ignored, by children too.
        preexec_fn=hear_all,
    )


def hear_all():
    for number in ENDINGS:
        signal.signal(number, signal.SIG_DFL)


#: The signals, what the command says, and its exit status.
ENDINGS = {
    signal.SIGINT: ("bfrt: interrupted\n", 130),
    signal.SIGTERM: ("bfrt: terminated\n", 143),
    signal.SIGHUP: ("bfrt: hung up\n", 129),
}


def ended(process):
    _, said = process.communicate(timeout=60)
    return process.returncode, said


NAMES = [
    "__future__", "bfrt.version", "bfrt.process", "bfrt.cli", "numpy", "numpy.linalg",
    "bfrt.streams.reader",
]  # fmt: skip


@pytest.mark.parametrize("how", [MODULE, ("-c", SCRIPT)], ids=["module", "script"])
@pytest.mark.parametrize("name", NAMES)
def test_an_interrupt_while_a_module_is_imported(tmp_path, name, how):
    at_start = WHEN_IMPORTED.format(name=name)
    command = started(tmp_path, *LONG, at_start=at_start, how=how)
    assert ended(command) == (130, "bfrt: interrupted\n")
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.parametrize("name", ["bfrt.version", "bfrt.process", "bfrt.cli"])
def test_interrupts_one_upon_the_other_while_modules_are_imported(tmp_path, name):
    """Nothing of the first is left that a second could disturb."""
    one = "os.kill(os.getpid(), signal.SIGINT)"
    at_start = WHEN_IMPORTED.format(name=name).replace(one, "for _ in range(9): " + one)
    command = started(tmp_path, *LONG, at_start=at_start)
    assert ended(command) == (130, "bfrt: interrupted\n")


def test_a_program_that_imports_the_library_keeps_its_own_interrupts(tmp_path):
    """Also one that ``python -m`` starts, whose package imports it."""
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "__init__.py").write_text("import bfrt\n")
    (tmp_path / "own" / "__main__.py").write_text(
        "import signal\nprint(signal.getsignal(signal.SIGINT).__name__)\n"
    )
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-m", "own"], capture_output=True, text=True, preexec_fn=hear_all,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, check=True,
    )  # fmt: skip
    assert done.stdout == "default_int_handler\n"


def test_an_interrupt_that_cython_would_swallow(tmp_path):
    command = started(tmp_path, *LONG, at_start=WHEN_REGISTERED)
    assert ended(command) == (130, "bfrt: interrupted\n")


def test_an_interrupt_while_an_optional_package_is_imported(tmp_path):
    """The command has begun, and imports what reads a kind of file."""
    laspy = pytest.importorskip("laspy")
    scan = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    scan.x = scan.y = scan.z = np.arange(1_000_000)
    scan.write(tmp_path / "a.las")
    command = started(
        tmp_path,
        *("convert", str(tmp_path / "a.las"), "-o", "a.bfrt", "--radius", "1"),
        at_start=WHEN_IMPORTED.format(name="laspy.lib"),
    )
    assert ended(command) == (130, "bfrt: interrupted\n")


def test_an_interrupt_while_another_process_imports_for_the_command(tmp_path):
    """HDF5 is read in a process that interrupts do not reach; the command does not wait for it."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["points"] = np.zeros((1_000_000, 3))
    command = started(
        tmp_path,
        *("convert", str(tmp_path / "a.h5"), "-o", "a.bfrt", "--radius", "1"),
        at_start=WHEN_IMPORTED.format(name="h5py._conv").replace("getpid", "getppid"),
    )
    assert ended(command) == (130, "bfrt: interrupted\n")


def test_an_interrupt_when_all_is_done_is_too_late(tmp_path):
    command = started(tmp_path, "spd", "tetra", "1", "--nff", "o.nff", at_start=AT_EXIT)
    assert ended(command) == (0, "")


def begun(folder):
    """Wait until the command has begun to write."""
    deadline = time.monotonic() + 30
    while not list((folder / "work").iterdir()):
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.parametrize("number", ENDINGS)
def test_signals_upon_signals_leave_no_traceback(tmp_path, number):
    command = started(tmp_path, *LONG)
    begun(tmp_path)
    while command.poll() is None:
        command.send_signal(number)
        time.sleep(0.005)
    said, status = ENDINGS[number]
    assert ended(command) == (status, said)
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_end_as_an_interrupt_does(tmp_path, number):
    command = started(tmp_path, *LONG)
    begun(tmp_path)
    start = time.perf_counter()
    command.send_signal(number)
    said, status = ENDINGS[number]
    assert ended(command) == (status, said)
    assert time.perf_counter() - start < 1.5  # a second, and what a busy machine adds
    assert list((tmp_path / "work").iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("name", ["bfrt.cli", "numpy"])
def test_other_signals_while_a_module_is_imported(tmp_path, number, name):
    at_start = WHEN_IMPORTED.format(name=name).replace("SIGINT", signal.Signals(number).name)
    said, status = ENDINGS[number]
    assert ended(started(tmp_path, *LONG, at_start=at_start)) == (status, said)


@pytest.mark.parametrize("number", ENDINGS)
def test_a_signal_that_shall_be_ignored_is(tmp_path, number):
    """As SIGHUP is by nohup."""
    ignored = f"import signal\nsignal.signal({int(number)}, signal.SIG_IGN)\n"
    at_start = WHEN_IMPORTED.format(name="numpy").replace("SIGINT", signal.Signals(number).name)
    command = started(tmp_path, "spd", "tetra", "1", "--nff", "o.nff", at_start=ignored + at_start)
    assert ended(command) == (0, "")


def test_the_first_signal_says_how_it_ends(interrupts, monkeypatch):
    monkeypatch.setattr(process, "IMPATIENCE", 0)
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        with pytest.raises(KeyboardInterrupt) as caught:
            signal.raise_signal(number)
        assert process.ending_of(caught.value) == ("terminated", 143)


def test_a_signal_when_the_command_is_ending_is_passed_over(interrupts, monkeypatch):
    monkeypatch.setattr(process, "IMPATIENCE", 0)
    with pytest.raises(KeyboardInterrupt):
        interrupt()
    namespace = {"__name__": "bfrt.cli.command", "os": os, "signal": signal}
    exec("signal.raise_signal(signal.SIGINT)", namespace)
    with pytest.raises(KeyboardInterrupt):
        interrupt()


@pytest.fixture
def interrupts():
    """Interrupts of this process, which go to the command's handler."""
    kept = [(number, signal.getsignal(number)) for number in (*process.ENDINGS, signal.SIGALRM)]
    hook = sys.unraisablehook
    made = Interrupts()
    made.begun = True
    for number in process.ENDINGS:  # which this process may have been started to ignore
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    made.listen()
    yield made
    signal.setitimer(signal.ITIMER_REAL, 0)
    for number, handler in kept:
        signal.signal(number, handler)
    sys.unraisablehook = hook


def interrupt():
    signal.raise_signal(signal.SIGINT)


def test_an_interrupt_is_raised_at_once(interrupts):
    with pytest.raises(KeyboardInterrupt):
        interrupt()


def test_another_at_once_does_not_disturb_the_clearing_up(interrupts, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        interrupt()
    interrupt()
    monkeypatch.setattr(process, "IMPATIENCE", 0)
    with pytest.raises(KeyboardInterrupt):
        interrupt()


class Finalised:
    def __del__(self):
        interrupt()


def test_an_interrupt_of_a_finaliser_comes_again(interrupts, capsys):
    made = Finalised()
    with pytest.raises(KeyboardInterrupt):
        del made
        time.sleep(10)
    assert capsys.readouterr().err == ""


def test_other_errors_of_a_finaliser_are_shown(interrupts, monkeypatch):
    shown = []
    monkeypatch.setattr(sys, "__unraisablehook__", shown.append)

    class Broken:
        def __del__(self):
            raise ValueError

    Broken()
    assert [error.exc_type for error in shown] == [ValueError]


class Context:
    left = False

    def __enter__(self):
        signal.raise_signal(signal.SIGINT)

    def __exit__(self, *_):
        self.left = True


def test_an_interrupt_of_a_context_s_begin_comes_when_it_is_sure_to_end(interrupts):
    context = Context()
    with pytest.raises(KeyboardInterrupt), context:
        time.sleep(10)
    assert context.left


def test_an_interrupt_of_an_import_comes_when_it_has_ended(interrupts, tmp_path, monkeypatch):
    (tmp_path / "swallowing.py").write_text(
        "import os, signal\ntry:\n    signal.raise_signal(signal.SIGINT)\nexcept:\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        import swallowing  # noqa: F401

        time.sleep(10)


def shell(folder, line):
    """Run a line in which bfrt stands for the command, away from the source tree."""
    command = f'bfrt() {{ "{sys.executable}" -m bfrt "$@"; }}\n{line}\n'
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=False, cwd=folder
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("asked", ["--help", "--version", "render --help", "spd tetra 1 --nff -"])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_nowhere_to_print_to(tmp_path, monkeypatch, asked, unbuffered):
    monkeypatch.setenv("PYTHONUNBUFFERED", unbuffered)
    for to, reason in [("/dev/full", "No space left on device"), ("&-", "Bad file descriptor")]:
        status, out, err = shell(tmp_path, f"bfrt {asked} >{to}")
        assert (status, out) == (1, "")
        assert err.startswith("bfrt: ") and err.endswith(f"{reason}\n") and err.count("\n") == 1
    assert shell(tmp_path, f"bfrt {asked} | true; exit ${{PIPESTATUS[0]}}")[0] in (0, 141)
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "bfrt", *asked.split()]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, check=False, cwd=tmp_path)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize(
    ("line", "status", "said"),
    [
        ("bfrt spd tetra 1 --quiet -o a.bfrt >&- 2>&- <&-", 0, ""),
        ("bfrt spd tetra 1 -o a.bfrt 2>/dev/full", 0, ""),
        ("bfrt convert - -o a.bfrt <&-", 1, "<stdin>: reading at byte 0: Bad file descriptor"),
        ("bfrt info nothing 2>&-", 1, ""),
        ("bfrt info nothing 2>/dev/full", 1, ""),
        ("bfrt info 2>&-", 2, ""),
        ("bfrt info 2>/dev/full", 2, ""),
        ("bfrt spd tetra 1 2>&-", 2, ""),
    ],
)
def test_standard_streams_that_are_closed_or_full(tmp_path, line, status, said):
    assert shell(tmp_path, line) == (status, "", f"bfrt: {said}\n" if said else "")


def test_what_is_said_does_not_land_in_a_file_of_the_same_number(tmp_path):
    """A degenerate object is warned of while files are open."""
    (tmp_path / "a.nff").write_text("s 0 0 0 1\np 3\n0 0 0\n1 1 1\n2 2 2\n")
    for name, closed in [("a", ">&- 2>&-"), ("b", "--quiet")]:
        assert shell(tmp_path, f"bfrt convert a.nff -o {name}.bfrt {closed}")[0] == 0
    a, b = (
        {
            path.name: path.read_bytes()
            for path in (tmp_path / name).rglob("*")
            if path.is_file() and path.name != "made.json"
        }
        for name in ("a.bfrt", "b.bfrt")
    )
    assert a == b != {}


def test_no_standard_streams_in_the_same_process(tmp_path, monkeypatch):
    from bfrt.cli import main

    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    assert main(["convert", "-", "-o", str(tmp_path / "a.bfrt")]) == 1
    assert main(["spd", "tetra", "1", "--nff", "-"]) == 1
    assert main(["spd", "tetra", "1", "-o", str(tmp_path / "a.bfrt")]) == 0
    assert main(["info", str(tmp_path / "a.bfrt")]) == 0
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    assert main(["info", str(tmp_path / "nothing")]) == 1
    assert sys.stdout.getvalue() == ""
