"""Has the C library keep the memory that it once got from the kernel."""

import ctypes

# From malloc.h of the GNU C library.
_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8
_KEPT = 1 << 30

# From linux/prctl.h.
_SET_THP_DISABLE = 41


def KeepMemory() -> bool:
    """Has memory that is freed reused by this process rather than given back to the kernel.

    An image is large enough that the GNU C library would get it from the kernel, which maps page by
    page when it is first written, and give it back when it is freed: that costs more than to copy
    it, and holds up the process's other threads. This is what real-time programs do at their start
    (https://wiki.linuxfoundation.org/realtime/documentation/howto/applications/memory/mlockall_dynamic_allocation_sample).
    Threads that are started later share one arena, in which it is kept. It holds for the rest of
    the process.

    Nor does the kernel join this process's pages to huge ones, for which it stops for milliseconds
    whatever runs on the processor. Processes that are started later inherit that.

    Returns:
        Whether the C library knows how to.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    ctypes.CDLL(None).prctl(_SET_THP_DISABLE, 1, 0, 0, 0)
    options = ((_TRIM_THRESHOLD, _KEPT), (_MMAP_MAX, 0), (_ARENA_MAX, 1))
    return all(mallopt(option, value) == 1 for option, value in options)
