import signal
import threading

import pytest

from poil_drake.runtime.held_signals import HeldSignals


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


def test_a_signal_on_the_way_in_waits_too(
    caught: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(number: int, frame: object) -> None:
        raise ZeroDivisionError

    signal.signal(signal.SIGHUP, stop)
    install, done = signal.signal, []

    def install_late(number: int, handler: object) -> object:
        if not done and number == signal.SIGHUP:
            done.append("signal")
            signal.raise_signal(signal.SIGHUP)
        return install(number, handler)

    def work() -> None:
        with HeldSignals():
            done.append("work")

    monkeypatch.setattr(signal, "signal", install_late)
    with pytest.raises(ZeroDivisionError):
        work()
    monkeypatch.undo()

    assert done == ["signal", "work"]
    assert signal.getsignal(signal.SIGHUP) is stop


def test_on_another_thread_it_does_nothing(caught: list[int]) -> None:
    done = []

    def work() -> None:
        with HeldSignals():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

    assert done == [True]
