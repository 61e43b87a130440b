"""Work in a process of its own: it answers in order, errors are told, and it can be stopped at any moment."""

import multiprocessing
import threading
import time

import pytest
import viser

from vispeg.core.errors import UserError
from vispeg.view.job import Job
from vispeg.view.place import Place
from vispeg.view.worker import Worker


class Counter:
    def __init__(self, tell, start):
        self.tell, self.count = tell, start

    def add(self, number):
        self.tell("adding", number)
        self.count += number
        return self.count

    def add_one(self):
        return self.add(1)

    def refuse(self):
        raise UserError("no", key="--number")

    def fail(self):
        return 1 / 0

    def sleep(self):
        self.tell("asleep", None)
        time.sleep(60)


class Ears:
    def __init__(self):
        self.heard, self.more = [], threading.Condition()

    def __call__(self, *what):
        with self.more:
            self.heard.append(what)
            self.more.notify_all()

    def until(self, *what, seconds=60):
        with self.more:
            assert self.more.wait_for(lambda: what in [h[: len(what)] for h in self.heard], seconds), self.heard


@pytest.fixture
def ears():
    return Ears()


@pytest.fixture
def worker(ears):
    made = Worker(Counter, (3,), ears)
    yield made
    made.stop()


def test_it_answers_in_order_and_outlives_errors(worker, ears):
    for method, *args in (("add", 2), ("refuse",), ("fail",), ("add", 1)):
        worker.ask(method, *args)
    assert worker.busy
    ears.until("done", "add", 6)
    kinds = [kind for kind, *_ in ears.heard]
    assert kinds == ["told", "done", "refused", "failed", "told", "done"]
    assert ears.heard[2][2] == "number: no" and "ZeroDivisionError" in ears.heard[3][2]
    assert not worker.busy and worker.alive


def test_an_answer_that_cannot_be_shown_does_not_silence_the_next(capfd):
    ears = Ears()

    def heard(*what):
        ears(*what)
        if what == ("done", "add", 5):
            raise ValueError("no such widget")

    made = Worker(Counter, (3,), heard)
    try:
        made.ask("add", 2)
        made.ask("add", 1)
        ears.until("done", "add", 6)
        assert not made.busy and "no such widget" in capfd.readouterr().err
    finally:
        made.stop()


def test_what_cannot_be_sent_was_never_asked(worker, ears):
    with pytest.raises(Exception, match="(?i)pickle"):
        worker.ask("add", lambda: 0)
    assert not worker.busy
    worker.ask("add", 2)
    ears.until("done", "add", 5)
    assert not worker.busy


def test_a_large_request_does_not_wait_for_the_work_before_it(worker, ears):
    worker.ask("sleep")
    ears.until("told", "asleep")
    start = time.monotonic()
    worker.ask("add", bytes(4_000_000))
    assert time.monotonic() - start < 10 and worker.busy


def test_it_is_stopped_in_the_middle(worker, ears):
    worker.ask("sleep")
    ears.until("told", "asleep")
    start = time.monotonic()
    worker.stop()
    ears.until("stopped", "sleep")
    assert time.monotonic() - start < 10 and not worker.alive and not worker.busy


def test_a_request_to_a_process_that_has_died_is_not_waited_for(worker, ears):
    worker.ask("sleep")
    ears.until("told", "asleep")
    worker.stop()
    ears.until("stopped", "sleep")
    worker.ask("add", 1)
    assert not worker.busy


def test_stop_clicked_twice_at_once_leaves_one_process(tmp_path):
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    job = Job(Place(server, tmp_path, 1), lambda name, value: None, lambda free: None)
    before = {child.pid for child in multiprocessing.active_children()}
    try:
        job.begin(Counter, (3,), "sleep")
        together = threading.Barrier(2)
        for _ in range(5):
            clicks = [threading.Thread(target=lambda: (together.wait(), job.stop())) for _ in range(2)]
            for click in clicks:
                click.start()
            for click in clicks:
                click.join()
            assert len({child.pid for child in multiprocessing.active_children()} - before) == 1
    finally:
        job.end()
        server.stop()


def test_a_page_that_is_slow_to_draw_ends_idle(tmp_path):
    """A click draws that work has begun, and takes longer than the work: buttons must not stay off for it."""
    server, drawn = viser.ViserServer(host="127.0.0.1", port=0, verbose=False), []

    def idle(free):
        if not free:
            time.sleep(0.5)
        drawn.append(free)

    job = Job(Place(server, tmp_path, 1), lambda name, value: None, idle)
    try:
        job.begin(Counter, (3,), "add_one")
        until = time.monotonic() + 60
        while not (drawn and drawn[-1]) and time.monotonic() < until:
            time.sleep(0.05)
        job.ask("add", 1)  # done within milliseconds
        time.sleep(1.5)
        assert drawn[-1] is True, drawn
    finally:
        job.end()
        server.stop()
