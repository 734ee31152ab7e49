"""The other end of `process_tracker`: serves one tracker until the connection is closed."""

import gc
import mmap
import pickle
import signal
import sys
import traceback
from itertools import count
from multiprocessing.connection import Connection
from typing import Any

import cv2

from poil_drake.errors import TrackingError
from poil_drake.perception.trackers.protocol import PointTracker


def serve(connection: Connection, file: int) -> None:
    """Answers requests to start and to step until the connection is closed.

    A request is the sizes of its arrays in the shared memory, then the pickled (method, key of the
    state or None, arguments, keys to forget). An answer is (key of the new state, points, lost), a
    TrackingError, or the text of another error's traceback.

    Args:
        connection: To the process that asks.
        file: Number of the open file that is the shared memory.
    """
    tracker: PointTracker = pickle.loads(connection.recv_bytes())
    states: dict[int, Any] = {}
    keys = count()
    while True:
        try:
            sizes = connection.recv()
            message = connection.recv_bytes()
        except (EOFError, OSError):
            return
        method, key, arguments, dropped = pickle.loads(message, buffers=_copies(file, sizes))
        for old in dropped:
            states.pop(old, None)
        try:
            before = () if key is None else (states[key],)
            output = getattr(tracker, method)(*before, *arguments)
            new = next(keys)
            states[new] = output.state
            answer: object = (new, output.points, output.lost)
        except TrackingError as error:
            answer = error
        except Exception:
            answer = traceback.format_exc()
        connection.send(answer)


def _copies(file: int, sizes: list[int]) -> list[bytes]:
    """Returns the arrays' bytes, copied: the next request writes over them."""
    if not sum(sizes):
        return [b""] * len(sizes)
    buffers, place = [], 0
    with mmap.mmap(file, sum(sizes)) as memory:
        for size in sizes:
            buffers.append(memory[place : place + size])
            place += size
    return buffers


if __name__ == "__main__":
    # Ctrl-C is for the process that started this one, which then closes the connection.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    gc.freeze()
    serve(Connection(int(sys.argv[1])), int(sys.argv[2]))
