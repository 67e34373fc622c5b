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


def interrupt_once(monkeypatch, before):
    """Have the first wait for workers interrupted, after `before` was called."""
    import bfrt.workers

    real = bfrt.workers.wait
    waits = []

    def interrupted(futures):
        waits.append(len(futures))
        if len(waits) == 1:
            before()
            raise KeyboardInterrupt
        return real(futures)

    monkeypatch.setattr(bfrt.workers, "wait", interrupted)
    return waits


def test_an_interrupt_waits_for_the_chunks_that_run(monkeypatch):
    """The caller has come to the end of its work, and the other worker is in its last chunk."""
    workers = Workers(2)
    started = threading.Event()
    working = []

    def task(worker, first, last):
        if worker == 0:
            assert started.wait(10)
            return
        working.append(first)
        started.set()
        time.sleep(0.1)
        working.remove(first)

    waits = interrupt_once(monkeypatch, lambda: None)
    with pytest.raises(KeyboardInterrupt):
        workers.run(task, 2, largest=1)
    assert working == []
    assert waits == [1, 1]
    workers.close()


def test_an_interrupt_of_the_caller_s_chunk_waits_for_the_others():
    workers = Workers(2)
    started = threading.Event()
    working, begun = [], []

    def task(worker, first, last):
        begun.append(first)
        if worker == 0:
            assert started.wait(10)
            raise KeyboardInterrupt
        working.append(first)
        started.set()
        time.sleep(0.1)
        working.remove(first)

    with pytest.raises(KeyboardInterrupt):
        workers.run(task, 1000, largest=1)
    assert working == []
    assert len(begun) == 2
    workers.close()


def test_who_has_not_begun_is_not_waited_for():
    """While the only other thread is busy elsewhere, the caller does all by itself."""
    workers = Workers(2)
    begun, end = threading.Event(), threading.Event()

    def busy(worker, first, last):
        if worker == 1:
            begun.set()
            assert end.wait(10)
        else:
            assert begun.wait(10)

    other = threading.Thread(target=lambda: workers.run(busy, 2, largest=1))
    other.start()
    assert begun.wait(10)
    done = []
    workers.run(lambda worker, first, _: done.append((worker, first)), 100, largest=1)
    assert done == [(0, first) for first in range(100)]
    end.set()
    other.join()
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


def test_who_had_chunks_finishes_once_behind_them(workers):
    events = []

    def work(worker, number):
        events.append(worker)
        time.sleep(0.0001)

    workers.drain(Numbers(300), work, lambda worker: events.append(~worker))
    assert 0 in events
    for worker in range(workers.threads):
        own = [event for event in events if event in (worker, ~worker)]
        assert own.count(~worker) == (1 if own else 0)
        assert not own or own[-1] == ~worker


def test_a_failure_leaves_nothing_to_finish(workers):
    finished = []

    def work(worker, number):
        raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"):
        workers.drain(Numbers(300, short=True), work, finished.append)
    assert finished == []
