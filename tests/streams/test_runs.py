"""Pieces that are read in runs are the bytes of their files, however the system reads them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.errors import ShortReadError, StreamError
from bfrt.streams.reader import SharedFile
from bfrt.streams.runs import RunReader

PAGE = 4096
DATA = bytes(range(251)) * 1400  # 86 pages; the period is no divisor of a page


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for k in range(2):
        (folder / str(k)).write_bytes(DATA[k:])
    return [folder / str(k) for k in range(2)]


@st.composite
def pieces(draw):
    """Draw pieces of two files: file, begin, bytes."""
    size = len(DATA) - 1
    found = []
    for _ in range(draw(st.integers(0, 12))):
        begin = draw(st.integers(0, size))
        most = min(9000, size - begin)
        found.append((draw(st.integers(0, 1)), begin, draw(st.integers(0, most))))
    return sorted(found) if draw(st.booleans()) else found


@pytest.mark.parametrize("direct", [False, True])
@given(wanted=pieces(), capacity=st.sampled_from([1, 3 * PAGE, 40 * PAGE]))
def test_pieces_against_plain_bytes(paths, direct, wanted, capacity):
    files = [SharedFile(path, True, direct=direct) for path in paths]
    reader = RunReader(capacity)
    got = reader.take([(files[k], begin, n) for k, begin, n in wanted])
    assert got == [DATA[k + begin : k + begin + n] for k, begin, n in wanted[: len(got)]]
    if wanted and capacity >= RunReader.room(wanted[0][2]):
        assert got
    if capacity >= sum(RunReader.room(n) for _, _, n in wanted):
        assert len(got) == len(wanted)


@pytest.mark.parametrize("direct", [False, True])
def test_short_gaps_are_read_through(paths, direct):
    file = SharedFile(paths[0], True, direct=direct)
    reader = RunReader(1 << 20)
    reader.take([(file, 0, 10), (file, 5000, 10), (file, 300_000, 10)])
    read, seeks = file.counts()
    assert seeks == 1  # the first begins where the file does
    assert 20 <= read <= 5010 + PAGE + 10
    reader.take([(file, 200_000, 10), (file, 100, 10)])  # not ascending: each a run
    assert file.counts()[1] == 2


@pytest.mark.parametrize("direct", [False, True])
def test_a_file_that_has_become_shorter(tmp_path, direct):
    path = tmp_path / "a"
    path.write_bytes(DATA)
    file = SharedFile(path, True, direct=direct)
    os.truncate(path, 100_000)
    reader = RunReader(1 << 20)
    assert reader.take([(file, 99_000, 1000)]) == [DATA[99_000:100_000]]
    for wanted in ([(99_000, 1001)], [(0, 10), (200_000, 10)]):
        with pytest.raises(ShortReadError, match=str(path)):
            reader.take([(file, begin, n) for begin, n in wanted])
    assert reader.take([(file, 99_000, 1000)]) == [DATA[99_000:100_000]]


def test_a_read_that_fails_names_its_file(tmp_path):
    (tmp_path / "a").write_bytes(DATA)
    file = SharedFile(tmp_path / "a", True, lambda _, flags: os.open(tmp_path, os.O_RDONLY))
    with pytest.raises(StreamError, match="reading"):
        RunReader(1 << 20).take([(file, 0, 10)])


def test_a_file_s_system_that_has_no_direct_reads(tmp_path):
    (tmp_path / "a").write_bytes(DATA)
    opened = []

    def opener(path, flags):
        opened.append(flags)
        if flags & os.O_DIRECT:
            raise OSError(22, "Invalid argument")
        return os.open(path, flags)

    file = SharedFile(tmp_path / "a", True, opener, direct=True)
    assert len(opened) == 3
    assert RunReader(1 << 20).take([(file, 5, 10)]) == [DATA[5:15]]


def test_a_system_that_knows_no_direct_reads(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(DATA)
    monkeypatch.setattr("bfrt.streams.reader.DIRECT", 0)
    opened = []

    def opener(path, flags):
        opened.append(os.open(path, flags))
        return opened[-1]

    file = SharedFile(tmp_path / "a", True, opener, direct=True)
    assert RunReader(1 << 20).take([(file, 5, 10)]) == [DATA[5:15]]
    del file
    for descriptor in opened:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(descriptor)


#: What the system says of reads that are under way, changed: WAY tells how.
CHANGING = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/aio_abi.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <unistd.h>

/* Reads that are begun and of which nothing is told: they end with their queue, or late. */
static struct iocb begun[16];
static int begun_count, in_turn;

static ssize_t own_pread(int file, void *to, size_t n, off_t at)
{
    static ssize_t (*own)(int, void *, size_t, off_t);
    if (!own)
        own = (ssize_t (*)(int, void *, size_t, off_t))dlsym(RTLD_NEXT, "pread");
    return own(file, to, n, at);
}

static void end_all(void)
{
    while (begun_count) {
        struct iocb *one = &begun[--begun_count];
        own_pread(one->aio_fildes, (void *)one->aio_buf, one->aio_nbytes, one->aio_offset);
    }
}

static long untold(long number, struct iocb **one)
{
    if (number == SYS_io_submit) {
        begun[begun_count++] = **one;
        return 1;
    }
    if (number == SYS_io_destroy)
        end_all();
    errno = EINVAL;
    return -1;
}

/* What has no direct reads refuses those of two threads, of one a while later. */
static void refuse_in_turn(void)
{
    int turn = __atomic_add_fetch(&in_turn, 1, __ATOMIC_SEQ_CST);
    for (int k = 0; k < 5000 && __atomic_load_n(&in_turn, __ATOMIC_SEQ_CST) < 2; k++)
        usleep(1000);
    usleep(turn * 100000);
    errno = EINVAL;
}

ssize_t pread(int file, void *to, size_t n, off_t at)
{
    static int calls;
    if (!strcmp(getenv("WAY"), "refused") && fcntl(file, F_GETFL) & O_DIRECT) {
        refuse_in_turn();
        return -1;
    }
    ssize_t got = own_pread(file, to, n, at);
    if (begun_count && ++calls == 8)
        end_all();
    return got;
}

ssize_t pread64(int file, void *to, size_t n, off_t at) __attribute__((alias("pread")));

long syscall(long number, ...)
{
    static long (*own)(long, ...);
    static int calls;
    const char *way = getenv("WAY");
    va_list given;
    long a[6];
    va_start(given, number);
    for (int k = 0; k < 6; k++)
        a[k] = va_arg(given, long);
    va_end(given);
    if (!own)
        own = (long (*)(long, ...))dlsym(RTLD_NEXT, "syscall");
    if (!strcmp(way, "untold") && (number == SYS_io_submit || number == SYS_io_getevents
                                   || number == SYS_io_destroy))
        return untold(number, (struct iocb **)a[2]);
    if ((number == SYS_io_setup && !strcmp(way, "no queue"))
        || (number == SYS_io_submit && !strcmp(way, "none begun"))
        || (number == SYS_io_submit && !strcmp(way, "some begun") && calls++ % 2)) {
        errno = EAGAIN;
        return -1;
    }
    if (number == SYS_io_getevents && !strcmp(way, "interrupted") && calls++ % 2) {
        errno = EINTR;
        return -1;
    }
    long result = own(number, a[0], a[1], a[2], a[3], a[4], a[5]);
    struct io_event *event = (struct io_event *)a[3];
    if (number == SYS_io_getevents && result == 1 && !strcmp(way, "failed"))
        event->res = -EIO;
    if (number == SYS_io_getevents && result == 1 && !strcmp(way, "short"))
        event->res = event->res > 4096 ? 4096 : event->res - 100;
    return result;
}
"""

#: Prints the bytes of pieces, of some twice, and of one as two threads read it at once.
TAKING = """
import sys
from concurrent.futures import ThreadPoolExecutor
from bfrt.streams.reader import SharedFile
from bfrt.streams.runs import RunReader

file = SharedFile(sys.argv[1], True, direct=True)
places = [(7, 30_000), (70_000, 90_000), (200_000, 9), (300_000, 40_000)]
reader = RunReader(1 << 20)
with ThreadPoolExecutor(2) as threads:
    one = [threads.submit(RunReader(1 << 20).take, [(file, 9, 900)]) for _ in range(2)]
    for piece in [*one[0].result(), *one[1].result()]:
        sys.stdout.buffer.write(piece)
for late in (0, 1000):
    for piece in reader.take([(file, begin + late, n) for begin, n in places]):
        sys.stdout.buffer.write(piece)
"""


@pytest.fixture(scope="module")
def changing(tmp_path_factory):
    folder = tmp_path_factory.mktemp("changing")
    compiler = shutil.which("cc")
    if compiler is None or not sys.platform.startswith("linux"):
        pytest.skip("there is no C compiler, or another system's loader")
    (folder / "changing.c").write_text(CHANGING)
    library = folder / "changing.so"
    command = [compiler, "-shared", "-fPIC", "-o", library, folder / "changing.c", "-ldl"]
    subprocess.run(command, check=True)
    return library


@pytest.mark.parametrize(
    "way",
    ["", "no queue", "none begun", "some begun", "interrupted", "failed", "short", "untold",
     "refused"],
)  # fmt: skip
def test_what_the_system_does_not_read_is_read_again(paths, changing, way):
    """What is under way may fail, or end early: the bytes are the same."""
    try:
        os.close(os.open(paths[0], os.O_RDONLY | os.O_DIRECT))
    except OSError:
        pytest.skip("files are read through the cache here")
    loaded = [*filter(None, [os.environ.get("LD_PRELOAD")]), str(changing)]  # a sanitizer first
    child = {**os.environ, "LD_PRELOAD": " ".join(loaded), "WAY": way}
    work = [sys.executable, "-c", TAKING, str(paths[0])]
    ended = subprocess.run(work, env=child, cwd=paths[0].parent, capture_output=True)
    assert ended.returncode == 0, ended.stderr
    places = [(9, 900), (9, 900)]
    for late in (0, 1000):
        places += [(7 + late, 30_000), (70_000 + late, 90_000), (200_000 + late, 9),
                   (300_000 + late, 40_000)]  # fmt: skip
    assert ended.stdout == b"".join(DATA[begin : begin + n] for begin, n in places)
