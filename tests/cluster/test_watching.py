"""What a client hears of its tasks, in whatever order messages come."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from cluster_fixtures import MEMORY, NEEDED

import bfrt
from bfrt.cluster.watching import Watch
from bfrt.progress import Bar, Progress

pytest.importorskip("distributed", reason=NEEDED)


class Client:
    """A client whose tasks are done when a test says so."""

    def __init__(self):
        self.cancelled = []

    def nthreads(self):
        return {"tcp://far:1": 1}

    def subscribe_topic(self, topic, handler):
        self.handler = handler

    def unsubscribe_topic(self, topic):
        self.handler = None

    def cancel(self, futures):
        self.cancelled += futures

    def map(self, task, given, key, **_):
        return [
            SimpleNamespace(key=name, add_done_callback=lambda call: None, done=lambda: False)
            for name in key
        ]


def test_messages_in_any_order():
    told = []
    with Watch(Client(), 100, told.append) as watch:
        watch.begin(print, range(4), "band")
        watch._hear([0, 10, 30])
        watch._hear([1, 5, 25])
        watch.through(0, 40)
        watch._hear([0, 30, 40])  # late: the task is through
        watch._hear([1, 2, 25])  # another worker has begun it again
        for task in (1, 2, 3):
            watch.through(task, 40)
    assert told == [
        Progress(1, 10, 30 + 75),
        Progress(1, 15, 55 + 50),
        Progress(1, 45, 65 + 50),
        Progress(1, 45, 65 + 50),
        Progress(1, 80, 80 + 50),
        Progress(1, 120, 120 + 25),
        Progress(1, 160, 160),
    ]


@pytest.mark.parametrize("error", [KeyboardInterrupt, bfrt.Cancelled, MemoryError])
def test_what_is_left_is_cancelled(error):
    client = Client()
    with pytest.raises(error), Watch(client, 100, None) as watch:
        errands = watch.begin(print, range(4), "band")
        raise error
    assert client.cancelled == [errand.future for errand in errands]


def test_a_bar_whose_total_grows():
    pytest.importorskip("tqdm")
    with Bar() as bar:
        bar.show(Progress(1, 1, 10))
        bar.show(Progress(1, 11, 30))
        assert bar._bar.total == 30


def test_a_bar(shared_client, paths, capfd):
    """One, which shows nothing where there is no terminal."""
    pytest.importorskip("tqdm")
    scene = bfrt.open(paths["spatial"])
    scene.render(memory=MEMORY, client=shared_client, progress=True)
    assert "rays" not in capfd.readouterr().err
