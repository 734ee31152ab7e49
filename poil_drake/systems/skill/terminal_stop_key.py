"""Keys of the terminal that stop the robot."""

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
"""Space, Enter, q and Escape: large, or easily remembered."""


class TerminalStopKey:
    """Presses a switch for every stop key that is typed while it is open.

    As a context manager it takes the terminal out of its line mode, so that keys arrive without
    Enter and are not shown, and gives it back as it was. Ctrl-C still interrupts. Where the stream
    is no terminal, or another program has the terminal, as for a job in the background, it does
    nothing.

    Attributes:
        active: Whether keys are listened for.
    """

    def __init__(self, switch: StopSwitch, *, stream: TextIO | None = None):
        """Keeps what it needs; nothing happens before it is entered.

        Args:
            switch: What to press.
            stream: The terminal; None for the standard input.
        """
        self._switch, self._stream = switch, stream
        self.active = False

    def __enter__(self) -> Self:
        terminal = _terminal(sys.stdin if self._stream is None else self._stream)
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
                with suppress(termios.error):  # The terminal has gone.
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
            if not typed:  # The terminal has gone, and nobody can press a key any more.
                self._switch.request()
                return
            for key in typed:
                if key in STOP_KEYS:
                    self._switch.request()


def _terminal(stream: TextIO | None) -> int | None:
    """Returns the descriptor of a stream that is a terminal of ours, else None."""
    try:
        descriptor = -1 if stream is None else stream.fileno()
    except (OSError, ValueError):  # Not a file, or closed.
        return None
    ours = descriptor >= 0 and os.isatty(descriptor) and _in_foreground(descriptor)
    return descriptor if ours else None


def _in_foreground(terminal: int) -> bool:
    """Returns whether we may change a terminal; a job in the background would be halted."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:  # It is not what controls us, so nobody halts us.
        return True
