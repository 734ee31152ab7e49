"""Keeps other threads from taking the interpreter lock while a real-time loop computes.

Only one thread at a time holds Python's interpreter lock. A loop that calls Drake releases the lock
while Drake computes, and needs it back a moment later, many times in each period. Other threads
would take the lock each time, and return it only on request. So a thread whose work can wait calls
`InterpreterTurns.wait` before each piece of work.
"""

import threading
import time

_TIMEOUT = 0.005
"""How long `wait` waits at most [s]."""

_BACK_OFF = 0.1
"""After a timeout, `wait` returns at once for this long [s]."""


class InterpreterTurns:
    """Makes threads wait while a real-time loop computes. A process has one instance, `TURNS`."""

    def __init__(self) -> None:
        """Starts in the state in which no loop computes."""
        self._free = threading.Event()
        self._free.set()
        self._no_wait_until = 0.0

    def take(self) -> None:
        """Declares that the loop computes, so that `wait` makes other threads wait."""
        self._free.clear()

    def give(self) -> None:
        """Declares that the loop waits, so that other threads continue."""
        self._free.set()

    def wait(self) -> None:
        """Waits until no loop computes, for 5 ms at most.

        After a timeout, calls return at once for 0.1 s: a loop that is always late never calls
        `give`, and must not stop all other threads.
        """
        if self._free.is_set() or time.monotonic() < self._no_wait_until:
            return
        if not self._free.wait(_TIMEOUT):
            self._no_wait_until = time.monotonic() + _BACK_OFF


TURNS = InterpreterTurns()
