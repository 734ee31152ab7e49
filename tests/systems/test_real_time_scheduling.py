import os
import threading
from collections.abc import Callable

import pytest

from poil_drake.systems import real_time_scheduling
from poil_drake.systems.real_time_scheduling import RealTimeScheduling


def in_thread(work: Callable[[], object]) -> None:
    """Runs something on a thread of its own, whose scheduling does not matter to others."""
    failures: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    if failures:
        raise failures[0]


def test_what_is_granted_is_taken_back() -> None:
    def work() -> None:
        before = os.sched_getscheduler(0)
        with RealTimeScheduling(20) as granted:
            inside = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
            assert inside == (os.SCHED_FIFO if granted else before)
            assert os.sched_getparam(0).sched_priority == (20 if granted else 0)
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER

    in_thread(work)


def test_without_a_priority_nothing_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")

    with RealTimeScheduling(0) as granted:
        assert not granted


def test_a_kernel_that_does_not_permit_it_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError("no")

    monkeypatch.setattr(real_time_scheduling.os, "sched_setscheduler", refuse)

    with RealTimeScheduling(20) as granted:
        assert not granted
