"""One work under one fault, in a child of a process that has all modules: what came of it."""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import hashlib
import json
import os
import select
import shutil
import signal
import sys
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from faults.shim import NEVER, Fault, Shim
from faults.works import WORKS

from bfrt.errors import BfrtError, StreamError

#: Seconds after which a trial is one that hangs. They are counted one by one, while this process
#: runs: where somebody stops it and its child for a while, none passes.
PATIENCE = 30

#: Characters that are told of what a child says that died: where it was comes first.
TOLD = 1500

#: Of what it says on standard error: nobody caught this, or could not.
UNCAUGHT = ("Traceback", "Exception ignored", "panicked", "terminate called")

#: A file with times, which differ.
TIMED = "made.json"

#: A fault that is none.
NONE = Fault("open", 0)

Tree = dict[str, str]


class Outcome(NamedTuple):
    """What came of a trial: `counts` of calls by family, none where the child did not live."""

    counts: dict[str, int]
    error: str
    wrong: str

    def was_hit(self, fault: Fault, n: int) -> bool:
        return not self.counts or self.counts[fault.family] >= n


class Expected(NamedTuple):
    """What is there before the work and after, what it returns, and the calls that it makes."""

    before: Tree
    after: Tree
    value: str
    counts: dict[str, int]
    modules: list[str]


def tree_of(folder: Path) -> Tree:
    """Digests of all files, by their names in the folder; of folders their names."""
    found = {}
    for path in sorted(folder.rglob("*")):
        timed = path.is_dir() or path.name == TIMED
        data = b"" if timed else path.read_bytes()
        found[str(path.relative_to(folder))] = hashlib.sha1(data).hexdigest()
    return found


def units_of(tree: Tree) -> dict[str, Tree]:
    """What is whole or not there: each file of a store that is read, each result."""
    units: dict[str, Tree] = {}
    for name, digest in tree.items():
        part = "/".join(name.split("/")[:2]) if name.startswith("out/") else name
        units.setdefault(part, {})[name] = digest
    return units


def misplaced(found: Tree, expected: Expected, *, done: bool) -> str:
    """What is there and should not be, or is not whole."""
    if done:
        differing = {k for k in {*found, *expected.after} if found.get(k) != expected.after.get(k)}
        return f"differing: {sorted(differing)[:3]}" if differing else ""
    now, before, after = map(units_of, (found, expected.before, expected.after))
    for unit in {*now, *before}:
        if now.get(unit) not in (before.get(unit), after.get(unit)):
            return f"left: {unit}" if unit not in {**before, **after} else f"half: {unit}"
    return ""


def unfit(error: BaseException) -> str:
    """Why an exception is not one of ours, in one sentence with its place; nothing if it is."""
    kind, text = type(error).__name__, str(error)
    if not isinstance(error, BfrtError):
        return f"{kind}: {text[:100]}"
    if not text or "\n" in text:
        return f"{kind} of no sentence: {text!r:.100}"
    if isinstance(error, StreamError) and not text.startswith(error.path):
        return f"{kind} without its place: {text:.100}"
    return ""


def ended_in_time(child: int) -> bool:
    """Wait for a child to end, or to have been waited for too long; tell whether it has ended."""
    ended = os.pidfd_open(child)
    try:
        return any(select.select([ended], [], [], 1.0)[0] for _ in range(PATIENCE))
    finally:
        os.close(ended)


class Trials:
    """Runs works in children.

    Parameters
    ----------
    shim : Shim
    folder : Path
        Where they are done.
    """

    def __init__(self, shim: Shim, folder: Path) -> None:
        self._shim = shim
        self._folder = folder

    def prepare(self, name: str) -> Expected:
        """Make what a work needs, and do it once, without a fault."""
        base = self._folder / "base"
        shutil.rmtree(base, ignore_errors=True)
        for part in ("in", "out", "tmp"):
            (base / part).mkdir(parents=True)
        made = self._forked(lambda: WORKS[name].prepare(base))
        assert not made.get("died") and not made["error"], made
        before = tree_of(base)
        told = self._child(name, NONE, NEVER)
        assert not told.get("died") and not told["error"], told
        after = tree_of(self._folder / "trial")
        return Expected(before, after, told["value"], told["counts"], told["modules"])

    def run(self, name: str, fault: Fault, n: int, expected: Expected) -> Outcome:
        """Do a work while the n-th call of a family fails."""
        told = self._child(name, fault, n)
        done = not told.get("error") or WORKS[name].resumes
        said = (self._folder / "stderr").read_text(errors="replace")
        if told.get("died"):
            return Outcome({}, "", f"{told['died']}: {said[:TOLD]}")
        wrong = told["unfit"] or misplaced(tree_of(self._folder / "trial"), expected, done=done)
        if not wrong and done and told["value"] != expected.value:
            wrong = "another result"
        if not wrong and any(word in said for word in UNCAUGHT):
            wrong = f"said: {said.strip()[-200:]}"
        return Outcome(told["counts"], told["error"], wrong)

    def _child(self, name: str, fault: Fault, n: int) -> dict[str, Any]:
        trial = self._folder / "trial"
        shutil.rmtree(trial, ignore_errors=True)
        shutil.copytree(self._folder / "base", trial)
        call = partial(WORKS[name].run, trial)
        return self._forked(call, fault, n, call if WORKS[name].resumes else None)

    def _forked(self, call, fault: Fault = NONE, n: int = NEVER, again=None) -> dict[str, Any]:
        """Call something in a child, and where it fails `again`; return what is told of it."""
        told = self._folder / "told.json"
        told.unlink(missing_ok=True)
        child = os.fork()
        if not child:
            with contextlib.suppress(BaseException):
                self._redirect()
                self._serve(call, (fault, n), told, again)
            os._exit(0)
        hangs = not ended_in_time(child)
        if hangs:
            os.kill(child, signal.SIGABRT)  # which tells where it is
        _, status = os.waitpid(child, 0)
        if os.WIFSIGNALED(status):
            return {"died": "hangs" if hangs else f"signal {os.WTERMSIG(status)}"}
        if not told.exists():
            return {"died": f"exit status {os.WEXITSTATUS(status)}"}
        return json.loads(told.read_text())

    def _redirect(self) -> None:
        """Have what a child says in a file, and where it is when it dies."""
        said = os.open(self._folder / "stderr", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(said, 2)
        faulthandler.enable(2)

    def _serve(self, call, fault: tuple[Fault, int], told: Path, again) -> None:
        value, error, reason = b"", "", ""
        self._shim.arm(*fault)
        try:
            value = call()
        except BaseException as raised:
            self._shim.disarm()
            error, reason = f"{type(raised).__name__}: {raised}", unfit(raised)
        if error and not reason and again is not None:
            try:
                value = again()
            except BaseException as raised:
                reason = f"again: {type(raised).__name__}: {raised}"
        gc.collect()  # what is closed by nobody else
        self._shim.disarm()
        digest = hashlib.sha1(value or b"").hexdigest()
        fields = {"value": digest, "error": error, "unfit": reason, "counts": self._shim.counts()}
        told.write_text(json.dumps({**fields, "modules": sorted(sys.modules)}))
