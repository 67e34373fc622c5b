"""Fuzz a reader, the store or the checkpoint.

::

    python tests/fuzz/fuzz.py ply --seconds 600          # by atheris, if it is installed
    python tests/fuzz/fuzz.py ply --inputs 1000 --engine own --seed 2
    python tests/fuzz/fuzz.py ply findings/ply-0123abcd  # once more, what was found

On the sanitizer build, whose library hides from atheris what has been reached, our own mutator
starts from what atheris kept with another build (``--corpus``).

It prints a line of JSON: inputs, what came of them, findings. Each finding is a file in ``--keep``;
where the process dies, the input is the file ``current`` in the folder that is named then.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import logging
import os
import random
import shutil
import sys
import time
import traceback
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path

sys.path[:1] = [str(Path(__file__).parent.parent)]  # in place of the folder that this is in

#: Of atheris' inputs, those that our own mutator makes.
OWN_SHARE = 0.5

MOST_FINDINGS = 20


class Session:
    """Tries inputs until there have been enough.

    Parameters
    ----------
    name : str
        The harness.
    folder : Path
        A folder of its own.
    keep : Path
        Where findings are put.
    """

    def __init__(self, name: str, folder: Path, keep: Path) -> None:
        harnesses = importlib.import_module("fuzz.harnesses").HARNESSES
        (folder / "home").mkdir()
        self.name = name
        self.harness = harnesses[name](folder / "home")
        self.trials = importlib.import_module("fuzz.trial").Trials(self.harness, folder)
        self.findings: list[str] = []
        self.inputs = 0
        self._keep = keep
        self._start = time.monotonic()

    def try_one(self, data: bytes) -> None:
        """Try an input; keep it if something is found."""
        self.inputs += 1
        try:
            self.trials.try_one(data)
        except Exception as error:
            self._keep.mkdir(parents=True, exist_ok=True)
            path = self._keep / f"{self.name}-{zlib.crc32(data):08x}"
            path.write_bytes(data)
            self.findings.append(f"{path}: {type(error).__name__}: {error}"[:300])
            traceback.print_exc()

    def has_enough(self, inputs: int, seconds: float) -> bool:
        return (
            (inputs > 0 and self.inputs >= inputs)
            or time.monotonic() - self._start >= seconds
            or len(self.findings) >= MOST_FINDINGS
        )

    def told(self) -> str:
        """What came of all, as a line of JSON."""
        return json.dumps(
            {
                "harness": self.name,
                "inputs": self.inputs,
                "seconds": round(time.monotonic() - self._start, 1),
                "slowest": round(self.trials.slowest, 2),
                "outcomes": dict(self.trials.outcomes.most_common()),
                "findings": self.findings,
            }
        )


def run_own(session: Session, asked: argparse.Namespace) -> None:
    """Try inputs that a seed makes; the n-th is the same whatever came before."""
    mutator = session.harness.mutator
    if asked.corpus is not None:
        mutator.learn(file.read_bytes() for file in sorted(asked.corpus.iterdir()))
    n = asked.first
    while not session.has_enough(asked.inputs, asked.seconds):
        session.try_one(mutator.made(f"{session.name} {asked.seed} {n}"))
        n += 1


def run_atheris(session: Session, asked: argparse.Namespace, end: Callable[[], None]) -> None:
    """Try inputs that what has been reached makes; it ends the process."""
    atheris = importlib.import_module("atheris")
    mutator = session.harness.mutator
    corpus = asked.corpus or Path(session.trials.folder) / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for seed in session.harness.seeds:
        (corpus / f"seed-{zlib.crc32(seed):08x}").write_bytes(seed)

    def try_one(data: bytes) -> None:
        session.try_one(data)
        if session.has_enough(asked.inputs, asked.seconds):
            end()

    def changed(data: bytes, most: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < OWN_SHARE:
            return bytes(mutator.changed(data, rng)[:most])
        return bytes(atheris.Mutate(data, most))

    atheris.Setup(
        [sys.argv[0], f"-seed={asked.seed + 1}", "-max_len=65536", "-verbosity=0", str(corpus)],
        try_one,
        custom_mutator=changed,
    )
    atheris.Fuzz()


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("name", help='the harness (fuzz/harnesses.py); of ours also "all"')
    parser.add_argument("files", nargs="*", type=Path, help="inputs to try, instead of others")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--inputs", type=int, default=0, help="0, the default: no limit")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="the first input of our mutator")
    parser.add_argument("--engine", choices=("atheris", "own"))
    parser.add_argument("--alone", action="store_true", help="read files, and make no store")
    parser.add_argument("--keep", type=Path, default=Path("findings"), help="where findings go")
    parser.add_argument(
        "--corpus", type=Path, help="where atheris keeps what is new, and ours begins"
    )
    asked = parser.parse_args()
    if asked.engine is None:
        there = importlib.util.find_spec("atheris") is not None
        asked.engine = "atheris" if there and not asked.files else "own"
    return asked


def quiet() -> None:
    """What the library logs is not for here; a warning of NumPy's is a finding."""
    logging.getLogger("bfrt").addHandler(logging.NullHandler())
    logging.getLogger("bfrt").propagate = False
    warnings.simplefilter("error")


def run(asked: argparse.Namespace, folder: Path) -> bool:
    """Do what is asked for; tell whether nothing was found."""
    if asked.engine == "atheris":
        with importlib.import_module("atheris").instrument_imports(include=["bfrt"]):
            importlib.import_module("bfrt.conversion.convert")
            importlib.import_module("fuzz.harnesses")
    quiet()
    importlib.import_module("fuzz.readers").alone = asked.alone
    session = Session(asked.name, folder, asked.keep.absolute())

    def end() -> None:
        print(session.told(), flush=True)
        shutil.rmtree(folder)
        os._exit(1 if session.findings else 0)

    if asked.engine == "atheris":
        run_atheris(session, asked, end)
    elif asked.files:
        for file in asked.files:
            session.try_one(file.read_bytes())
    else:
        run_own(session, asked)
    print(session.told())
    return not session.findings


def main() -> int:
    asked = arguments()
    in_memory = importlib.import_module("fuzz.folders").in_memory
    well = True
    names = [asked.name]
    if asked.name == "all":
        names = [*importlib.import_module("fuzz.harnesses").HARNESSES]
    for name in names:
        with in_memory(name) as folder:
            print(f"{name}: inputs are tried in {folder}", file=sys.stderr)
            well &= run(argparse.Namespace(**{**vars(asked), "name": name}), folder)
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
