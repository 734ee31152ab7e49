"""Asks the kernel to run a thread before all others."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def RealTimeScheduling(priority: int, *, inherited: bool = False) -> Iterator[bool]:
    """Gives the calling thread a real-time priority (SCHED_FIFO), where that is permitted.

    Linux permits it to root, and
    to users with an `rtprio` in /etc/security/limits.conf, as the Franka driver needs it, too.

    Args:
        priority: From 1 to 99, below that of the robot's driver; 0 asks for nothing.
        inherited: Whether threads and processes that it starts meanwhile have it, too.

    Yields:
        Whether it was permitted.
    """
    policy = os.SCHED_FIFO | (0 if inherited else os.SCHED_RESET_ON_FORK)
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    granted = priority > 0 and _set(policy, priority)
    try:
        yield granted
    finally:
        if granted:
            _set(*before)


def _set(policy: int, priority: int) -> bool:
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError:
        return False
    return True
