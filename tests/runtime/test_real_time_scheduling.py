import os
import threading
from collections.abc import Callable

import pytest

from poil_drake.runtime import real_time_scheduling
from poil_drake.runtime.real_time_scheduling import RealTimeScheduling


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


def test_followers_come_right_after_it() -> None:
    ended = threading.Event()
    follower = threading.Thread(target=ended.wait)
    follower.start()
    thread = follower.native_id
    assert thread is not None

    def work() -> None:
        with RealTimeScheduling(20, followers=True) as granted:
            inside = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
            assert inside == (os.SCHED_RR if granted else os.SCHED_OTHER)
            assert os.sched_getparam(thread).sched_priority == (19 if granted else 0)
        assert os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER

    try:
        in_thread(work)
    finally:
        ended.set()
        follower.join()


def test_threads_with_a_priority_of_their_own_keep_it() -> None:
    ended, begun = threading.Event(), threading.Event()
    scheduling: list[tuple[int, int]] = []

    def run() -> None:
        with RealTimeScheduling(30):
            scheduling.append((os.sched_getscheduler(0), os.sched_getparam(0).sched_priority))
            begun.set()
            ended.wait()
            scheduling.append((os.sched_getscheduler(0), os.sched_getparam(0).sched_priority))

    other = threading.Thread(target=run)
    other.start()
    begun.wait()

    def work() -> None:
        with RealTimeScheduling(20, followers=True):
            pass

    try:
        in_thread(work)
    finally:
        ended.set()
        other.join()
    assert scheduling[0] == scheduling[1]


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
