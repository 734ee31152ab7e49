import os
import signal
from collections.abc import Iterator
from multiprocessing.connection import Connection
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


def test_it_is_told_first_and_answers_from_a_process_of_its_own(dut: WorkerProcess) -> None:
    setup, pid, word = dut.ask(("word", [])).value

    assert (setup, word) == ("hello", "word")
    assert pid == dut.pid != os.getpid()
    assert dut.alive


def test_arrays_come_back_as_they_were(dut: WorkerProcess) -> None:
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

    answer = dut.ask(("word", arrays))

    assert len(answer.arrays) == len(arrays)
    for before, after in zip(arrays, answer.arrays, strict=True):
        np.testing.assert_array_equal(after, before, strict=True)


def test_what_was_answered_stays_while_more_and_larger_is_asked(dut: WorkerProcess) -> None:
    first = dut.ask(("word", [np.arange(10.0)])).arrays[0]

    larger = dut.ask(("word", [np.full(1_000_000, 7.0)])).arrays[0]
    smaller = dut.ask(("word", [np.full(4, 9.0)])).arrays[0]

    np.testing.assert_array_equal(first, np.arange(10.0))
    assert (larger == 7.0).all()
    assert larger.shape == (1_000_000,)
    np.testing.assert_array_equal(smaller, np.full(4, 9.0))
    assert first.flags.owndata


def test_an_error_with_a_remedy_comes_through_and_the_worker_goes_on(dut: WorkerProcess) -> None:
    with pytest.raises(TrackingError) as caught:
        dut.ask(("fail", []))

    assert (caught.value.problem, caught.value.remedy) == ("Nothing is seen.", "Look again.")
    assert dut.ask(("word", [])).value[2] == "word"


def test_a_mistake_shows_where_it_was_made_and_the_worker_goes_on(dut: WorkerProcess) -> None:
    with pytest.raises(RuntimeError, match="ZeroDivisionError: by mistake"):
        dut.ask(("stumble", []))

    assert dut.ask(("word", [])).value[2] == "word"


@pytest.mark.parametrize(
    ("setup", "error", "says"),
    [
        ("refused", InvalidValueError, "no such setup"),
        ("broken", RuntimeError, "ZeroDivisionError: in the beginning"),
    ],
)
def test_what_goes_wrong_at_the_start_is_the_answer_to_everything(
    setup: str, error: type[Exception], says: str
) -> None:
    dut = WorkerProcess(WORKER, setup)

    for _ in range(2):
        with pytest.raises(error, match=says):
            dut.ask(("word", []))
    dut.end()


def test_a_worker_that_dies_over_a_request_says_with_which_status(dut: WorkerProcess) -> None:
    for _ in range(2):  # and again to whoever asks later
        with pytest.raises(WorkerEndedError, match="has ended with status 7"):
            dut.ask(("die", []))

    assert not dut.alive


def test_a_worker_that_was_killed_says_so(dut: WorkerProcess) -> None:
    dut.ask(("word", []))

    os.kill(dut.pid, signal.SIGKILL)

    with pytest.raises(WorkerEndedError, match="has ended with status -9"):
        dut.ask(("word", []))


def test_an_interrupt_from_the_keyboard_does_not_reach_it_even_while_it_starts() -> None:
    dut = WorkerProcess(WORKER, "hello")

    # A terminal sends the interrupt to the whole group in the foreground.
    assert os.getpgid(dut.pid) != os.getpgid(0)

    dut.end()


def test_ending_leaves_no_process(dut: WorkerProcess) -> None:
    dut.ask(("word", []))

    dut.end()

    with pytest.raises(ProcessLookupError):
        os.kill(dut.pid, 0)
    with pytest.raises(WorkerEndedError):
        dut.ask(("word", []))


def test_a_worker_that_nobody_holds_ends_by_itself() -> None:
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


def test_files_of_the_folder_one_works_in_do_not_hide_libraries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "queue.py").write_text("raise RuntimeError('not this one')")
    monkeypatch.chdir(tmp_path)
    dut = WorkerProcess(WORKER, "hello")

    assert dut.ask(("word", [])).value[2] == "word"
    dut.end()


def test_whoever_is_interrupted_leaves_no_answer_for_the_next(
    dut: WorkerProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Interrupted:
        def __init__(self, connection: Connection):
            self._connection = connection

        def recv(self) -> object:
            raise KeyboardInterrupt

        def __getattr__(self, name: str) -> object:
            return getattr(self._connection, name)

    monkeypatch.setattr(dut, "_connection", Interrupted(dut._connection))
    with pytest.raises(KeyboardInterrupt):
        dut.ask(("first", []))
    monkeypatch.undo()

    with pytest.raises(WorkerEndedError):
        dut.ask(("second", []))


def test_asking_one_that_has_ended_touches_no_file(dut: WorkerProcess, tmp_path: Path) -> None:
    dut.ask(("word", []))
    dut.end()
    # These get the numbers that the worker's files had.
    files = [(tmp_path / f"{k}").open("w+b") for k in range(8)]

    with pytest.raises(WorkerEndedError):
        dut.ask(("word", [np.zeros(100_000)]))

    assert [file.seek(0, 2) for file in files] == [0] * 8
    for file in files:
        file.close()
