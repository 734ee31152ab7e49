"""Runs a trial in a worker; also the program of a worker process on this machine."""

import os
import pickle
import runpy
import select
import sys
import threading
import traceback
import types
from collections.abc import Callable
from typing import Any

from poil_drake.errors import PoilError
from poil_drake.runtime.worker_process import serve


def run_trial(
    function: Callable[..., Any], shared: tuple[Any, ...], arguments: tuple[Any, ...]
) -> bytes:
    """Returns the pickled outcome of a trial: (result, error, traceback of the error).

    The error is None if the trial succeeds. A `PoilError` is returned as it was raised; any other
    exception becomes a RuntimeError with its text, because not every exception can be pickled.
    """
    try:
        return pickle.dumps((function(*shared, *arguments), None, ""))
    except Exception as error:
        text = traceback.format_exc()
        if not isinstance(error, PoilError):
            error = RuntimeError(f"{type(error).__name__}: {error}")
        return pickle.dumps((None, error, text))


def _make_handler(
    setup: tuple[int, str | None, bytes],
) -> Callable[[tuple[Any, ...]], bytes]:
    parent, script, pickled = setup
    if script is not None:
        main = types.ModuleType("__mp_main__")
        main.__dict__.update(runpy.run_path(script, run_name="__mp_main__"))
        sys.modules["__main__"] = sys.modules["__mp_main__"] = main
    function, shared = pickle.loads(pickled)
    threading.Thread(target=_exit_with, args=(os.pidfd_open(parent),), daemon=True).start()
    return lambda arguments: run_trial(function, shared, arguments)


def _exit_with(process: int) -> None:
    """Waits until the process with a pidfd ends; then ends this process, even in a trial."""
    select.select([process], [], [])
    os._exit(1)


if __name__ == "__main__":
    serve(_make_handler)
    sys.stdout.flush()
    sys.stderr.flush()
    # Skips Python's shutdown: OMPL's bindings would report every type that a failed trial uses.
    os._exit(0)
