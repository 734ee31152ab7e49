"""Work beside the simulation."""

import sys
import threading

import pytest

from poil_drake.errors import StationError
from poil_drake.runtime import interpreter_turns
from poil_drake.runtime.background_thread import Background, BackgroundWorker
from poil_drake.runtime.interpreter_turns import TURNS


def test_close_finishes_work_that_has_yet_to_begin() -> None:
    background = Background("worker")
    interval = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # The thread begins only when this one waits for it.
    try:
        future = background.submit(int, "3")
        background.close()
    finally:
        sys.setswitchinterval(interval)

    assert future.result() == 3


def test_close_cancels_work_that_waits_behind_other_work() -> None:
    background, go = Background("worker"), threading.Event()
    first = background.submit(go.wait)
    others = [background.submit(int), background.submit(int)]
    threading.Timer(0.05, go.set).start()

    background.close()

    assert first.result()
    assert all(other.cancelled() for other in others)


def test_submit_after_close_is_an_error() -> None:
    background = Background("cameras' thread")
    background.close()

    with pytest.raises(StationError, match="cameras' thread has been closed"):
        background.submit(int)


def test_jobs_run_in_order_in_another_thread():
    done, threads = [], set()
    dut = BackgroundWorker(name="test", capacity=2)

    for i in range(20):
        dut.submit(lambda i=i: (done.append(i), threads.add(threading.current_thread().name)))
    dut.close()

    assert done == list(range(20))
    assert threads == {"test"}


def test_an_error_reaches_the_caller_and_stops_the_work():
    done = []
    dut = BackgroundWorker(name="test", capacity=4)

    def fail():
        raise OSError("disk full")

    def submit_and_close():
        dut.submit(fail)
        # Either call reports the error, depending on whether the thread has failed by now.
        dut.submit(lambda: done.append(1))
        dut.close()

    with pytest.raises(OSError, match="disk full"):
        submit_and_close()
    dut.close()

    assert done == []


def test_jobs_start_when_their_batch_is_full_or_the_worker_closes():
    started, done = threading.Event(), []
    dut = BackgroundWorker(name="test", capacity=1, batch=3)

    dut.submit(lambda: done.append(1))
    dut.submit(lambda: done.append(2))
    waited = not done
    dut.submit(started.set)
    started.wait()
    first = list(done)
    dut.submit(lambda: done.append(3))
    dut.close()

    assert waited
    assert first == [1, 2]
    assert done == [1, 2, 3]


@pytest.mark.parametrize(("batch", "kept", "dropped"), [(1, [0], 4), (2, [0, 1, 4], 2)])
def test_a_full_queue_drops_batches_that_may_be_dropped(batch, kept, dropped):
    gate, started, done = threading.Event(), threading.Event(), []
    dut = BackgroundWorker(name="test", capacity=1, batch=batch)

    for _ in range(batch):
        dut.submit(lambda: (started.set(), gate.wait()))
    started.wait()
    for i in range(5):
        dut.submit(lambda i=i: done.append(i), may_drop=True)
    gate.set()
    dut.close()

    assert done == kept
    assert dut.dropped == dropped


def test_a_closed_worker_rejects_jobs():
    dut = BackgroundWorker(name="test", capacity=1)
    dut.close()

    with pytest.raises(ValueError, match="closed"):
        dut.submit(lambda: None)


def test_jobs_wait_while_a_loop_computes(monkeypatch):
    monkeypatch.setattr(interpreter_turns, "_TIMEOUT", None)
    done = threading.Event()
    dut = BackgroundWorker(name="worker", capacity=4)
    TURNS.take()
    try:
        dut.submit(done.set)
        waited = not done.wait(0.05)
    finally:
        TURNS.give()

    assert waited
    done.wait()
    dut.close()
