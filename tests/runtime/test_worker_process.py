import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.runtime.worker_process import WorkerEndedError, WorkerProcess

WORKER = "echoing_worker"


@pytest.fixture
def dut() -> Iterator[WorkerProcess]:
    worker = WorkerProcess(WORKER, "hello")
    yield worker
    worker.end()


def test_it_gets_its_setup_and_answers_from_another_process(dut: WorkerProcess) -> None:
    setup, pid, word, _ = dut.ask(("word", []))

    assert (setup, word) == ("hello", "word")
    assert pid == dut.pid != os.getpid()
    assert dut.alive


def test_requests_do_not_overwrite_the_arrays_of_the_setup() -> None:
    dut = WorkerProcess(WORKER, [np.arange(10.0)])

    setup, *_ = dut.ask(("word", [np.zeros(1000)]))

    np.testing.assert_array_equal(setup, [np.arange(10.0)])
    dut.end()


def test_arrays_come_back_unchanged(dut: WorkerProcess) -> None:
    rng = np.random.default_rng(0)
    arrays = [
        rng.normal(size=(3, 4)),
        rng.integers(0, 255, (5, 7, 3)).astype(np.uint8),
        np.empty((0, 3), np.float32),
        rng.normal(size=(6, 4))[::2, 1:],  # not contiguous
        np.asfortranarray(rng.normal(size=(2, 5))),
        np.array(3.5, np.float32),
        np.array([True, False]),
    ]

    answers = dut.ask(("word", arrays))[3]

    for before, after in zip(arrays, answers, strict=True):
        np.testing.assert_array_equal(after, before, strict=True)
    assert not answers[0].flags.writeable


def test_answers_are_not_overwritten_by_later_ones(dut: WorkerProcess) -> None:
    first = dut.ask(("word", [np.arange(10.0)]))[3][0]

    larger = dut.ask(("word", [np.full(1_000_000, 7.0)]))[3][0]
    smaller = dut.ask(("word", [np.full(4, 9.0)]))[3][0]

    np.testing.assert_array_equal(first, np.arange(10.0))
    assert (larger == 7.0).all()
    assert larger.shape == (1_000_000,)
    np.testing.assert_array_equal(smaller, np.full(4, 9.0))


@pytest.mark.parametrize(
    ("word", "error", "text"),
    [
        ("fail", TrackingError, r"Nothing is seen\. Look again\."),
        ("stumble", RuntimeError, "ZeroDivisionError: by mistake"),
    ],
)
def test_an_error_of_the_worker_is_raised_here_and_the_worker_continues(
    dut: WorkerProcess, word: str, error: type[Exception], text: str
) -> None:
    with pytest.raises(error, match=text):
        dut.ask((word, []))

    assert dut.ask(("word", []))[2] == "word"


@pytest.mark.parametrize(
    ("setup", "error", "says"),
    [
        ("refused", InvalidValueError, "no such setup"),
        ("broken", RuntimeError, "ZeroDivisionError: in the beginning"),
    ],
)
def test_an_error_of_the_setup_is_the_answer_to_every_request(
    setup: str, error: type[Exception], says: str
) -> None:
    dut = WorkerProcess(WORKER, setup)

    for _ in range(2):
        with pytest.raises(error, match=says):
            dut.ask(("word", []))
    dut.end()


def test_a_worker_that_dies_during_a_request_is_reported_with_its_status(
    dut: WorkerProcess,
) -> None:
    for _ in range(2):
        with pytest.raises(WorkerEndedError, match="has ended with status 7"):
            dut.ask(("die", []))

    assert not dut.alive


def test_a_worker_that_leaves_a_child_behind_is_reported_at_once(dut: WorkerProcess) -> None:
    start = time.monotonic()

    with pytest.raises(WorkerEndedError, match="has ended with status 7"):
        dut.ask(("leave a child", []))

    assert time.monotonic() - start < 8.0, "the child lives for 10 s"


def test_a_killed_worker_is_reported(dut: WorkerProcess) -> None:
    dut.kill()

    with pytest.raises(WorkerEndedError, match="has ended with status -9"):
        dut.ask(("word", []))


def test_ctrl_c_does_not_reach_the_worker_even_while_it_starts(dut: WorkerProcess) -> None:
    # A terminal sends the interrupt to the whole group in the foreground.
    assert os.getpgid(dut.pid) != os.getpgid(0)


def test_ending_leaves_no_process(dut: WorkerProcess) -> None:
    dut.ask(("word", []))

    dut.end()

    with pytest.raises(ProcessLookupError):
        os.kill(dut.pid, 0)
    with pytest.raises(WorkerEndedError):
        dut.ask(("word", []))


def test_a_worker_ends_with_its_last_reference() -> None:
    dut = WorkerProcess(WORKER, "hello")
    dut.ask(("word", []))
    process = dut._process

    del dut

    assert process.wait() == 0


def test_it_computes_on_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "4")
    dut = WorkerProcess(WORKER, "hello")
    dut.ask(("word", []))

    with open(f"/proc/{dut.pid}/environ") as file:
        environment = dict(item.split("=", 1) for item in file.read().split("\0") if item)

    assert environment["OMP_NUM_THREADS"] == environment["OPENBLAS_NUM_THREADS"] == "1"
    dut.end()


def test_files_in_the_working_directory_do_not_shadow_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "queue.py").write_text("raise RuntimeError('not this one')")
    monkeypatch.chdir(tmp_path)
    dut = WorkerProcess(WORKER, "hello")

    assert dut.ask(("word", []))[2] == "word"
    dut.end()


def test_an_interrupted_request_leaves_no_answer_for_the_next(
    dut: WorkerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(dut._channel, "receive", interrupted)
    with pytest.raises(KeyboardInterrupt):
        dut.ask(("first", []))
    monkeypatch.undo()

    with pytest.raises(WorkerEndedError):
        dut.ask(("second", []))


def test_asking_an_ended_worker_writes_to_no_file(dut: WorkerProcess, tmp_path: Path) -> None:
    dut.ask(("word", []))
    dut.end()
    # These get the file descriptors that the worker's memory had.
    files = [(tmp_path / f"{k}").open("w+b") for k in range(8)]

    with pytest.raises(WorkerEndedError):
        dut.ask(("word", [np.zeros(100_000)]))

    assert [file.seek(0, 2) for file in files] == [0] * 8
    for file in files:
        file.close()
