"""Trials for the tests of the pool, in a module that workers can import."""

import os
import signal
import threading
from pathlib import Path

import numpy as np

from poil_drake.errors import DetectionError


def draw(offset: float, seed: int) -> tuple[int, float]:
    """Returns a value that depends on the arguments only."""
    return seed, offset + np.random.default_rng(seed).normal()


def get_process(seed: int) -> int:
    """Returns the id of the worker's process."""
    return os.getpid()


def get_threads(seed: int) -> str:
    """Returns the number of cores that linear algebra uses."""
    return os.environ["OMP_NUM_THREADS"]


def kill(folder: Path, seed: int, times: int) -> int:
    """Kills its worker in the first `times` runs with this seed."""
    with open(folder / f"{seed}.runs", "a") as file:
        file.write("x")
    if len((folder / f"{seed}.runs").read_text()) <= times:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


def fail(seed: int) -> int:
    """Raises an error of this package."""
    raise DetectionError(f"No mug in trial {seed}.", remedy="Look elsewhere.")


def make_lock(seed: int) -> object:
    """Returns an object that pickle cannot carry."""
    return threading.Lock()


def run_forever(seed: int) -> None:
    """Prints that it has begun, and never ends."""
    os.write(1, b"begun\n")
    threading.Event().wait()
