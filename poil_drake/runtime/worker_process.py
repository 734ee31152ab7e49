"""Both ends of a worker process: a Python program that answers one request at a time.

One Python process computes on one core at a time, so a second core needs a second process.
"""

import gc
import mmap
import os
import pickle
import signal
import subprocess
import sys
import traceback
import weakref
from collections.abc import Callable
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import cv2
import numpy as np

from poil_drake.errors import PoilError
from poil_drake.runtime.interpreter_turns import TURNS

_GRACE = 2.0  # Time that a worker gets to end by itself [s].
_LOOK = 1.0  # Time between two checks whether a busy worker still runs [s].


class WorkerEndedError(Exception):
    """A worker process has ended. The message lacks a subject, e.g. "has ended with status 1"."""


class WorkerProcess:
    """Runs a module as a separate program, which answers requests.

    Arrays go through shared memory in both directions. The worker is a new interpreter that runs
    only `module`, not the user's script. The worker ends when this object is deleted, or when the
    process that made this object ends, for whatever reason. Only one thread at a time may call
    `ask`. The constructor starts the worker, without waiting until the worker is ready.

    Args:
        module: Name of the module, which calls `serve` when run as a program.
        setup: A value that can be pickled; the worker passes it to the `make_handler` of `serve`.
    """

    def __init__(self, module: str, setup: object):
        connection, theirs = Pipe()
        files = os.memfd_create("poil_requests"), os.memfd_create("poil_answers")
        with theirs:
            inherited = (theirs.fileno(), *files)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *map(str, inherited)],
                pass_fds=inherited,
                # The module path of this process, and one thread for linear algebra.
                env={
                    **os.environ,
                    "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path),
                    "OMP_NUM_THREADS": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                },
                stdin=subprocess.DEVNULL,
                # Ctrl-C reaches only this process, which then ends the worker.
                process_group=0,
            )
        self._channel = _Channel(connection, *files)
        # The worker ends once its connection is closed, as it also is when this process ends.
        self._close = weakref.finalize(self, self._channel.close)
        # As bytes, because the first request may overwrite the arrays before the worker reads them.
        self._channel.send(pickle.dumps(setup))

    @property
    def pid(self) -> int:
        """The process ID."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def ask(self, request: object) -> Any:
        """Sends a request and returns the answer, in which contiguous arrays are read-only.

        Args:
            request: A value that can be pickled.

        Raises:
            PoilError: if the worker raised one.
            RuntimeError: if the worker raised any other error; the message holds the traceback.
            WorkerEndedError: if the process has ended, or ends before it answers.
        """
        if not self._close.alive:
            raise self.ended()
        try:
            TURNS.wait()
            self._channel.send(request)
            arrives = self._channel.connection.poll
            while not arrives(_LOOK):
                # A child of the worker may have inherited the connection, and then keeps it open.
                if not self.alive and not arrives(0.0):
                    raise EOFError
            answer, error = self._channel.receive()
        except (EOFError, OSError) as failure:
            self.end()
            raise self.ended() from failure
        except BaseException:
            # An interrupted request must not leave its answer for the next one.
            self.end()
            raise
        if isinstance(error, PoilError):
            raise error
        if error is not None:
            raise RuntimeError(f"A worker process failed.\n{error}")
        return answer

    def ended(self) -> WorkerEndedError:
        """Returns the error that describes how the process ended."""
        status = self._process.poll()
        return WorkerEndedError(
            "has ended" + (f" with status {status}" if status is not None else "")
        )

    def kill(self) -> None:
        """Kills the process; a pending `ask` raises a WorkerEndedError."""
        self._process.kill()

    def end(self) -> None:
        """Closes the connection and waits for the process to end; kills it after 2 s."""
        self._close()
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve(make_handler: Callable[[Any], Callable[[Any], Any]]) -> None:
    """Answers the requests of a `WorkerProcess`, until the `WorkerProcess` closes the connection.

    The worker's module calls this function when it is run as a program.

    Args:
        make_handler: Takes the `setup` of the `WorkerProcess`, and returns the function that
            answers a request. If `make_handler` raises an error, every request raises that error.
    """
    # The process that started this one handles interrupts, and then closes the connection.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    connection, requests, answers = map(int, sys.argv[1:4])
    channel = _Channel(Connection(connection), answers, requests)
    handler, failure = _try(lambda: make_handler(pickle.loads(channel.receive())))
    gc.collect()
    gc.freeze()
    try:
        while True:
            request = channel.receive()
            channel.send((None, failure) if failure else _try(partial(handler, request)))
    except (EOFError, OSError):
        return  # The other end is closed.


def _try(function: Callable[[], Any]) -> tuple[Any, PoilError | str | None]:
    """Returns (result, None), or (None, error): a PoilError, or any other error's traceback."""
    try:
        return function(), None
    except PoilError as error:
        return None, error
    except Exception:
        return None, traceback.format_exc()


class _Channel:
    """One end of a connection that passes arrays through shared memory.

    The memory has no name, so nothing remains of it however the processes end.
    """

    def __init__(self, connection: Connection, sent: int, received: int):
        """Takes ownership of the arguments; `sent` and `received` are descriptors of two files."""
        self.connection = connection
        self._sent, self._received = _SharedMemory(sent), _SharedMemory(received)

    def send(self, value: object) -> None:
        """Sends any value that can be pickled; its contiguous arrays go through shared memory."""
        buffers: list[pickle.PickleBuffer] = []
        message = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
        arrays = [np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers]
        sizes = [array.nbytes for array in arrays]
        for place, array in zip(self._sent.places(sizes), arrays, strict=True):
            np.copyto(place, array)  # NumPy releases the interpreter while it copies.
        self.connection.send(sizes)
        self.connection.send_bytes(message)

    def receive(self) -> Any:
        """Waits for a value and returns it; its contiguous arrays are read-only copies.

        Raises:
            EOFError: if the other end is closed.
        """
        sizes, message = self.connection.recv(), self.connection.recv_bytes()
        buffers = [place.copy() for place in self._received.places(sizes)]
        for buffer in buffers:
            buffer.flags.writeable = False
        return pickle.loads(message, buffers=buffers)

    def close(self) -> None:
        self.connection.close()
        os.close(self._sent.file)
        os.close(self._received.file)


class _SharedMemory:
    def __init__(self, file: int):
        self.file = file
        self._memory: mmap.mmap | None = None

    def places(self, sizes: list[int]) -> list[np.ndarray]:
        """Returns consecutive arrays of `sizes` bytes in the memory, which grows if needed."""
        end = np.cumsum([0, *sizes])
        if self._memory is None or len(self._memory) < end[-1]:
            size = max(int(end[-1]), mmap.PAGESIZE)
            if os.fstat(self.file).st_size < size:
                os.ftruncate(self.file, size)
            self._memory = mmap.mmap(self.file, size)
        shared = np.frombuffer(self._memory, np.uint8)
        return [shared[start : start + size] for start, size in zip(end, sizes, strict=False)]
