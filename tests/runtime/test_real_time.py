import ctypes
import gc
import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from python_process import run_python

from poil_drake.runtime import real_time
from poil_drake.runtime.real_time import KeepMemory, QuietInterpreter, RealTimeScheduling

_PROGRAM = """
import resource, sys
from poil_drake.runtime.real_time import KeepMemory

kept = sys.argv[1] == "kept" and KeepMemory()
faults = []
for _ in range(3):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(5):
        b"1" * 40_000_000
    faults.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
print(min(faults))
"""


def page_faults(how: str) -> int:
    """Returns the page faults of allocating 40 MB five times."""
    return int(run_python("-c", _PROGRAM, how))


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="not the GNU C library")
def test_freed_memory_is_reused_without_page_faults() -> None:
    assert page_faults("kept") < 0.01 * page_faults("default")


def test_a_c_library_without_mallopt_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(real_time.ctypes, "CDLL", lambda name: object())

    assert not KeepMemory()


@pytest.mark.parametrize("collecting", [False, True])
def test_the_interpreter_is_quiet_in_the_block_only(collecting: bool) -> None:
    before = sys.getswitchinterval()

    with QuietInterpreter(collecting=collecting):
        assert gc.isenabled() is collecting
        assert (sys.getswitchinterval() < before) is not collecting
    assert gc.isenabled()
    assert sys.getswitchinterval() == before
    assert gc.get_freeze_count() == 0


def in_thread(work: Callable[[], object]) -> None:
    """Runs something on a separate thread, so that its scheduling affects no other test."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(work).result()


def test_the_priority_ends_with_the_block() -> None:
    def work() -> None:
        before = os.sched_getscheduler(0)
        with RealTimeScheduling(20) as granted:
            inside = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
            assert inside == (os.SCHED_FIFO if granted else before)
            assert os.sched_getparam(0).sched_priority == (20 if granted else 0)
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER

    in_thread(work)


@pytest.mark.parametrize("own", [0, 30], ids=["normal", "real-time"])
def test_followers_get_the_next_lower_priority_unless_they_have_a_real_time_one(own: int) -> None:
    ended, begun = threading.Event(), threading.Event()

    def run() -> None:
        with RealTimeScheduling(own):
            begun.set()
            ended.wait()

    def scheduling() -> tuple[int, int]:
        policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
        return policy, os.sched_getparam(thread).sched_priority

    def work() -> None:
        before = scheduling()
        with RealTimeScheduling(20, followers=True) as granted:
            raised = granted and own == 0
            assert scheduling() == ((os.SCHED_RR, 19) if raised else before)
        assert scheduling() == before

    follower = threading.Thread(target=run)
    follower.start()
    begun.wait()
    thread = follower.native_id
    assert thread is not None
    try:
        in_thread(work)
    finally:
        ended.set()
        follower.join()


def test_priority_zero_asks_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_setscheduler")

    with RealTimeScheduling(0) as granted:
        assert not granted


def test_a_kernel_that_refuses_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise PermissionError("no")

    monkeypatch.setattr(real_time.os, "sched_setscheduler", refuse)

    with RealTimeScheduling(20) as granted:
        assert not granted
