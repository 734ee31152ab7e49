"""The other end of `worker_process`: answers requests until the connection is closed."""

import gc
import pickle
import signal
import sys
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import PoilError
from poil_drake.runtime.worker_process import Answer, map_shared, write_shared

Handler = Callable[[Any], Answer]
"""Answers a request."""


def run(make_handler: Callable[[Any], Handler]) -> None:
    """Serves a `WorkerProcess`; the main program of its module calls this.

    Args:
        make_handler: Makes what answers from what the worker is told first. An error there is the
            answer to every request.
    """
    # Interrupts are for the process that started this one, which then closes the connection.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    connection, requests, answers = Connection(int(sys.argv[1])), *map(int, sys.argv[2:4])
    try:
        setup = connection.recv_bytes()
    except (EOFError, OSError):
        return
    handler = _made(make_handler, setup)
    gc.collect()
    gc.freeze()
    _serve(handler, connection, requests, answers)


def _made(make_handler: Callable[[Any], Handler], setup: bytes) -> Handler:
    try:
        return make_handler(pickle.loads(setup))
    except Exception as error:
        failure = error if isinstance(error, PoilError) else RuntimeError(traceback.format_exc())

        def fail(request: object) -> Answer:
            raise failure

        return fail


def _serve(handler: Handler, connection: Connection, requests: int, answers: int) -> None:
    """Answers until the connection is closed.

    A request is the sizes of its arrays in the shared memory, then the pickled rest. An answer is
    (value, shapes and types of the arrays in the shared memory), a PoilError, or the text of
    another error's traceback.
    """
    while True:
        try:
            sizes = connection.recv()
            message = connection.recv_bytes()
        except (EOFError, OSError):
            return
        answer: object
        try:
            value, arrays = handler(pickle.loads(message, buffers=_copies(requests, sizes)))
            arrays = [np.asarray(array, order="C") for array in arrays]
            _write(answers, arrays)
            answer = (value, [(array.shape, array.dtype.str) for array in arrays])
        except PoilError as error:
            answer = error
        except Exception:
            answer = traceback.format_exc()
        try:
            connection.send(answer)
        except OSError:
            return


def _copies(file: int, sizes: list[int]) -> list[bytes]:
    """Returns the arrays' bytes, copied: the next request writes over them."""
    buffers, place = [], 0
    with map_shared(file, sum(sizes)) as memory:
        for size in sizes:
            buffers.append(memory[place : place + size])
            place += size
    return buffers


def _write(file: int, arrays: list[np.ndarray]) -> None:
    with map_shared(file, sum(array.nbytes for array in arrays)) as memory:
        write_shared(memory, [array.reshape(-1).view(np.uint8).data for array in arrays])
