"""Asks the kernel to run a thread before all others."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def RealTimeScheduling(
    priority: int, *, inherited: bool = False, followers: bool = False
) -> Iterator[bool]:
    """Gives the calling thread a real-time priority (SCHED_FIFO), where that is permitted.

    Linux permits it to root, and to users with an `rtprio` in /etc/security/limits.conf, as the
    Franka driver needs it, too.

    Python's interpreter belongs to one thread at a time, and knows no priorities: whoever holds it
    while the kernel runs another program in its place keeps the thread of the highest priority
    waiting. `followers` are kept from that by the next lower priority.

    Args:
        priority: From 1 to 99, below that of the robot's driver; 0 asks for nothing.
        inherited: Whether threads and processes that it starts meanwhile have it, too.
        followers: Whether this process's other Python threads get one priority less, as far as they
            had none.

    Yields:
        Whether it was permitted.
    """
    policy = os.SCHED_FIFO | (0 if inherited else os.SCHED_RESET_ON_FORK)
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    granted = priority > 0 and _set(0, policy, priority)
    raised = _raise_others(priority - 1) if granted and followers and priority > 1 else []
    try:
        yield granted
    finally:
        for thread in raised:
            _set(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, 0)
        if granted:
            _set(0, *before)


def _raise_others(priority: int) -> list[int]:
    """Returns the threads, by the kernel's numbers, whose priority it has raised."""
    own = threading.get_native_id()
    others = [thread.native_id for thread in threading.enumerate()]
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    return [
        thread
        for thread in others
        if thread is not None
        and thread != own
        and _policy(thread) == os.SCHED_OTHER
        and _set(thread, policy, priority)
    ]


def _policy(thread: int) -> int:
    """Returns how a thread is scheduled; -1 where it has ended."""
    try:
        return os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    except OSError:
        return -1


def _set(thread: int, policy: int, priority: int) -> bool:
    try:
        os.sched_setscheduler(thread, policy, os.sched_param(priority))
    except OSError:
        return False
    return True
