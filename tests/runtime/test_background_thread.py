"""Work beside the simulation."""

import sys
import threading

import pytest

from poil_drake.errors import StationError
from poil_drake.runtime.background_thread import Background


def test_close_finishes_work_that_has_yet_to_begin() -> None:
    background = Background("worker")
    interval = sys.getswitchinterval()
    sys.setswitchinterval(10.0)  # The thread begins only when this one waits for it.
    try:
        future = background.submit(int, "3")
        background.close()
    finally:
        sys.setswitchinterval(interval)

    assert future.result() == 3


def test_close_cancels_work_that_waits_behind_other_work() -> None:
    background, go = Background("worker"), threading.Event()
    first = background.submit(go.wait)
    others = [background.submit(int), background.submit(int)]
    threading.Timer(0.05, go.set).start()

    background.close()

    assert first.result()
    assert all(other.cancelled() for other in others)


def test_submit_after_close_is_an_error() -> None:
    background = Background("cameras' thread")
    background.close()

    with pytest.raises(StationError, match="cameras' thread has been closed"):
        background.submit(int)
