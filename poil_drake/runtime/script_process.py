"""Both ends of a process that runs a script in another Python environment.

Some libraries cannot be installed beside this package, because their requirements differ. They get
an environment of their own, and a script in it answers requests with arrays. This file is imported
here and run there, so it needs nothing but Python 3.10 and any version of NumPy.
"""

import json
import os
import runpy
import signal
import subprocess
import sys
import threading
import time
import traceback
import weakref
from collections.abc import Callable, Mapping
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import numpy as np

Arrays = Mapping[str, np.ndarray]
Handler = Callable[[dict[str, np.ndarray]], Arrays]

_GRACE = 2.0  # Time that an idle process gets to end by itself [s].


class ScriptProcessError(Exception):
    """A script's process gives no answer. The message lacks a subject, e.g. "has ended"."""


class ScriptProcess:
    """Runs a script in another Python environment, and asks it for arrays.

    The script defines `make_handler(setup)`, which returns a function from a request to its answer,
    both mappings of names to arrays. What the script prints goes to the standard error. The process
    ends when this object is deleted, or when the process that made this object ends, for whatever
    reason. Only one thread at a time may call `ask`.
    """

    def __init__(self, python: str, script: str, setup: Mapping[str, str]):
        """Starts the process, without waiting until it is ready.

        Args:
            python: Path of the environment's Python interpreter.
            script: Path of the script.
            setup: What to pass to the script's `make_handler`.

        Raises:
            ScriptProcessError: if the interpreter cannot be run.
        """
        self._connection, theirs = Pipe()
        self._close = weakref.finalize(self, self._connection.close)
        with theirs:
            try:
                self._process = subprocess.Popen(
                    # Isolated from this environment's PYTHONPATH, and from the names of our files.
                    [python, "-I", __file__, str(theirs.fileno()), script, json.dumps({**setup})],
                    pass_fds=(theirs.fileno(),),
                    stdin=subprocess.DEVNULL,
                    stdout=2,
                    # Ctrl-C reaches only this process, which then ends the other.
                    process_group=0,
                )
            except OSError as error:
                raise ScriptProcessError(f"cannot be started: {error}") from error

    @property
    def pid(self) -> int:
        """The process ID."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def ask(self, request: Arrays, *, timeout: float) -> dict[str, np.ndarray]:
        """Sends a request and returns the answer, whose arrays are read-only.

        The first request waits until the script is ready. An empty request has an empty answer.

        Args:
            request: The request's arrays by name.
            timeout: Time after which a process that has not answered is killed [s].

        Raises:
            ScriptProcessError: if the process has ended, ends before it answers, does not answer in
                time, or answers with an error; it survives the latter.
        """
        if not self._close.alive:
            raise ScriptProcessError(self._ended())
        begin = time.monotonic()
        # A frozen process does not even read, so sending, too, ends only when it is killed.
        alarm = threading.Timer(min(timeout, threading.TIMEOUT_MAX), self.kill)
        alarm.daemon = True
        alarm.start()
        try:
            _send(self._connection, request)
            answer, error = _receive(self._connection)
        except (EOFError, OSError) as failure:
            late = time.monotonic() - begin >= timeout
            self.end()
            reason = f"has not answered within {timeout:g} s" if late else self._ended()
            raise ScriptProcessError(reason) from failure
        except BaseException:
            # An interrupted request must not leave its answer for the next one.
            self.kill()
            self.end()
            raise
        finally:
            alarm.cancel()
        if error:
            raise ScriptProcessError(f"has failed: {error}")
        return answer

    def kill(self) -> None:
        """Kills the process and its children; a pending `ask` raises a ScriptProcessError."""
        if self.alive:
            os.killpg(self._process.pid, signal.SIGKILL)

    def end(self) -> None:
        """Closes the connection and waits for the process to end; kills it after 2 s."""
        self._close()
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self.kill()
            self._process.wait()

    def _ended(self) -> str:
        status = self._process.poll()
        return "has ended" + ("" if status is None else f" with status {status}")


def _send(connection: Connection, arrays: Arrays, error: str = "") -> None:
    """Sends named arrays. Pickles would not do: NumPy 1 cannot read those of NumPy 2."""
    plain = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    layout = [(name, array.dtype.str, array.shape) for name, array in plain.items()]
    connection.send_bytes(json.dumps([error, layout]).encode())
    for array in plain.values():
        connection.send_bytes(array.reshape(-1).view(np.uint8).data)


def _receive(connection: Connection) -> tuple[dict[str, np.ndarray], str]:
    error, layout = json.loads(connection.recv_bytes())
    arrays = {
        name: np.frombuffer(connection.recv_bytes(), dtype).reshape(shape)
        for name, dtype, shape in layout
    }
    return arrays, error


def _serve(connection: Connection, script: str, setup: dict[str, str]) -> None:
    """Answers requests until the other end is closed."""
    handler, failure = _try(lambda: runpy.run_path(script)["make_handler"](setup))
    while True:
        try:
            request, _ = _receive(connection)
        except (EOFError, OSError):
            return
        answer, error = {}, failure
        if request and not failure:
            answer, error = _try(lambda request=request: handler(request))
        try:
            _send(connection, answer or {}, error)
        except OSError:
            return


def _try(function: Callable) -> tuple:
    """Returns (result, ""), or (None, one line on the error), and then prints the traceback."""
    try:
        return function(), ""
    except Exception as error:
        traceback.print_exc()
        return None, " ".join(f"{type(error).__name__}: {error}".split())


if __name__ == "__main__":
    _serve(Connection(int(sys.argv[1])), sys.argv[2], json.loads(sys.argv[3]))
