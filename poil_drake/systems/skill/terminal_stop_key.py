"""Stops the robot by a key in the terminal."""

import os
import select
import sys
import termios
import threading
import tty
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TextIO

from poil_drake.systems.skill.stop_requests import StopSwitch

STOP_KEYS = b" \r\nqQ\x1b"
"""Space, Enter, q and Escape: large keys, and keys that are easy to remember."""


class TerminalStopKey:
    """Requests a stop for every stop key that is typed while the context manager is open.

    It takes the terminal out of its line mode, so that keys arrive without Enter and without echo,
    and restores the mode at the end. Ctrl-C still interrupts. It does nothing if the stream is no
    terminal, or if another program controls the terminal, as for a background job.

    Attributes:
        active: Whether it listens to keys.
    """

    def __init__(self, switch: StopSwitch, *, stream: TextIO | None = None):
        """Stores the arguments; listening starts on entry.

        Args:
            switch: Receives the requests.
            stream: The terminal; None for the standard input.
        """
        self._switch, self._stream = switch, stream
        self.active = False

    def __enter__(self) -> Self:
        terminal = _terminal(self._stream or sys.stdin)
        if terminal is not None:
            self._terminal = terminal
            self._modes: list[Any] = termios.tcgetattr(terminal)
            self._wake_reader, self._wake_writer = os.pipe()
            self._thread = threading.Thread(target=self._listen, daemon=True)
            tty.setcbreak(terminal)
            self.active = True
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if not self.active:
            return
        self.active = False
        try:
            os.close(self._wake_writer)
            self._thread.join()
            os.close(self._wake_reader)
        finally:
            if _in_foreground(self._terminal):
                with suppress(termios.error):  # The terminal was closed.
                    termios.tcsetattr(self._terminal, termios.TCSANOW, self._modes)

    def _listen(self) -> None:
        while True:
            ready, _, _ = select.select([self._terminal, self._wake_reader], [], [])
            if self._wake_reader in ready:
                return
            try:
                typed = os.read(self._terminal, 64)
            except OSError:
                typed = b""
            if not typed:  # The terminal was closed, so there will be no more keys.
                self._switch.request()
                return
            for key in typed:
                if key in STOP_KEYS:
                    self._switch.request()


def _terminal(stream: TextIO | None) -> int | None:
    """Returns the descriptor of a stream that is a terminal in our control, else None."""
    if stream is None or stream.closed or not stream.isatty():
        return None
    return stream.fileno() if _in_foreground(stream.fileno()) else None


def _in_foreground(terminal: int) -> bool:
    """Returns whether we may change a terminal; the system suspends background jobs that do."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:  # It is not our controlling terminal, so there is no such restriction.
        return True
