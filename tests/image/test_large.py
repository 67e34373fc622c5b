"""Pictures that memory does not hold are written in little more than what is named for it."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest
from capped import memory_cap
from memory_cap import run_in

import bfrt
from bfrt.image.frame import FrameSize

#: Write a picture that is on disk, and tell what that adds to the process.
WRITE = """
import resource, sys
import numpy as np
from pathlib import Path
from bfrt.image.image_buffer import ImageBuffer
from bfrt.image.picture import Image
from bfrt.image.frame import FrameSize
out, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
names = ["R", "G", "B", "A", "Z", "N.X", "N.Y", "N.Z", "id.lo", "id.hi"]
types = dict.fromkeys(names, np.float32) | dict.fromkeys(names[-2:], np.uint32)

def picture(width, height):
    buffer = ImageBuffer(width, height, Path.cwd())
    rng = np.random.default_rng(1)
    for row in range(0, height, 10):
        buffer.add({name: (rng.random((10, width)) * 99).astype(types[name]) for name in names})
    return Image(buffer.channels())

def anonymous():
    text = Path("/proc/self/status").read_text()
    return int(text.split("RssAnon:")[1].split()[0]) << 10

picture(40, 40).save("warm" + Path(out).suffix)
made = picture(width, height)
import threading
most, over = 0, False
def watch():
    global most
    while not over:
        most = max(most, anonymous())
before = anonymous()
watcher = threading.Thread(target=watch)
watcher.start()
made.save(out)
over = True
watcher.join()
print(most - before)
"""


#: AddressSanitizer keeps nothing of what is freed, where it is there at all.
AT_ONCE = ":quarantine_size_mb=0:thread_local_quarantine_size_kb=0"


@pytest.mark.parametrize("suffix", [".png", ".exr", ".npy"])
@pytest.mark.parametrize(("width", "height"), [(2000, 500), (20000, 60), (300, 3000)])
def test_what_writing_takes(tmp_path, suffix, width, height):
    work = [sys.executable, "-c", WRITE, f"a{suffix}", str(width), str(height)]
    ended = subprocess.run(
        work, cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "ASAN_OPTIONS": os.environ.get("ASAN_OPTIONS", "") + AT_ONCE},
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    assert int(ended.stdout) < FrameSize(width, height).written_bytes + (4 << 20)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".png", ".exr"])
@pytest.mark.parametrize("size", ["2000x2000", "500x8000", "20000x200", "3000x3000"])
def test_the_least_budget_is_enough_and_soon_done(tmp_path, suffix, size):
    bfrt.spd.balls(2).write(tmp_path / "s.bfrt")
    work = [sys.executable, "-m", "bfrt", "render", "s.bfrt", "-o", f"a{suffix}", "--threads", "2"]
    work += ["--resolution", size, "--quiet", "--memory"]
    refused = subprocess.run([*work, "1MiB"], cwd=tmp_path, capture_output=True, text=True)
    assert refused.returncode == 2
    least = int(re.search(r"expected (\d+)MiB", refused.stderr)[1])
    with memory_cap(least << 20) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        ended = run_in(group, [*work, f"{least}MiB"], tmp_path)
    assert ended.returncode == 0, ended.stderr
