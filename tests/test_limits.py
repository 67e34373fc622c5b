"""A process that the system gives too little memory: one sentence, or the result."""

from __future__ import annotations

import resource
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

import bfrt

MIB = 1 << 20

#: From what Python itself can hardly start with, to plenty.
SIZES = [100, 160, 220, 300, 450, 1500]

QUERY = """
import os, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"
try:
    import numpy as np
    import bfrt
    bfrt.cast_rays
except (ImportError, MemoryError) as error:
    sys.exit(f"bfrt: not loaded: {error}")
try:
    rays = np.zeros((40_000, 3)), np.ones((40_000, 3))
    bfrt.cast_rays(sys.argv[1], *rays, memory="200MiB", threads=2, out="answer")
except bfrt.BfrtError as error:
    sys.exit(f"bfrt: {error}")
"""

COMMANDS = {
    "render": ["-m", "bfrt", "render", "STORE", "-o", "a.exr", "--threads", "2", "--quiet",
               "--memory", "200MiB", "--resolution", "128x128"],
    "convert": ["-m", "bfrt", "convert", "NFF", "-o", "b.bfrt", "--quiet", "--memory", "200MiB"],
    "query": ["-c", QUERY, "STORE"],
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    scene = bfrt.spd.rings(3)
    with (folder / "s.nff").open("w") as file:
        scene.write_nff(file)
    scene.write(folder / "s.bfrt")
    return {"STORE": str(folder / "s.bfrt"), "NFF": str(folder / "s.nff")}


def under(limit, size, command, folder):
    """Run Python with a command under a limit of memory."""
    return subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(limit, (size * MIB, size * MIB)),
    )


@cache
def began(size, limit):
    """Whether Python itself, and NumPy with one thread, can begin: else nobody could say a word."""
    code = "import os; os.environ['OPENBLAS_NUM_THREADS'] = '1'; import numpy, OpenEXR"
    return under(limit, size, ["-c", code], "/").returncode == 0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits are Linux's here")
@pytest.mark.parametrize(
    "limit", ["RLIMIT_AS", pytest.param("RLIMIT_DATA", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("name", COMMANDS)
def test_too_little_memory_is_one_sentence(tmp_path, inputs, name, limit):
    kind = getattr(resource, limit)
    command = [inputs.get(word, word) for word in COMMANDS[name]]
    statuses = []
    for size in SIZES:
        if not began(size, kind):
            continue
        ended = under(kind, size, command, tmp_path)
        said = ended.stderr.strip()
        assert ended.returncode in (0, 1, 2), (size, said)
        assert "Traceback" not in said, (size, said)
        assert "interrupted" not in said, (size, said)
        if ended.returncode:
            assert said.startswith("bfrt: ")
            assert said.count("\n") == 0, (size, said)
            assert not [path.name for path in tmp_path.iterdir() if path.name != "inputs"], size
        else:
            for path in tmp_path.iterdir():
                bfrt.open(path).verify() if path.suffix == ".bfrt" else None
            clear(tmp_path)
        statuses.append(ended.returncode)
    assert statuses[-1] == 0
    assert 1 in statuses or name == "convert"  # which may need no more than to begin


def clear(folder):
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


def test_what_was_asked_for_is_said(tmp_path, monkeypatch):
    image = bfrt.Image({name: np.zeros((8, 8), np.float32) for name in "RGBA"})

    def none(*_, **__):
        raise MemoryError("an array of 77 bytes")

    monkeypatch.setattr(np, "stack", none)
    with pytest.raises(bfrt.ResourceError, match=r"a\.npy: saving: .* for an array of 77 bytes"):
        image.save(tmp_path / "a.npy")
    assert list(tmp_path.iterdir()) == []
