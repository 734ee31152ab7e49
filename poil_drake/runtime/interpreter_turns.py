"""Keeps threads beside a loop in real time from the interpreter while the loop computes.

Python's interpreter belongs to one thread at a time. A loop that calls Drake gives it up whenever
Drake works, and needs it back a moment later, many times in each period; a thread that wants to
work meanwhile takes it each time, and has to be asked to give it back. So threads with work that
can wait ask for a turn before each piece of it.
"""

import threading
import time

_PATIENCE = 0.005
"""How long a thread waits for its turn [s]."""

_FED_UP = 0.1
"""For so long nobody waits, once somebody waited in vain [s]."""


class InterpreterTurns:
    """Says whether a loop computes just now. One for the process, as there is one interpreter."""

    def __init__(self) -> None:
        """There is no loop at first."""
        self._free = threading.Event()
        self._free.set()
        self._fed_up_until = 0.0

    def take(self) -> None:
        """Has others wait from now on, who ask before they begin."""
        self._free.clear()

    def give(self) -> None:
        """Has others go on."""
        self._free.set()

    def wait(self) -> None:
        """Returns when no loop computes, or after 5 ms.

        After that nobody waits for a tenth of a second: a loop that is late all the time, and never
        waits itself, must not stop all else.
        """
        if self._free.is_set() or time.monotonic() < self._fed_up_until:
            return
        if not self._free.wait(_PATIENCE):
            self._fed_up_until = time.monotonic() + _FED_UP


TURNS = InterpreterTurns()
