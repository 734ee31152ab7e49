import signal
import threading

import pytest

from poil_drake.systems.held_signals import HeldSignals


@pytest.fixture
def caught() -> "list[int]":
    """Signals that were handled, in order."""
    numbers: list[int] = []
    kinds = (signal.SIGTERM, signal.SIGHUP)
    before = {n: signal.signal(n, lambda number, frame: numbers.append(number)) for n in kinds}
    yield numbers
    for number, handler in before.items():
        signal.signal(number, handler)


def test_signals_wait_until_the_end_and_come_once(caught: list[int]) -> None:
    with HeldSignals():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        assert caught == []

    assert caught == [signal.SIGTERM, signal.SIGHUP]


def test_other_signals_come_at_once(caught: list[int]) -> None:
    with HeldSignals([signal.SIGTERM]):
        signal.raise_signal(signal.SIGHUP)
        assert caught == [signal.SIGHUP]


def test_they_come_after_an_exception_too(caught: list[int]) -> None:
    def fail() -> None:
        with HeldSignals():
            signal.raise_signal(signal.SIGTERM)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert caught == [signal.SIGTERM]


def test_on_another_thread_it_does_nothing(caught: list[int]) -> None:
    done = []

    def work() -> None:
        with HeldSignals():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

    assert done == [True]
