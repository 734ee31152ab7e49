"""Keeps other threads from the interpreter while a real-time loop computes.

Python's interpreter belongs to one thread at a time. A loop that calls Drake releases it while
Drake computes, and needs it back a moment later, many times in each period. Other threads would
take it each time, and return it only on request. So a thread with work that can wait waits for its
turn before each piece of it.
"""

import threading
import time

_TIMEOUT = 0.005
"""How long a thread waits for its turn [s]."""

_BACK_OFF = 0.1
"""After a timeout, no thread waits for this long [s]."""


class InterpreterTurns:
    """Lets other threads know whether a loop is computing. Each process has one: `TURNS`."""

    def __init__(self) -> None:
        """Starts without a loop."""
        self._free = threading.Event()
        self._free.set()
        self._no_wait_until = 0.0

    def take(self) -> None:
        """The loop computes: other threads wait."""
        self._free.clear()

    def give(self) -> None:
        """The loop waits: other threads continue."""
        self._free.set()

    def wait(self) -> None:
        """Returns when no loop computes, or after 5 ms.

        After such a timeout, no thread waits for 0.1 s, because a loop that is always late never
        waits, and must not stop all other threads.
        """
        if self._free.is_set() or time.monotonic() < self._no_wait_until:
            return
        if not self._free.wait(_TIMEOUT):
            self._no_wait_until = time.monotonic() + _BACK_OFF


TURNS = InterpreterTurns()
