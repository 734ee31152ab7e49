"""Settings of memory, scheduling and the interpreter for a process that runs in real time."""

import ctypes
import gc
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2

# From malloc.h of the GNU C library.
_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
_KEPT = 1 << 30

_SET_THP_DISABLE = 41
"""PR_SET_THP_DISABLE of linux/prctl.h, which disables transparent huge pages."""

_SWITCH_INTERVAL = 1e-4
"""How long another thread may hold the interpreter lock when the loop needs it [s]."""


def KeepMemory() -> bool:
    """Makes this process reuse freed memory instead of returning it to the kernel.

    By default, the GNU C library returns each freed block that is as large as an image to the
    kernel. The kernel then maps the next such block page by page, which takes longer than copying
    the image and blocks the process's other threads. Real-time programs prevent this at startup
    (https://wiki.linuxfoundation.org/realtime/documentation/howto/applications/memory/mlockall_dynamic_allocation_sample).
    Threads started later share one malloc arena, so each can reuse memory that another has freed.
    The settings last until the process ends.

    The kernel also stops merging the pages of this process into huge pages, because a merge can
    halt a core for milliseconds. Child processes started later inherit this setting.

    Returns:
        Whether the C library supports these settings.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    ctypes.CDLL(None).prctl(_SET_THP_DISABLE, 1, 0, 0, 0)
    options = ((_TRIM_THRESHOLD, _KEPT), (_MMAP_MAX, 0), (_ARENA_MAX, 1))
    return all(mallopt(option, value) == 1 for option, value in options)


@contextmanager
def QuietInterpreter(*, collecting: bool = False) -> Iterator[None]:
    """Stops garbage collection, and makes other threads soon release the interpreter lock.

    Both last for the `with` block. Objects that exist at its start, e.g. the diagram, are not
    scanned for garbage. OpenCV computes on the calling thread, because OpenCV's own threads lack
    the priority of the loop.

    Args:
        collecting: True for a loop that does not run in real time: new objects are still collected,
            and OpenCV and the switching of threads stay unchanged.
    """
    interval, enabled = sys.getswitchinterval(), gc.isenabled()
    threads = cv2.getNumThreads()
    gc.collect()
    gc.freeze()
    if not collecting:
        gc.disable()
        sys.setswitchinterval(_SWITCH_INTERVAL)
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)
        cv2.setNumThreads(threads)
        if enabled:
            gc.enable()
        gc.unfreeze()


@contextmanager
def RealTimeScheduling(
    priority: int, *, inherited: bool = False, followers: bool = False
) -> Iterator[bool]:
    """Gives the calling thread a real-time priority (SCHED_FIFO), if the kernel permits it.

    Linux permits it to root and to users with an `rtprio` entry in /etc/security/limits.conf, which
    the Franka driver requires as well.

    Only one thread at a time holds Python's interpreter lock, whatever its priority. If the kernel
    preempts that thread, every other thread waits for the lock, even the one with the highest
    priority. `followers` avoids this by giving the other threads the next lower priority.

    Args:
        priority: From 1 to 99, below that of the robot's driver; 0 changes nothing.
        inherited: Whether threads and processes started in the `with` block inherit the priority.
        followers: Whether the other Python threads of this process get the next lower priority,
            unless they already have a real-time priority.

    Yields:
        Whether the calling thread got the priority.
    """
    policy = os.SCHED_FIFO | (0 if inherited else os.SCHED_RESET_ON_FORK)
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    granted = priority > 0 and _schedule(0, policy, priority)
    raised = _raise_others(priority - 1) if granted and followers and priority > 1 else []
    try:
        yield granted
    finally:
        for thread in raised:
            _schedule(thread, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, 0)
        if granted:
            _schedule(0, *before)


def _raise_others(priority: int) -> list[int]:
    """Raises the other threads to `priority`; returns the native IDs of those that it raised."""
    others = [thread.native_id for thread in threading.enumerate()]
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    return [
        thread
        for thread in others
        if thread is not None
        and thread != threading.get_native_id()
        and _policy(thread) == os.SCHED_OTHER
        and _schedule(thread, policy, priority)
    ]


def _policy(thread: int) -> int:
    """Returns the scheduling policy of a thread; -1 if it has ended."""
    try:
        return os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    except OSError:
        return -1


def _schedule(thread: int, policy: int, priority: int) -> bool:
    try:
        os.sched_setscheduler(thread, policy, os.sched_param(priority))
    except OSError:
        return False
    return True
