"""Stops the robot when a key is typed in the terminal."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from poil_drake.systems.skill.stop_requests import StopSwitch

STOP_KEYS = b" \r\nqQ\x1b"
"""Space, Enter, q and Escape: large keys, and keys that are easy to remember."""


@contextmanager
def terminal_stop_key(switch: StopSwitch, *, stream: TextIO | None = None) -> Iterator[bool]:
    """Requests a stop for every stop key that is typed inside the `with` block.

    Inside the block the terminal is not in line mode, so keys arrive without Enter and without
    echo; Ctrl-C still interrupts. Closing the terminal requests a stop, too. Stop keys have no
    effect if `stream` is not a terminal, or if this process is a background job.

    Args:
        switch: Receives the requests.
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
    thread = threading.Thread(target=_listen, args=(switch, terminal, wake_reader), daemon=True)
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


def _listen(switch: StopSwitch, terminal: int, wake_reader: int) -> None:
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
            if key in STOP_KEYS:
                switch.request()


def _in_foreground(terminal: int) -> bool:
    """Returns False if this process is a background job, which may not change the terminal."""
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:  # It is not the controlling terminal, so there is no such restriction.
        return True
