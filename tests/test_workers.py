"""Workers hand out every chunk once, in order, and stop at the first failure."""

from __future__ import annotations

import itertools
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bfrt.workers import Workers


@pytest.fixture(params=[1, 2, 5])
def workers(request):
    made = Workers(request.param)
    yield made
    made.close()


@given(
    threads=st.integers(1, 4),
    count=st.integers(0, 5000),
    smallest=st.integers(1, 300),
    largest=st.integers(300, 1000),
)
def test_every_index_once(threads, count, smallest, largest):
    workers = Workers(threads)
    chunks = []
    workers.run(lambda _, a, b: chunks.append((a, b)), count, smallest=smallest, largest=largest)
    workers.close()
    chunks.sort()
    ends = [0, *(b for _, b in chunks)]
    assert ends[-1] == count
    assert [a for a, _ in chunks] == ends[:-1]
    assert all(smallest <= b - a <= largest for a, b in chunks[:-1])
    assert all(0 < b - a <= largest for a, b in chunks)


def test_each_worker_goes_forwards_and_is_one_thread_at_a_time(workers):
    seen = {}
    busy = [threading.Lock() for _ in range(workers.threads)]

    def task(worker, first, last):
        assert busy[worker].acquire(blocking=False)
        seen.setdefault(worker, []).append(first)
        busy[worker].release()

    workers.run(task, 10_000, largest=10)
    assert set(seen) <= set(range(workers.threads))
    assert all(a < b for way in seen.values() for a, b in itertools.pairwise(way))


def test_a_failure_stops_the_others(workers):
    """Chunk 0 fails while others wait to begin more; none may be begun after it is known."""
    begun = []
    failed = threading.Event()

    def task(worker, first, last):
        begun.append(first)
        if first == 0:
            failed.set()
            raise ValueError("mine")
        failed.wait(10)
        time.sleep(0.05)  # until the failure is known

    with pytest.raises(ValueError, match="mine"):
        workers.run(task, 1000, largest=1)
    assert len(begun) <= workers.threads
    began = len(begun)
    time.sleep(0.05)
    assert len(begun) == began  # and none goes on in the background


def test_the_last_worker_s_failure_stops_the_first(workers):
    """The failure is noticed whoever's it is, not when its turn comes to be asked."""
    begun = []

    def task(worker, first, last):
        begun.append(first)
        if worker == workers.threads - 1:
            raise ValueError("mine")
        time.sleep(0.001)

    with pytest.raises(ValueError, match="mine"):
        workers.run(task, 100_000, largest=1)
    assert len(begun) < 1000


def test_the_first_failure_is_raised():
    workers = Workers(2)
    first_failed = threading.Event()

    def task(worker, first, last):
        if first == 1:
            first_failed.set()
            raise ValueError("the first")
        assert first_failed.wait(10)
        time.sleep(0.05)
        raise KeyError("a later one")

    with pytest.raises(ValueError, match="the first"):
        workers.run(task, 2, largest=1)
    workers.close()


@pytest.mark.parametrize("kind", [KeyboardInterrupt, SystemExit, MemoryError])
def test_any_exception_comes_through(workers, kind):
    def task(worker, first, last):
        raise kind

    with pytest.raises(kind):
        workers.run(task, 100, largest=1)
    done = []
    workers.run(lambda _, a, b: done.append(b - a), 100)  # and the workers work on
    assert sum(done) == 100


def test_an_interrupt_waits_for_the_chunks_that_run(monkeypatch):
    import bfrt.workers

    workers = Workers(2)
    running = threading.Semaphore(0)
    working = []
    real = bfrt.workers.wait
    waits = []

    def interrupted(futures):
        waits.append(len(futures))
        if len(waits) == 1:
            running.acquire()
            raise KeyboardInterrupt
        return real(futures)

    def task(worker, first, last):
        working.append(first)
        running.release()
        time.sleep(0.05)
        working.remove(first)

    monkeypatch.setattr(bfrt.workers, "wait", interrupted)
    with pytest.raises(KeyboardInterrupt):
        workers.run(task, 1000, largest=1)
    assert working == []
    assert waits == [2, 2]
    workers.close()


def test_one_thread_works_in_the_caller():
    workers = Workers(1)
    names = set()
    workers.run(lambda *_: names.add(threading.current_thread().name), 100, largest=1)
    workers.close()
    assert names == {threading.current_thread().name}


class Numbers:
    """Hands out numbers."""

    def __init__(self, count, short=False):
        self.left = iter(range(count))
        self.short = short

    def next(self, worker):
        return next(self.left, None)


def test_a_source_is_drained(workers):
    done = []
    workers.drain(Numbers(1000), lambda worker, number: done.append(number))
    assert sorted(done) == list(range(1000))
    names = set()
    workers.drain(Numbers(100, short=True), lambda *_: names.add(threading.current_thread().name))
    assert names == {threading.current_thread().name}


def test_each_worker_is_called_once(workers):
    called = []
    workers.each(called.append)
    assert sorted(called) == list(range(workers.threads))
