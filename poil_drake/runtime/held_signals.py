"""Delays Unix signals while a block must not be interrupted."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""The signals of Ctrl-C, `kill` and a closing terminal, which end a process by default."""


@contextmanager
def HeldSignals() -> Iterator[None]:
    """Delays the signals in `ENDING` until the end of the `with` block, then raises each once.

    Does nothing on other threads than the main thread, because Python handles signals only there.
    (A signal mask would not help: another thread would receive the signal, and the main thread
    would still handle it.)
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: dict[int, None] = {}

    def hold(number: int, frame: FrameType | None) -> None:
        waiting[number] = None

    before = {number: signal.getsignal(number) for number in ENDING}
    left, raised = list(ENDING), None
    while left:
        # A signal that arrives here still calls its old handler, whose exception is delayed, too.
        try:
            while left:
                signal.signal(left[0], hold)
                del left[0]
        except BaseException as error:
            raised = error
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for held in waiting:
            signal.raise_signal(held)
        if raised is not None:
            raise raised
