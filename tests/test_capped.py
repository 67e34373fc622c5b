"""The caps that benchmarks run under."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from capped import V1, V1_DISK, disk_cap, disk_of, drop, inside, memory_cap

READ = "import sys; print(len(open(sys.argv[1], 'rb').read()))"


@pytest.mark.skipif(V1.is_dir() and not V1_DISK.is_dir(), reason="no cgroup caps disks here")
def test_disk_gives_what_its_cap_says(tmp_path):
    file = tmp_path / "eight"
    file.write_bytes(bytes(8 << 20))
    drop(file)
    with memory_cap(1 << 30) as group:
        if group is None:
            pytest.skip("no cgroup can be made")
        try:
            disk_of(tmp_path)
        except SystemExit as error:
            pytest.skip(str(error))
        with disk_cap(group, tmp_path, 16 << 20) as slow:
            command = inside(slow, inside(group, [sys.executable, "-c", READ, str(file)]))
            start = time.perf_counter()
            found = subprocess.run(command, capture_output=True, text=True, check=True)
            assert int(found.stdout) == 8 << 20
            assert time.perf_counter() - start > 0.4
    assert not slow.exists()


def test_what_is_on_no_disk_is_refused():
    with pytest.raises(SystemExit, match="/proc: lies on no block device"):
        disk_of(Path("/proc"))
