"""Helps this process keep real time: memory, scheduling, and an interpreter without pauses."""

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
"""From linux/prctl.h."""

_SWITCH_INTERVAL = 1e-4
"""How long another thread may hold the interpreter lock when the loop needs it [s]."""


def KeepMemory() -> bool:
    """Makes this process reuse freed memory instead of returning it to the kernel.

    For blocks as large as an image, the GNU C library requests memory from the kernel, which maps
    it page by page on first use, and returns it when it is freed. That costs more than copying the
    image, and blocks the other threads of the process. Real-time programs prevent this at startup
    (https://wiki.linuxfoundation.org/realtime/documentation/howto/applications/memory/mlockall_dynamic_allocation_sample).
    Threads started later share one arena, which keeps the memory. The settings last until the
    process ends.

    The kernel also stops merging the pages of this process into huge pages. A merge halts whatever
    runs on the core for milliseconds. Child processes started later inherit this setting.

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
    """Keeps garbage collection and long turns of other threads out of the loop in a `with` block.

    Objects that exist at the start, e.g. imported libraries and the diagram, are not scanned for
    garbage. OpenCV computes on the calling thread, as its own threads lack the loop's priority.

    Args:
        collecting: Whether to collect new objects, and to leave OpenCV and the switching of threads
            unchanged; for a loop that does not run in real time.
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
    preempts that thread, even the thread with the highest priority waits. `followers` avoids this
    by giving the other threads the next lower priority.

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
