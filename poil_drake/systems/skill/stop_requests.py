"""Counts stop requests: by keys in the terminal, from the browser page and from other sources."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from poil_drake.systems.control_period import CONTROL_PERIOD

BUTTON = "Stop"
"""The button on the Meshcat page."""

BUTTON_KEY = "Escape"
"""The key that presses the button while the page has the focus."""

STOP_KEYS = b" \r\nqQ\x1b"
"""Space, Enter, q and Escape: large keys, and keys that are easy to remember."""


class StopSwitch:
    """Counts stop requests from any thread, whether made by a key, a signal or a program."""

    def __init__(self) -> None:
        self._lock, self._requests = threading.Lock(), 0

    def request(self) -> None:
        """Requests a stop."""
        with self._lock:
            self._requests += 1

    @property
    def requests(self) -> int:
        """Number of requests so far."""
        return self._requests


class StopRequests(LeafSystem):
    """Outputs the number of stop requests.

    .. pydrake_system::

        name: StopRequests
        output_ports:
        - stop

    `stop` (1,) is the number of clicks on the Meshcat button plus the requests of the `StopSwitch`:
    discrete state, updated once per period. It is 0 before the first update.
    """

    def __init__(
        self,
        *,
        period: float = CONTROL_PERIOD,
        meshcat: Meshcat | None = None,
        switch: StopSwitch | None = None,
    ):
        """Constructs the system, and adds the button to the page.

        Args:
            period: The control period [s].
            meshcat: The page of the button; None for no button.
            switch: Counts all other requests; None for none.
        """
        super().__init__()
        self._meshcat, self._switch, self._clicks = meshcat, switch, 0
        if meshcat is not None:
            meshcat.AddButton(BUTTON, BUTTON_KEY)
        self.DeclareStateOutputPort("stop", self.DeclareDiscreteState(1))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def close(self) -> None:
        """Removes the button from the page. Earlier clicks still count; the switch still works."""
        self._count_clicks()
        if self._meshcat is not None:
            self._meshcat.DeleteButton(BUTTON, strict=False)
            self._meshcat = None

    def _count_clicks(self) -> None:
        if self._meshcat is not None:
            self._clicks = self._meshcat.GetButtonClicks(BUTTON)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        self._count_clicks()
        requests = self._clicks + (self._switch.requests if self._switch is not None else 0)
        discrete_state.set_value([requests])


@contextmanager
def terminal_stop_key(
    switch: StopSwitch, *, keys: bytes = STOP_KEYS, stream: TextIO | None = None
) -> Iterator[bool]:
    """Requests a stop for every stop key that is typed inside the `with` block.

    Inside the block the terminal is not in line mode, so keys arrive without Enter and without
    echo; Ctrl-C still interrupts. Closing the terminal requests a stop, too. Stop keys have no
    effect if `stream` is not a terminal, or if this process is a background job.

    Args:
        switch: Receives the requests.
        keys: The stop keys.
        stream: The terminal; None for the standard input.

    Yields:
        Whether stop keys are in effect.
    """
    stream = stream or sys.stdin
    is_terminal = stream is not None and not stream.closed and stream.isatty()
    if not (is_terminal and _in_foreground(stream.fileno())):
        yield False
        return
    terminal = stream.fileno()
    modes = termios.tcgetattr(terminal)
    wake_reader, wake_writer = os.pipe()
    thread = threading.Thread(
        target=_listen, args=(switch, keys, terminal, wake_reader), daemon=True
    )
    tty.setcbreak(terminal)
    thread.start()
    try:
        yield True
    finally:
        try:
            os.close(wake_writer)
            thread.join()
            os.close(wake_reader)
        finally:
            if _in_foreground(terminal):
                with suppress(termios.error):  # The terminal was closed.
                    termios.tcsetattr(terminal, termios.TCSANOW, modes)


def _listen(switch: StopSwitch, keys: bytes, terminal: int, wake_reader: int) -> None:
    while True:
        ready, _, _ = select.select([terminal, wake_reader], [], [])
        if wake_reader in ready:
            return
        try:
            typed = os.read(terminal, 64)
        except OSError:
            typed = b""
        if not typed:  # The terminal was closed, so there will be no more keys.
            switch.request()
            return
        for key in typed:
            if key in keys:
                switch.request()


def _in_foreground(terminal: int) -> bool:
    """Returns False if this process is a background job, which may not change the terminal."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:  # It is not the controlling terminal, so there is no such restriction.
        return True
