import math
import threading

import pytest

from poil_drake.runtime import interpreter_turns
from poil_drake.runtime.interpreter_turns import InterpreterTurns


def test_no_thread_waits_while_no_loop_computes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpreter_turns, "_TIMEOUT", 60.0)
    dut = InterpreterTurns()

    dut.wait()
    dut.take()
    dut.give()
    dut.wait()


def test_a_thread_continues_when_the_loop_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(interpreter_turns, "_TIMEOUT", None)
    dut = InterpreterTurns()
    dut.take()
    done = threading.Event()

    def work() -> None:
        dut.wait()
        done.set()

    thread = threading.Thread(target=work)
    thread.start()

    assert not done.wait(0.05)
    dut.give()
    thread.join()


def test_no_thread_waits_again_after_a_timeout(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    monkeypatch.setattr(interpreter_turns, "_BACK_OFF", math.inf)
    dut = InterpreterTurns()
    monkeypatch.setattr(dut._free, "wait", waits.append)
    dut.take()

    for _ in range(3):
        dut.wait()

    assert waits == [interpreter_turns._TIMEOUT]
