"""Keeps signals from interrupting what must not be left half done."""

import signal
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""What ends a process that does not see to it: Ctrl-C, `kill`, a terminal that goes."""


@contextmanager
def HeldSignals(numbers: Sequence[int] = ENDING) -> Iterator[None]:
    """Has signals wait until the end of a block, each once.

    Python handles signals on its main thread; on another one there is nothing to do. (A mask would
    not help: another thread would get the signal, and the main thread still have to handle it.)
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: dict[int, None] = {}

    def hold(number: int, frame: FrameType | None) -> None:
        waiting[number] = None

    before = {number: signal.getsignal(number) for number in numbers}
    left, raised = list(numbers), None
    while left:
        # One that comes now has its handler called still, and what that raises waits.
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
        for number in waiting:
            signal.raise_signal(number)
        if raised is not None:
            raise raised
