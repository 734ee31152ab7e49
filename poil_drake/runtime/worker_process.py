"""A Python program in a process of its own that answers one request at a time.

Python runs one thread at a time, so work that is to use the second core needs a second process.
`worker_service` is the other end.
"""

import mmap
import os
import pickle
import subprocess
import sys
import weakref
from collections.abc import Sequence
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from poil_drake.errors import PoilError
from poil_drake.runtime.interpreter_turns import TURNS

_GRACE = 2.0  # [s] that a worker gets to end by itself


class WorkerEndedError(Exception):
    """The process is not there any more; the message says so, and with which status."""


class Answer(NamedTuple):
    """What a worker answers.

    Attributes:
        value: Anything that can be pickled.
        arrays: Large arrays, which come through shared memory. They own their data.
    """

    value: Any
    arrays: Sequence[np.ndarray] = ()


class WorkerProcess:
    """Runs a module as a program of its own and asks it.

    Arrays go through shared memory, both ways. The worker is a program of its own, not a fork and
    not a `multiprocessing.Process`, which would run the user's script once more. It ends when this
    object or this process does, however that ends. It is not meant to be asked by two threads at
    once; while it works, other threads run.
    """

    def __init__(self, module: str, setup: object):
        """Starts the process; does not wait for it.

        Args:
            module: Name of the module; run as a program, it calls `worker_service.run`.
            setup: What the worker is told first.
        """
        self._connection, theirs = Pipe()
        self._requests, self._answers = _SharedMemory("requests"), _SharedMemory("answers")
        with theirs:
            files = (theirs.fileno(), self._requests.file, self._answers.file)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *map(str, files)],
                pass_fds=files,
                env=_environment(),
                stdin=subprocess.DEVNULL,
                # Ctrl-C is for this process, which then ends the worker.
                process_group=0,
            )
        # The worker ends by itself when this end is closed, so also when this process ends.
        self._close = weakref.finalize(
            self, _close, self._connection, (self._requests.file, self._answers.file)
        )
        self._connection.send_bytes(pickle.dumps(setup))

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def ask(self, request: object) -> Answer:
        """Sends a request and waits for the answer.

        Raises:
            PoilError: what the worker raised.
            RuntimeError: with the text of any other error of the worker.
            WorkerEndedError: when the process has ended, or does before it has answered.
        """
        if not self._close.alive:
            raise self.ended()
        try:
            TURNS.wait()
            self._send(request)
            answer = self._connection.recv()
        except (EOFError, OSError) as error:
            self.end()
            raise self.ended() from error
        except BaseException:
            # Whoever is interrupted here must not get this answer to the next request.
            self.end()
            raise
        if isinstance(answer, PoilError):
            raise answer
        if isinstance(answer, str):
            raise RuntimeError(f"A worker process failed.\n{answer}")
        value, layout = answer
        return Answer(value, self._answers.read(layout))

    def ended(self) -> WorkerEndedError:
        """Returns the error that says how the process has ended."""
        status = self._process.poll()
        return WorkerEndedError(
            "has ended" + (f" with status {status}" if status is not None else "")
        )

    def kill(self) -> None:
        """Ends the process at once, whatever it does; who waits for its answer is told."""
        self._process.kill()

    def end(self) -> None:
        """Closes the connection, and waits for the process to end."""
        self._close()
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _send(self, request: object) -> None:
        """Sends a request, its arrays through the shared memory."""
        buffers: list[pickle.PickleBuffer] = []
        message = pickle.dumps(request, protocol=5, buffer_callback=buffers.append)
        views = [buffer.raw() for buffer in buffers]
        self._requests.write(views)
        self._connection.send([view.nbytes for view in views])
        self._connection.send_bytes(message)


class _SharedMemory:
    """Memory without a name: nothing is left behind, however the processes end.

    Attributes:
        file: Number of the open file that is the memory.
    """

    def __init__(self, name: str):
        self.file = os.memfd_create(f"poil_{name}")
        self._memory: mmap.mmap | None = None

    def write(self, views: Sequence[memoryview]) -> None:
        """Puts the views one after the other."""
        write_shared(self._mapped(sum(view.nbytes for view in views)), views)

    def read(self, layout: Sequence[tuple[tuple[int, ...], str]]) -> list[np.ndarray]:
        """Returns copies of the arrays that lie there one after the other."""
        arrays = [np.empty(shape, dtype) for shape, dtype in layout]
        memory = self._mapped(sum(array.nbytes for array in arrays))
        place = 0
        for array in arrays:
            found = np.frombuffer(memory, array.dtype, array.size, place)
            np.copyto(array, found.reshape(array.shape))
            place += array.nbytes
        return arrays

    def _mapped(self, size: int) -> mmap.mmap:
        if self._memory is None or len(self._memory) < size:
            self._memory = map_shared(self.file, size)
        return self._memory


def map_shared(file: int, size: int) -> mmap.mmap:
    """Returns the first bytes of an open file as memory; a file that is shorter grows."""
    size = max(size, mmap.PAGESIZE)
    if os.fstat(file).st_size < size:
        os.ftruncate(file, size)
    return mmap.mmap(file, size)


def write_shared(memory: mmap.mmap, views: Sequence[memoryview]) -> None:
    """Puts views of bytes one after the other into memory that has room for them."""
    place = 0
    for view in views:
        # NumPy leaves the interpreter to other threads while it copies.
        there = np.frombuffer(memory, np.uint8, view.nbytes, place)
        np.copyto(there, np.frombuffer(view, np.uint8))
        place += view.nbytes


def _environment() -> dict[str, str]:
    """Returns the worker's: it finds what this process finds, and computes on one core.

    More threads than that would only wait for each other.
    """
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def _close(connection: Connection, files: tuple[int, ...]) -> None:
    connection.close()
    for file in files:
        os.close(file)
