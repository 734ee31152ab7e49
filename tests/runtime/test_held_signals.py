import signal
import threading

import pytest

from poil_drake.runtime.held_signals import HeldSignals


@pytest.fixture
def caught() -> "list[int]":
    """The handled signals, in order."""
    numbers: list[int] = []
    kinds = (signal.SIGTERM, signal.SIGHUP)
    before = {n: signal.signal(n, lambda number, frame: numbers.append(number)) for n in kinds}
    yield numbers
    for number, handler in before.items():
        signal.signal(number, handler)


def test_signals_are_delayed_until_the_end_and_raised_once(caught: list[int]) -> None:
    with HeldSignals():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
        assert caught == []

    assert caught == [signal.SIGTERM, signal.SIGHUP]


def test_signals_are_raised_after_an_exception_too(caught: list[int]) -> None:
    def fail() -> None:
        with HeldSignals():
            signal.raise_signal(signal.SIGTERM)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert caught == [signal.SIGTERM]


def test_an_exception_of_a_signal_on_entry_is_delayed_too(
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


def test_another_thread_does_not_delay_signals(caught: list[int]) -> None:
    done = []

    def work() -> None:
        with HeldSignals():
            done.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

    assert done == [True]
